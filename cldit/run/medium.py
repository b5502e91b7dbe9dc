"""From a scene to what is traced: spray, optics, and an octree for each wavelength."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cldit.medium.cloud import SAMPLING, Kernel, halves, variants
from cldit.medium.frame import Frame
from cldit.medium.octree import CellSource, Octree, PointSource, build_octrees
from cldit.optics.band import BandOptics
from cldit.optics.emitters import emitters
from cldit.optics.wavelengths import Wavelengths, wavelengths
from cldit.provenance import FileRead
from cldit.run.budget import ParcelVariants, Probed
from cldit.run.phases import droplets_content, mean_phase, phase_choice
from cldit.run.spray_factory import make_spray
from cldit.run.stages import Stages
from cldit.scene import Scene
from cldit.scene.optics import MOST_WAVELENGTHS, Optics
from cldit.spray.result import Spray
from cldit.transport.phase import ScatteringTable

Source = tuple[PointSource | None, list[CellSource]]
_SEED = 1  # of the halves of the parcels


@dataclass(frozen=True)
class Properties:
    """What a spray does to light at each wavelength, and with the paper's properties.

    sources: a wavelength each. phases: of each wavelength's droplets, None where they scatter
    isotropically. paper, paper_phase: likewise with the paper's properties; None where no
    comparison is wanted. phase: what was chosen, in words; remarks: what one should know of it.
    """

    chosen: Wavelengths
    sources: tuple[Source, ...]
    phases: tuple[ScatteringTable | None, ...]
    paper: Source | None
    paper_phase: ScatteringTable | None
    phase: str
    remarks: tuple[str, ...]


def properties_of(scene: Scene, spray: Spray, *, cache: Path | None) -> Properties:
    """Optical properties of a scene's spray.

    Args:
        scene: what is to be traced.
        spray: that of the scene.
        cache: folder of tables; None keeps nothing.

    Raises:
        ClditError: optical data do not cover the scene, or its phase function needs diameters.
    """
    chosen = wavelengths(scene, spray, cache=cache)
    sources = tuple(emitters(spray, band) for band in chosen.bands)
    choice = phase_choice(scene, spray, scene.optics.preset)
    phases: list[ScatteringTable | None] = [None] * len(sources)
    content = droplets_content(spray)
    if choice.mie:
        each = zip(chosen.bands, sources, strict=True)
        phases = [
            mean_phase(spray, band, points, content=content, cache=cache)
            for band, (points, _) in each
        ]
    words = choice.words
    g = [phase.asymmetry for phase in phases if phase is not None]
    if choice.mie:
        words += f", g {min(g):.3f} to {max(g):.3f}" if g else ": nothing scatters"
    paper = paper_phase = None
    if chosen.errors_K and scene.optics.compare_paper:
        (band,) = wavelengths(scene, spray, cache=cache, paper=True).bands
        paper = emitters(spray, band)
        if phase_choice(scene, spray, "paper").mie:
            paper_phase = mean_phase(spray, band, paper[0], content=content, cache=cache)
    remarks = (*choice.remarks, *_not_reached(scene.optics, chosen))
    return Properties(chosen, sources, tuple(phases), paper, paper_phase, words, remarks)


def _not_reached(asked: Optics, chosen: Wavelengths) -> tuple[str, ...]:
    """That the wavelengths, as their error is printed, err by more than `asked` for."""
    if not float(f"{chosen.error_K:.2g}") > asked.spectral_error_K:
        return ()
    count = len(chosen.nodes)
    given = "as optics.wavelengths sets it" if asked.wavelengths is not None else "the most"
    return (
        f"wavelengths: {count} ({given}) leave an estimated {chosen.error_K:.2g} K RMS in T_app, "
        f"more than optics.spectral_error_K: {asked.spectral_error_K:g} asks for; allowed is "
        f"optics.wavelengths up to {MOST_WAVELENGTHS}, or a larger optics.spectral_error_K",
    )


def deposited(scene: Scene, spray: Spray) -> Spray:
    """The spray with its parcels spread as the scene wants it: as clouds, or in points.

    Parcels that come with an extent, boxes or clouds, stay as they are.
    """
    if spray.parcels is None or spray.parcels.extent is not None:
        return spray
    wanted = getattr(scene.spray, "deposit", None)
    if wanted is None:  # droplets that the user has spread already stay where they are
        wanted = "points" if getattr(scene.spray, "spread_m", None) else "kernel"
    if wanted == "points":
        return spray
    return replace(spray, parcels=Kernel().spread(spray.parcels))


@dataclass(frozen=True)
class Medium:
    """A tree for each spectral node, and one with the paper's properties where that is wanted.

    properties: without `sources` and `paper`, which are in the trees. files: that the spray was
    read from. probed: what the errors of cells and parcels are measured on; None where the scene
    wants no audit.
    """

    trees: list[Octree]
    paper: Octree | None
    properties: Properties
    notes: dict[str, float]
    files: tuple[FileRead, ...] = ()
    probed: Probed | None = None


def make_medium(scene: Scene, stages: Stages, cache: Path, spray: Spray | None = None) -> Medium:
    """The scene's medium.

    Args:
        scene: what is to be traced.
        stages: take the time of each step.
        cache: folder of tables and sprays.
        spray: that of the scene, where it is there already.
    """
    with stages.stage("spray") as note:
        note.append(scene.spray.model if spray is None else "given")
        made = spray or make_spray(scene.spray, cache=cache)
        spray = deposited(scene, made)
        stages.remark(spray.remarks)
        notes, files = dict(spray.notes), made.files
    with stages.stage("optics") as note:
        found = properties_of(scene, spray, cache=cache)
        sources = [*found.sources, *([] if found.paper is None else [found.paper])]
        count = len(found.sources)
        note.append(f"{count} wavelength{'s' if count > 1 else ''}")
        stages.remark(found.remarks)
    domain = scene.domain
    frame = Frame.around(
        centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_edge_m
    )
    probed = _probed(scene, frame, (made, spray), found) if scene.transport.audit else None
    del made, spray  # with what the trees are made of, as large as the trace that follows
    with stages.stage("octree") as note:
        trees = build_octrees(frame, sources, optical_depth_split=domain.optical_depth_split)
        note.append(f"{sum(trees[0].leaves)} leaves, finest {frame.cell_m * 1e3:.3g} mm")
    paper = trees.pop() if found.paper is not None else None
    return Medium(trees, paper, replace(found, sources=(), paper=None), notes, files, probed)


def _probed(scene: Scene, frame: Frame, sprays: tuple[Spray, Spray], found: Properties) -> Probed:
    """What is measured on, at the wavelength with most of the light; of the spray as it was made
    and as it is deposited."""
    made, spray = sprays
    chosen = found.chosen
    at_K = chosen.quadrature.reference_K
    number = int(np.argmax([float(node.share(at_K)) for node in chosen.nodes]))
    gas = ""
    if spray.vapour is not None:
        gas = (
            f"the gas of {scene.spray.model} is known on one grid alone; compare with a run on a "
            "finer one"
        )
    return Probed(
        frame=frame,
        sources=found.sources[number],
        number=number,
        node=chosen.nodes[number],
        parcels=_parcel_variants(made, spray, chosen.bands[number]),
        gas=gas,
        optical_depth_split=scene.domain.optical_depth_split,
    )


def _parcel_variants(made: Spray, spray: Spray, band: BandOptics) -> ParcelVariants | None:
    """Sources of the spray with other parcels; None where its droplets are no sample of two."""
    parcels = made.parcels
    if parcels is None or not parcels.sampled or np.count_nonzero(parcels.droplets) < 2:
        return None
    spread = spray.parcels is not None and spray.parcels.extent is not None
    if not spread or parcels.extent is not None:
        assert spray.parcels is not None
        both = halves(spray.parcels, seed=_SEED)
        one, other = (emitters(replace(spray, parcels=half), band) for half in both)
        return ParcelVariants((one, other), None, 0.5)
    found = variants(made, kernel=Kernel(), seed=_SEED)
    one, other = (emitters(half, band) for half in found.halves)
    return ParcelVariants((one, other), emitters(found.narrower, band), SAMPLING)
