"""From a scene to what is traced: spray, optics, and an octree for each wavelength."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cldit.gpu.device import Device
from cldit.io.provenance import FileRead
from cldit.medium.cloud import SAMPLING, Kernel, halves, variants
from cldit.medium.frame import Frame
from cldit.medium.octree import Octree, Sources, build_octrees
from cldit.optics.band import BandOptics, emitters
from cldit.optics.scene_phase import scene_phase
from cldit.optics.wavelengths import Wavelengths, wavelengths
from cldit.prepare.case_fit import misfits
from cldit.prepare.cell_choice import cells_that_fit, chosen_frame, lattice_frames
from cldit.prepare.gas_grid import GasGrid, coarser_gas
from cldit.prepare.phases import droplets_content, in_classes, mean_phase, sizes_left
from cldit.prepare.probed import ParcelVariants, Probed
from cldit.prepare.spray_factory import make_spray
from cldit.prepare.stages import Stages
from cldit.scene import Scene
from cldit.scene.optics import MOST_WAVELENGTHS, Optics
from cldit.scene.spray import CfdSpray, ConeSpray, LagrangianSpray
from cldit.spray.result import Spray
from cldit.transport.phase import ScatteringTable

_SEED = 1  # of the halves of the parcels
_INTEGRATED = ("vapour_absorption", "droplet_absorption", "droplet_scattering")
# Why the error of the grid of a gas that is read is not known.
_GAS = "the gas comes on one grid alone; compare with a run from a finer one"


@dataclass(frozen=True)
class Properties:
    """What a spray does to light at each wavelength, and with the paper's properties.

    sources: a wavelength each. phases: of each wavelength's droplets, None where they scatter
    isotropically. paper, paper_phase: likewise with the paper's properties; None where no
    comparison is wanted. phase: what was chosen, in words; remarks: what one should know of it.
    """

    chosen: Wavelengths
    sources: tuple[Sources, ...]
    phases: tuple[ScatteringTable | None, ...]
    paper: Sources | None
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
    choice = scene_phase(scene, spray, scene.optics.preset)
    phases: list[ScatteringTable | None] = [None] * len(sources)
    content = droplets_content(spray)
    if choice.mie:
        each = zip(chosen.bands, sources, strict=True)
        phases = [
            mean_phase(spray, band, points, content=content, cache=cache)
            for band, (points, _) in each
        ]
        sources = tuple(
            (in_classes(points, spray, phase), cells)
            for (points, cells), phase in zip(sources, phases, strict=True)
        )
    words = choice.name
    g = [phase.asymmetry for phase in phases if phase is not None]
    if choice.mie:
        words += f", g {min(g):.3f} to {max(g):.3f}" if g else ": nothing scatters"
        classes = max((len(phase.tables) for phase in phases if phase is not None), default=1)
        words += f", {classes} classes of size" if classes > 1 else ""
    paper = paper_phase = None
    if chosen.errors_K and scene.optics.compare_paper:
        (band,) = wavelengths(scene, spray, cache=cache, paper=True).bands
        paper = emitters(spray, band)
        if scene_phase(scene, spray, "paper").mie:
            paper_phase = mean_phase(spray, band, paper[0], content=content, cache=cache)
            paper = (in_classes(paper[0], spray, paper_phase), paper[1])
    remarks = (*choice.remarks, *_not_reached(scene.optics, chosen), *sizes_left(phases))
    return Properties(chosen, sources, tuple(phases), paper, paper_phase, words, remarks)


def _not_reached(asked: Optics, chosen: Wavelengths) -> tuple[str, ...]:
    """That the wavelengths, as their error is printed, err by more than `asked` for."""
    if not float(f"{chosen.error_K:.2g}") > asked.bound_K:
        return ()
    count = len(chosen.nodes)
    given = "as optics.wavelengths sets it" if asked.wavelengths is not None else "the most"
    return (
        f"wavelengths: {count} ({given}) leave an estimated {chosen.error_K:.2g} K RMS in T_app, "
        f"more than optics.spectral_error_K: {asked.bound_K:.2g} asks for; allowed is "
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
class Prepared:
    """What trees are made of.

    frame: the cube, divided as the scene has it, or as the paper has it. properties: with
    `sources`. probed: what the errors of the medium are measured on; None where the scene wants no
    audit. limit: cells that fit the memory.
    """

    frame: Frame
    optical_depth_split: float
    properties: Properties
    notes: dict[str, float]
    files: tuple[FileRead, ...]
    probed: Probed | None
    limit: int

    def grown(self, stages: Stages, depth: int | None = None) -> Medium:
        """The medium in cells.

        Args:
            stages: take the time.
            depth: how often the cube is halved; None: as the scene has it.

        Raises:
            MediumError: there are more cells than memory allows.
        """
        found = self.properties
        frame = self.frame if depth is None else replace(self.frame, depth=depth)
        sources = [*found.sources, *([] if found.paper is None else [found.paper])]
        with stages.stage("octree") as note:
            trees = build_octrees(
                frame,
                sources,
                optical_depth_split=self.optical_depth_split,
                max_cells=self.limit,
            )
            note.append(f"{sum(trees[0].leaves)} leaves, finest {frame.cell_m * 1e3:.3g} mm")
        paper = trees.pop() if found.paper is not None else None
        bare = replace(found, sources=(), paper=None)
        integrals = tuple(
            {f"{name}_m2": tree.integral(name) for name in _INTEGRATED} for tree in trees
        )
        return Medium(trees, paper, bare, self.notes, self.files, self.probed, integrals)


@dataclass(frozen=True)
class Medium:
    """A tree for each spectral node, and one with the paper's properties where that is wanted.

    properties: without `sources` and `paper`, which are in the trees. files: that the spray was
    read from. probed: what the errors of cells and parcels are measured on; None where the scene
    wants no audit. integrals: over each tree's cube, m2, of what it absorbs and scatters.
    """

    trees: list[Octree]
    paper: Octree | None
    properties: Properties
    notes: dict[str, float]
    files: tuple[FileRead, ...] = ()
    probed: Probed | None = None
    integrals: tuple[dict[str, float], ...] = ()


def make_medium(
    scene: Scene, device: Device, stages: Stages, cache: Path, spray: Spray | None = None
) -> Medium:
    """The scene's medium, with its cells as the scene has them.

    Args:
        scene, device, stages, cache, spray: as in `prepare`.
    """
    return prepare(scene, device, stages, cache, spray).grown(stages)


def prepare(
    scene: Scene,
    device: Device,
    stages: Stages,
    cache: Path,
    spray: Spray | None = None,
    *,
    lattice_of_m: float | None = None,
) -> Prepared:
    """The scene's spray and its optical properties.

    Args:
        scene: what is to be traced.
        device: whose memory the cells must fit.
        stages: take the time of each step.
        cache: folder of tables and sprays.
        spray: that of the scene, where it is there already.
        lattice_of_m: edge of the cube whose cells are those of the cone's lattice; None: cells are
            as the scene has them.
    """
    with stages.stage("spray") as note:
        note.append(scene.spray.model if spray is None else "given")
        made = spray or make_spray(scene.spray, cache=cache, watch=stages.watch)
        spray = deposited(scene, made)
        stages.remark(spray.remarks)
        notes, files = dict(spray.notes), made.files
    if isinstance(scene.spray, CfdSpray):
        stages.remark(misfits(scene, spray))
    with stages.stage("optics") as note:
        found = properties_of(scene, spray, cache=cache)
        count = len(found.sources)
        note.append(f"{count} wavelength{'s' if count > 1 else ''}")
        stages.remark(found.remarks)
    phase = any(one is not None for one in (*found.phases, found.paper_phase))
    sweeps = scene.transport.method == "source"
    limit = cells_that_fit(device, wavelengths=len(found.sources), phase=phase, sweeps=sweeps)
    if lattice_of_m is not None:
        cube, frame = lattice_frames(
            scene.domain, found.sources[0], edge_m=lattice_of_m, spacing_m=_spacing_m(scene)
        )
    else:
        frame, remarks = chosen_frame(scene.domain, found.sources[0], limit=limit)
        cube = frame
        stages.remark(remarks)
    probed = None
    if scene.transport.audit:
        probed = _probed(scene, (made, spray), found, cache, stages, frame=cube, limit=limit)
        probed = replace(probed, on_lattice=lattice_of_m is not None)
    return Prepared(frame, scene.domain.optical_depth_split, found, notes, files, probed, limit)


def _spacing_m(scene: Scene) -> float:
    assert isinstance(scene.spray, ConeSpray)
    return scene.spray.lattice_m


def _probed(
    scene: Scene,
    sprays: tuple[Spray, Spray],
    found: Properties,
    cache: Path,
    stages: Stages,
    *,
    frame: Frame,
    limit: int,
) -> Probed:
    """What is measured on, at the wavelength with most of the light; of the spray as it was made
    and as it is deposited."""
    made, spray = sprays
    chosen = found.chosen
    at_K = chosen.quadrature.reference_K
    number = int(np.argmax([float(node.share(at_K)) for node in chosen.nodes]))
    gas, cone = None, scene.spray
    band, phase = chosen.bands[number], found.phases[number]

    def resprayed(other: ConeSpray | LagrangianSpray) -> Sources:
        return _sources(deposited(scene, make_spray(other, cache=cache)), band, phase)

    if spray.vapour is not None and isinstance(cone, LagrangianSpray):
        with stages.stage("spray on cells of gas twice as large"):
            gas = coarser_gas(cone, spray.vapour, frame, resprayed)
    elif spray.vapour is not None and not isinstance(cone, ConeSpray):
        gas = GasGrid(None, _GAS)

    return Probed(
        frame=frame,
        sources=found.sources[number],
        number=number,
        node=chosen.nodes[number],
        parcels=_parcel_variants(made, spray, band, phase),
        gas=gas,
        cone=cone if isinstance(cone, ConeSpray) else None,
        resprayed=resprayed,
        optical_depth_split=scene.domain.optical_depth_split,
        limit=limit,
        on_lattice=False,
    )


def _sources(spray: Spray, band: BandOptics, phase: ScatteringTable | None) -> Sources:
    """What a spray is to light, its droplets in the classes of a phase function."""
    points, cells = emitters(spray, band)
    return in_classes(points, spray, phase), cells


def _parcel_variants(
    made: Spray, spray: Spray, band: BandOptics, phase: ScatteringTable | None
) -> ParcelVariants | None:
    """Sources of the spray with other parcels; None where its droplets are no sample of two."""
    parcels = made.parcels
    if parcels is None or not parcels.sampled or np.count_nonzero(parcels.droplets) < 2:
        return None
    spread = spray.parcels is not None and spray.parcels.extent is not None
    if not spread or parcels.extent is not None:
        assert spray.parcels is not None
        both = halves(spray.parcels, seed=_SEED)
        one, other = (_sources(replace(spray, parcels=half), band, phase) for half in both)
        return ParcelVariants((one, other), None, 0.5)
    found = variants(made, kernel=Kernel(), seed=_SEED)
    one, other = (_sources(half, band, phase) for half in found.halves)
    return ParcelVariants((one, other), _sources(found.narrower, band, phase), SAMPLING)
