"""Spray, optics and octrees of a scene, one octree for each wavelength."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cldit.gpu.device import Device
from cldit.io.origin import FileRead
from cldit.medium.cloud import Kernel, smeared
from cldit.medium.frame import Cube
from cldit.medium.gas_reconstruction import reconstructed
from cldit.medium.octree import Octree, Sources, build_octrees
from cldit.optics.band import emitters
from cldit.optics.scene_phase import scene_phase
from cldit.optics.spectral import SpectralNode
from cldit.optics.wavelengths import Wavelengths, elsewhere, wavelengths
from cldit.prepare.case_fit import misfits
from cldit.prepare.cell_choice import (
    cells_that_fit,
    chosen_frame,
    finest_lattice_m,
    lattice_frames,
)
from cldit.prepare.phases import droplets_content, in_classes, mean_phase, sizes_left
from cldit.prepare.spray_factory import AnySpray, make_spray
from cldit.prepare.stages import Stages
from cldit.scene import Scene
from cldit.scene.optics import MOST_WAVELENGTHS, Optics
from cldit.scene.spray import CfdSpray, ConeSpray, GridSpray, LagrangianSpray
from cldit.spray.result import Spray
from cldit.transport.phase import ScatteringTable

_INTEGRATED = ("vapour_absorption", "droplet_absorption", "droplet_scattering")


@dataclass(frozen=True)
class Properties:
    """Optical properties of a spray at each wavelength, and the paper's properties.

    sources: of each wavelength. phases: phase function of each wavelength's droplets, None:
    isotropic. paper, paper_phase: likewise with the paper's properties; None where no comparison
    is wanted. phase: name of the phase function. remarks: for the user.
    """

    chosen: Wavelengths
    sources: tuple[Sources, ...]
    phases: tuple[ScatteringTable | None, ...]
    paper: Sources | None
    paper_phase: ScatteringTable | None
    phase: str
    remarks: tuple[str, ...]


def properties_of(
    scene: Scene, spray: Spray, *, cache: Path | None, tolerance_K: float | None = None
) -> Properties:
    """Optical properties of a scene's spray.

    cache: folder of tables; None keeps nothing. tolerance_K: error of T_app that the wavelengths
    may leave; None: that of the scene.
    """
    chosen = wavelengths(scene, spray, cache=cache, tolerance_K=tolerance_K)
    sources = tuple(emitters(spray, band) for band in chosen.bands)
    choice = scene_phase(scene, spray, scene.optics.preset)
    phases: list[ScatteringTable | None] = [None] * len(sources)
    content = droplets_content(spray)
    if choice.mie:
        pairs = zip(chosen.bands, sources, strict=True)
        phases = [
            mean_phase(spray, band, points, content=content, cache=cache)
            for band, (points, _) in pairs
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
    bound_K = scene.optics.bound_K if tolerance_K is None else tolerance_K
    remarks = (
        *elsewhere(scene, spray),
        *choice.remarks,
        *_not_reached(scene.optics, chosen, bound_K=bound_K),
        *sizes_left(phases),
    )
    return Properties(chosen, sources, tuple(phases), paper, paper_phase, words, remarks)


def _not_reached(asked: Optics, chosen: Wavelengths, *, bound_K: float) -> tuple[str, ...]:
    """Remark that the error of the wavelengths, as printed, exceeds what was asked for."""
    if not float(f"{chosen.error_K:.2g}") > bound_K:
        return ()
    count = len(chosen.nodes)
    choice = "as optics.wavelengths sets it" if asked.wavelengths is not None else "the most"
    return (
        f"wavelengths: {count} ({choice}) leave an estimated {chosen.error_K:.2g} K RMS in T_app, "
        f"more than optics.spectral_error_K: {bound_K:.2g} asks for; allowed: "
        f"optics.wavelengths up to {MOST_WAVELENGTHS}, or a larger optics.spectral_error_K",
    )


def deposited(scene: Scene, spray: Spray) -> Spray:
    """The spray with its parcels spread as the scene wants it: as clouds, or in points.

    Parcels that come with an extent, boxes or clouds, keep it, and are smeared along their
    velocity as the camera's exposure asks for. Computed and imported gas is linear in its cells.
    """
    if spray.vapour is not None and isinstance(scene.spray, CfdSpray | LagrangianSpray):
        spray = replace(spray, vapour=reconstructed(spray.vapour))
    if spray.parcels is None:
        return spray
    exposure_s = scene.camera.smear_s
    if getattr(scene.spray, "deposit", None) == "points" or spray.parcels.extent is not None:
        moved = smeared(spray.parcels, exposure_s)
        return spray if moved is spray.parcels else replace(spray, parcels=moved)
    return replace(spray, parcels=Kernel(exposure_s=exposure_s).spread(spray.parcels))


@dataclass(frozen=True)
class Prepared:
    """Spray and optics of a scene, from which octrees are built.

    made, spray: before and after its parcels are deposited. frame: the cube that is divided into
    cells; cube: the domain's, which differs where the cells are a cone's lattice (`on_lattice`).
    spec: the scene's spray with what the run chose. number: of the wavelength at which the spray
    hides or sends most light. limit: number of cells that fit the memory. stages: of the run.
    kept: variants of the medium by name.
    """

    scene: Scene
    made: Spray
    spray: Spray
    properties: Properties
    frame: Cube
    cube: Cube
    on_lattice: bool
    spec: AnySpray
    number: int
    limit: int
    device: Device
    stages: Stages
    cache: Path
    kept: dict[str, Any] = field(default_factory=dict)

    @property
    def cone(self) -> ConeSpray | None:
        """The cone that was made, where the spray is one."""
        return self.spec if isinstance(self.spec, ConeSpray) else None

    @property
    def node(self) -> SpectralNode:
        """The wavelength at which the spray hides or sends most light."""
        return self.properties.chosen.nodes[self.number]

    @property
    def sources(self) -> Sources:
        """Droplets and gas at that wavelength."""
        return self.properties.sources[self.number]

    @property
    def is_empty(self) -> bool:
        """True without droplets and gas."""
        points, cells = self.sources
        return points is None and not cells

    @property
    def is_clear(self) -> bool:
        """True if there is no medium and no patch in front of the camera, so no source of error."""
        return self.is_empty and not self.scene.patches

    def finest_lattice_m(self, *, wavelengths: int, size_classes: int | None = None) -> float:
        """The cone's finest lattice whose parcels fit the memory; 0: any does, or there is no cone.

        Sources of all `wavelengths` are in memory together. size_classes: None: those it has.
        """
        cone, points = self.cone, self.properties.sources[0][0]
        if cone is None or points is None:
            return 0.0
        parcels = (size_classes or cone.classes) / cone.classes * len(points.position_m)
        return finest_lattice_m(cone.lattice_m, parcels=parcels, wavelengths=wavelengths)

    def sources_of(self, spray: Spray) -> Sources:
        """Another spray at that wavelength, its droplets in the same classes of size."""
        phase = self.properties.phases[self.number]
        points, cells = emitters(spray, self.properties.chosen.bands[self.number])
        return in_classes(points, spray, phase), cells

    def other_spray(self, spec: AnySpray) -> Spray:
        """The spray of another specification, deposited as that of the scene."""
        return deposited(self.scene, make_spray(spec, self.device, cache=self.cache))

    def resprayed(self, spec: AnySpray) -> Sources:
        """The spray of another specification at that wavelength."""
        return self.sources_of(self.other_spray(spec))

    def rescattered(self, phase_name: Literal["isotropic", "mie"]) -> "Prepared":
        """The medium whose droplets scatter isotropically, or by Mie's phase function, at that
        wavelength; raises PhaseError without diameters."""
        band = self.properties.chosen.bands[self.number]
        points, cells = emitters(self.spray, band)
        phase = None
        if phase_name == "mie":
            content = droplets_content(self.spray)
            phase = mean_phase(self.spray, band, points, content=content, cache=self.cache)
        count = len(self.properties.sources)
        sources = ((in_classes(points, self.spray, phase), cells),) * count
        rescattered = replace(self.properties, sources=sources, phases=(phase,) * count)
        scene = self.scene.with_(**{"transport.phase": phase_name})
        return replace(self, scene=scene, properties=rescattered, kept={})

    def variant(self, name: str, make: Callable[[], Any]) -> Any:
        """A variant of the medium, made once."""
        if name not in self.kept:
            self.kept[name] = make()
        return self.kept[name]

    def octrees(
        self, frame: Cube, sources: Sequence[Sources], split: float | None = None
    ) -> list[Octree]:
        """Trees of `sources` in a cube; `split` takes the place of `domain.optical_depth_split`."""
        if split is None:
            split = self.scene.domain.optical_depth_split
        return build_octrees(
            frame, sources, optical_depth_split=split, max_cells=self.limit, device=self.device
        )

    def grown(self, depth: int | None = None) -> "Medium":
        """Octrees of all wavelengths.

        depth: number of times that the cube is halved; None: as the scene has it.
        """
        properties = self.properties
        frame = self.frame if depth is None else self.frame.at(depth)
        sources = [*properties.sources, *([] if properties.paper is None else [properties.paper])]
        with self.stages.stage("octree") as note:
            trees = self.octrees(frame, sources)
            note.append(f"{sum(trees[0].leaves)} leaves, finest {frame.cell_m * 1e3:.3g} mm")
        paper = trees.pop() if properties.paper is not None else None
        bare = replace(properties, sources=(), paper=None)
        integrals = tuple(
            {f"{name}_m2": tree.integral(name) for name in _INTEGRATED} for tree in trees
        )
        notes, files = dict(self.spray.notes), self.made.files
        return Medium(trees, paper, bare, notes, files, integrals, frame.cell_m)


@dataclass(frozen=True)
class Medium:
    """A tree for each wavelength, and one with the paper's properties where that is wanted.

    properties: without `sources` and `paper`, which are in the trees. files: that the spray was
    read from. integrals: of absorption and scattering over each tree's cube, m2. cell_m: edge of
    the finest cells.
    """

    trees: list[Octree]
    paper: Octree | None
    properties: Properties
    notes: dict[str, float]
    files: tuple[FileRead, ...] = ()
    integrals: tuple[dict[str, float], ...] = ()
    cell_m: float = 0.0


def prepare(
    scene: Scene,
    device: Device,
    stages: Stages,
    cache: Path,
    spray: Spray | None = None,
    *,
    spec: AnySpray | None = None,
    cube_m: float | None = None,
    spectral_K: float | None = None,
) -> Prepared:
    """The scene's spray and its optical properties.

    Args:
        spray: that of the scene, where it is there already.
        spec: the scene's spray with what was chosen for it; None: the scene's own.
        cube_m: edge of the cube whose cells are the cone's lattice; None: cells are as the scene
            has them.
        spectral_K: error of T_app that the wavelengths may leave; None: as the scene has it.
    """
    spec = spec or scene.spray
    with stages.stage("spray") as note:
        note.append(scene.spray.model if spray is None else "given")
        undeposited = spray or make_spray(spec, device, cache=cache, watch=stages.watch)
        spray = deposited(scene, undeposited)
        stages.remark((*spray.remarks, *_motion_remarks(scene, undeposited)))
    if isinstance(scene.spray, CfdSpray):
        stages.remark(misfits(scene, spray))
    with stages.stage("optics") as note:
        properties = properties_of(scene, spray, cache=cache, tolerance_K=spectral_K)
        count, sources = len(properties.sources), properties.sources[0]
        note.append(f"{count} wavelength{'s' if count > 1 else ''}")
        stages.remark(properties.remarks)
    phase = any(table is not None for table in (*properties.phases, properties.paper_phase))
    sweeps = scene.transport.method == "source"
    limit = cells_that_fit(device, wavelengths=count, phase=phase, sweeps=sweeps)
    if cube_m is not None:
        assert isinstance(spec, ConeSpray)
        cube, frame = lattice_frames(scene.domain, sources, edge_m=cube_m, spacing_m=spec.lattice_m)
    else:
        voxels = isinstance(scene.spray, GridSpray)
        frame, remarks = chosen_frame(scene.domain, sources, device, limit=limit, voxels=voxels)
        cube = frame
        if voxels or not scene.transport.audit:
            stages.remark(remarks)  # else the run chooses cells by their error
    return Prepared(
        scene=scene,
        made=undeposited,
        spray=spray,
        properties=properties,
        frame=frame,
        cube=cube,
        on_lattice=cube_m is not None,
        spec=spec,
        number=properties.chosen.main,
        limit=limit,
        device=device,
        stages=stages,
        cache=cache,
    )


def _motion_remarks(scene: Scene, spray: Spray) -> tuple[str, ...]:
    """Remarks on droplets that are smeared, cannot be, or move by more than a pixel."""
    camera, parcels = scene.camera, spray.parcels
    velocity = None if parcels is None else parcels.velocity_m_s
    if camera.exposure == "smear":
        if velocity is not None:
            return ("camera.exposure: droplets are smeared along their velocity, vapour is not",)
        return (
            "camera.exposure: smear has no effect, since the parcels have no velocity: the image "
            "is that of an instant",
        )
    given_s = camera.sensor.integration_time_s
    if camera.exposure != "instant" or given_s is None or velocity is None or parcels is None:
        return ()
    area = parcels.droplets * parcels.diameter_m**2
    if not area.any():
        return ()
    speed_m_s = float(np.sqrt(np.average(np.sum(velocity[:, ::2] ** 2, axis=1), weights=area)))
    moved_m = speed_m_s * given_s
    if moved_m <= camera.pixel_m:
        return ()
    return (
        f"droplets move by {1e3 * moved_m:.2g} mm (RMS in the image) during {1e6 * given_s:g} us, "
        f"{moved_m / camera.pixel_m:.2g} pixels of the sensor, but the image is of an instant; "
        "camera.exposure: smear or times shows the mean",
    )
