"""From a scene to what is traced: spray, optics, and an octree for each wavelength."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cldit.medium.frame import Frame
from cldit.medium.octree import Octree, build_octrees
from cldit.optics.band import BandOptics
from cldit.optics.emitters import emitters
from cldit.optics.wavelengths import Wavelengths, wavelengths
from cldit.run.stages import Stages
from cldit.scene import Scene
from cldit.spray.result import Spray
from cldit.spray.source import make_spray
from cldit.transport.phase import PhaseError, ScatteringTable, mean_of


@dataclass(frozen=True)
class Medium:
    """A tree for each spectral node, and one with the paper's properties where that is wanted."""

    trees: list[Octree]
    chosen: Wavelengths
    paper: Octree | None
    notes: dict[str, float]
    phase: ScatteringTable | None


def make_medium(scene: Scene, stages: Stages, cache: Path, spray: Spray | None = None) -> Medium:
    """The scene's medium; `spray` is that of the scene where it is there already."""
    with stages.stage("spray") as note:
        note.append(scene.spray.model if spray is None else "given")
        spray = spray or make_spray(scene.spray, cache=cache)
        stages.remark(spray.remarks)
    with stages.stage("optics") as note:
        chosen = wavelengths(scene, spray, cache=cache)
        bands = list(chosen.bands)
        note.append(f"{len(bands)} wavelength{'s' if len(bands) > 1 else ''}")
        compared = bool(chosen.errors_K) and scene.optics.compare_paper
        if compared:
            bands += wavelengths(scene, spray, cache=cache, paper=True).bands
        sources = [emitters(spray, band) for band in bands]
        phase = None
        if scene.transport.phase == "mie":
            phase = mean_phase(spray, bands[len(chosen.bands) // 2])
    domain = scene.domain
    frame = Frame.around(
        centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_edge_m
    )
    with stages.stage("octree") as note:
        trees = build_octrees(frame, sources, optical_depth_split=domain.optical_depth_split)
        note.append(f"{sum(trees[0].leaves)} leaves, finest {frame.cell_m * 1e3:.3g} mm")
    paper = trees.pop() if compared else None
    return Medium(trees, chosen, paper, dict(spray.notes), phase)


def mean_phase(spray: Spray, band: BandOptics) -> ScatteringTable | None:
    """The droplets' mean phase function in one band, which serves for all; None without droplets.

    Raises:
        PhaseError: droplets are given as coefficients, without diameters.
    """
    if spray.prescribed is not None and np.any(spray.prescribed.droplet_scattering_per_m > 0):
        raise PhaseError(
            "transport.phase: mie needs droplet diameters, and this spray gives coefficients only; "
            "allowed: isotropic, {henyey_greenstein: g}"
        )
    points, _ = emitters(spray, band)
    return mean_of(spray.parcels, band.droplets, None if points is None else points.scattering_m2)
