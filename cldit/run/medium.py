"""From a scene to what is traced: spray, optics, and an octree for each wavelength."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cldit.medium.frame import Frame
from cldit.medium.octree import Octree, PointSource, build_octrees
from cldit.optics.band import BandOptics
from cldit.optics.cache import Arrays, cached, digest
from cldit.optics.emitters import emitters
from cldit.optics.wavelengths import Wavelengths, wavelengths
from cldit.run.stages import Stages
from cldit.scene import Scene
from cldit.scene.transport import HenyeyGreenstein
from cldit.spray.result import Spray
from cldit.spray.source import make_spray
from cldit.transport.phase import PhaseError, ScatteringTable, mean_of

_FORM = 1  # of kept phase functions


@dataclass(frozen=True)
class Medium:
    """A tree for each spectral node, and one with the paper's properties where that is wanted.

    phases: of each node's droplets, None where they scatter isotropically; paper_phase: likewise,
    with the paper's properties. phase: what was chosen, in words.
    """

    trees: list[Octree]
    chosen: Wavelengths
    paper: Octree | None
    notes: dict[str, float]
    phases: tuple[ScatteringTable | None, ...]
    paper_phase: ScatteringTable | None
    phase: str


def make_medium(scene: Scene, stages: Stages, cache: Path) -> Medium:
    with stages.stage("spray") as note:
        spray = make_spray(scene.spray, cache=cache)
        note.append(scene.spray.model)
        stages.remark(spray.remarks)
    with stages.stage("optics") as note:
        chosen = wavelengths(scene, spray, cache=cache)
        bands = list(chosen.bands)
        note.append(f"{len(bands)} wavelength{'s' if len(bands) > 1 else ''}")
        compared = bool(chosen.errors_K) and scene.optics.compare_paper
        if compared:
            bands += wavelengths(scene, spray, cache=cache, paper=True).bands
        sources = [emitters(spray, band) for band in bands]
        choice = phase_choice(scene, spray, scene.optics.preset)
        each = list(zip(bands, (points for points, _ in sources), strict=True))
        phases = [mean_phase(spray, *one, cache) if choice.mie else None for one in each]
        paper_phase = phases.pop() if compared else None
        if not phase_choice(scene, spray, "paper").mie:
            paper_phase = None
        stages.remark(choice.remarks)
    domain = scene.domain
    frame = Frame.around(
        centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_edge_m
    )
    with stages.stage("octree") as note:
        trees = build_octrees(frame, sources, optical_depth_split=domain.optical_depth_split)
        note.append(f"{sum(trees[0].leaves)} leaves, finest {frame.cell_m * 1e3:.3g} mm")
    paper = trees.pop() if compared else None
    words = choice.words
    g = [phase.asymmetry for phase in phases if phase is not None]
    if choice.mie:
        words += f", g {min(g):.3f} to {max(g):.3f}" if g else ": nothing scatters"
    return Medium(trees, chosen, paper, dict(spray.notes), tuple(phases), paper_phase, words)


@dataclass(frozen=True)
class PhaseChoice:
    """How droplets scatter: by Mie's phase function or not, in words, and what one should know."""

    mie: bool
    words: str
    remarks: tuple[str, ...] = ()


def phase_choice(scene: Scene, spray: Spray, preset: Literal["paper", "spectral"]) -> PhaseChoice:
    """What the scene says, or what its preset means where it says nothing."""
    given = scene.transport.phase
    if isinstance(given, HenyeyGreenstein):
        return PhaseChoice(False, f"Henyey and Greenstein, g {given.henyey_greenstein:g}")
    if given is not None:
        return PhaseChoice(given == "mie", given)
    if preset == "paper":
        return PhaseChoice(False, "isotropic (preset paper)")
    if _coefficients(spray):
        remark = (
            "droplets given as coefficients, without diameters, are taken to scatter "
            "isotropically; set transport.phase: {henyey_greenstein: g} if g is known"
        )
        return PhaseChoice(False, "isotropic (no diameters)", (remark,))
    if scene.transport.method == "branching":
        remark = "method branching scatters isotropically, whatever the preset"
        return PhaseChoice(False, "isotropic (method branching)", (remark,))
    return PhaseChoice(True, "mie (preset spectral)")


def _coefficients(spray: Spray) -> bool:
    given = spray.prescribed
    return given is not None and bool(np.any(given.droplet_scattering_per_m > 0))


def mean_phase(
    spray: Spray, band: BandOptics, points: PointSource | None, cache: Path | None
) -> ScatteringTable | None:
    """The droplets' mean phase function in one band; None where none scatters.

    Args:
        points: what `emitters` made of the droplets in this band.
        cache: folder in which it is kept by content; None keeps nothing.

    Raises:
        PhaseError: droplets are given as coefficients, without diameters.
    """
    if _coefficients(spray):
        raise PhaseError(
            "transport.phase: mie needs droplet diameters, and this spray gives coefficients only; "
            "allowed: isotropic, {henyey_greenstein: g}"
        )
    if points is None or spray.parcels is None or band.droplets is None:
        return None
    if not points.scattering_m2.any():
        return None
    table = band.droplets.tables[len(band.droplets.tables) // 2]
    sizes = digest(spray.parcels.diameter_m, points.scattering_m2)
    kept = cached(
        cache,
        kind="scattering",
        text=f"{_FORM} {table.wavelength_um!r} {table.n!r} {table.k!r} {sizes}",
        make=lambda: _plain(mean_of(spray.parcels, band.droplets, points.scattering_m2)),
    )
    return ScatteringTable(kept["cosine"], kept["cumulative"])


def _plain(table: ScatteringTable | None) -> Arrays:
    return {} if table is None else {"cosine": table.cosine, "cumulative": table.cumulative}
