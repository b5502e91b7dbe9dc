"""A run: one scene through spray, optics, octree, trace and noise-free evaluation; and its folder.

scene = cldit.load_scene("gdi")
run = cldit.simulate(scene, out="runs/gdi")
run.maps.apparent_temperature_K
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import yaml

from cldit.camera.sensor import SensorModel
from cldit.dit.accuracy import temperature_error_K
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps, Reason
from cldit.errors import RunFolderError
from cldit.gpu.device import Device, open_device
from cldit.medium.frame import Frame
from cldit.medium.octree import Octree, build_octree, build_octrees
from cldit.optics.band import BandOptics
from cldit.optics.emitters import emitters
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.optics.wavelengths import Wavelengths, wavelengths
from cldit.radiance.boundary import Boundary, Surroundings, picture
from cldit.radiance.weights import Weights
from cldit.scene import Scene, dump_scene, parse_scene
from cldit.spectral import (
    Difference,
    NodeTraces,
    SpectralInfo,
    node_folders,
    save_nodes,
    trace_nodes,
)
from cldit.spray.result import Spray
from cldit.spray.source import make_spray
from cldit.transport.closure import Closure
from cldit.transport.phase import PhaseError, ScatteringTable, mean_of
from cldit.transport.trace import settings_for, trace

Say = Callable[[str], None]

_VERSIONS = ("cldit", "numpy", "scipy", "pyopencl", "miepython")


@dataclass(frozen=True)
class Stage:
    """One step of a run: what it took, and a word on what it did or why it was left out."""

    name: str
    seconds: float
    note: str = ""


@dataclass(frozen=True)
class RunInfo:
    """How a run came about; everything here can be written as JSON."""

    device: str
    device_reason: str
    stages: tuple[Stage, ...]
    accuracy_K: float | None  # estimated error of T_app by the trace; None where nothing scatters
    spray: dict[str, float]
    counts: dict[str, int]
    defines: dict[str, dict[str, Any]]  # kernel file -> what it was compiled with
    precision: str
    integration_time_s: float  # of the sensor, for the standard errors and the rig
    versions: dict[str, str] = field(default_factory=dict)
    spectral: SpectralInfo | None = None  # how the filter was resolved
    closure: Closure | None = None  # how far the sum of weights is from 1
    remarks: tuple[str, ...] = ()  # what was inferred from the spray's files

    def to_json(self) -> str:
        data = {**self.__dict__, "stages": [stage.__dict__ for stage in self.stages]}
        for name, part in (("spectral", self.spectral), ("closure", self.closure)):
            data[name] = None if part is None else part.to_dict()
        return json.dumps(data, indent=2)

    @classmethod
    def from_json(cls, text: str) -> RunInfo:
        data = json.loads(text)
        stages = tuple(Stage(**stage) for stage in data["stages"])
        spectral, closure = data.get("spectral"), data.get("closure")
        return cls(
            **{
                **data,
                "stages": stages,
                "remarks": tuple(data["remarks"]),
                "spectral": None if spectral is None else SpectralInfo.from_dict(spectral),
                "closure": None if closure is None else Closure.from_dict(closure),
            }
        )


@dataclass(frozen=True)
class Run:
    """What `simulate` and `open_run` return.

    weights, reference: of the traced scene, and of the same scene without spray; (H, W) float32,
        row 0 at the top; emission in photons s-1 m-2 sr-1. For all of the filter: those of several
        spectral nodes are combined by `effective_weights`, for light of
        `quadrature.reference_K` (the middle background).
    spectral: the weights of each node of `quadrature`; (weights,) where there is one.
    maps: DIT of the trace without noise, (H, W); the standard errors are those that the scene's
        sensor and number of shots would give.
    measured: DIT of what the rig acquired, on the sensor's pixels; None before an acquisition.
    folder: where it is stored, if anywhere.
    """

    scene: Scene
    weights: Weights
    reference: Weights
    maps: Maps
    info: RunInfo
    quadrature: Quadrature
    spectral: tuple[Weights, ...]
    measured: Maps | None = None
    folder: Path | None = None

    @property
    def pixel_m(self) -> tuple[float, float]:
        """Width and height of a traced pixel in the plane of the target."""
        camera = self.scene.camera
        return (camera.field_m[0] / camera.pixels[0], camera.field_m[1] / camera.pixels[1])


class _Stages:
    """Times the stages of a run and tells the user which one is under way."""

    def __init__(self, say: Say | None) -> None:
        self.done: list[Stage] = []
        self.remarks: list[str] = []
        self._say = say

    def remark(self, remarks: Sequence[str]) -> None:
        """What a stage inferred and the user should know; kept for the report."""
        self.remarks += remarks
        if self._say is not None:
            for text in remarks:
                self._say(text)

    @contextmanager
    def stage(self, name: str) -> Iterator[list[str]]:
        if self._say is not None:
            self._say(name)
        note: list[str] = []
        start = time.perf_counter()
        yield note
        self.done.append(Stage(name, time.perf_counter() - start, "; ".join(note)))


def default_cache() -> Path:
    """Folder in which tables are kept from run to run."""
    return Path(platformdirs.user_cache_dir("cldit", appauthor=False))


def simulate(
    scene: Scene,
    out: str | Path | None = None,
    *,
    device: Device | None = None,
    cache: Path | None = None,
    progress: Say | None = None,
) -> Run:
    """Traces a scene and evaluates it without noise.

    Args:
        out: folder to store the run in; None keeps it in memory. A folder that holds the same
            scene, finished, is read instead of traced again.
        device: OpenCL device; None lets `open_device` choose (the run says which and why).
        cache: folder for tables; None is `default_cache()`.
        progress: called with a line of text as things happen.

    Raises:
        ClditError: a subclass that says what is wrong and what to do.
    """
    folder = None if out is None else Path(out)
    if folder is not None:
        stored = _stored(folder, scene)
        if stored is not None:
            if progress is not None:
                progress(f"{folder} holds this scene already: read, not traced again")
            return stored
    device = device or open_device()
    stages = _Stages(progress)
    medium = _medium(scene, stages, cache or default_cache())
    frame, chosen = medium.trees[0].frame, medium.chosen
    settings = settings_for(scene, medium.phase)
    result = trace_nodes(medium.trees, chosen.quadrature, scene, device, settings, report=progress)
    reference = trace(_nothing(frame), scene, device, settings).weights
    steps = ("compile", "scattering", "image", *(["gather"] if "gather" in result.seconds else []))
    for name in steps:
        note = "" if name in result.seconds else "left out: nothing scatters"
        passes = [one.solution.passes for one in result.traces if one.solution is not None]
        if name == "scattering" and passes:
            note = f"{result.counts['sweeps']} sweeps; {sum(passes)} passes"
        if name == ("gather" if "gather" in steps else "scattering") and "samples" in result.counts:
            note = f"{result.counts['samples']} samples a pixel"
        if name == "scattering" and "scattered_rays" in result.counts:
            note = f"{result.counts['scattered_rays']} rays started by scattering"
        stages.done.append(Stage(name, result.seconds.get(name, 0.0), note))
    with stages.stage("evaluation"):
        sensor = _sensor(scene, chosen.quadrature, (result.spectral, reference))
        maps = _evaluate(scene, chosen.quadrature, result.spectral, reference, sensor)
    from_paper = None
    if medium.paper is not None:
        with stages.stage("the paper's properties"):
            other = trace(medium.paper, scene, device, settings).weights
            grey = Quadrature.grey(
                chosen.quadrature.filter_um, reference_K=chosen.quadrature.reference_K
            )
            from_paper = Difference.of(maps, _evaluate(scene, grey, (other,), reference, sensor))
    run = Run(
        scene=scene,
        weights=result.weights,
        reference=reference,
        maps=maps,
        info=_info(
            scene,
            device,
            result,
            maps,
            stages,
            medium.notes,
            sensor.integration_time_s,
            SpectralInfo.of(chosen.quadrature, chosen.errors_K, from_paper),
        ),
        quadrature=chosen.quadrature,
        spectral=result.spectral,
        folder=folder,
    )
    if folder is not None:
        _save(run, folder)
    return run


@dataclass(frozen=True)
class _Medium:
    """A tree for each spectral node, and one with the paper's properties where that is wanted."""

    trees: list[Octree]
    chosen: Wavelengths
    paper: Octree | None
    notes: dict[str, float]
    phase: ScatteringTable | None


def _medium(scene: Scene, stages: _Stages, cache: Path) -> _Medium:
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
        phase = None
        if scene.transport.phase == "mie":
            phase = _mean_phase(spray, bands[len(chosen.bands) // 2])
    domain = scene.domain
    frame = Frame.around(
        centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_edge_m
    )
    with stages.stage("octree") as note:
        trees = build_octrees(frame, sources, optical_depth_split=domain.optical_depth_split)
        note.append(f"{sum(trees[0].leaves)} leaves, finest {frame.cell_m * 1e3:.3g} mm")
    paper = trees.pop() if compared else None
    return _Medium(trees, chosen, paper, dict(spray.notes), phase)


def _mean_phase(spray: Spray, band: BandOptics) -> ScatteringTable | None:
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


def _nothing(frame: Frame) -> Octree:
    """The same cube without a spray."""
    return build_octree(frame, None, [], optical_depth_split=1.0)


def _sensor(
    scene: Scene, quadrature: Quadrature, seen: tuple[tuple[Weights, ...], Weights]
) -> SensorModel:
    """The scene's sensor, set so that its hottest background does not saturate it.

    seen: weights of the nodes with spray, and the one without.
    """
    sensor = SensorModel.from_scene(scene)
    if scene.camera.sensor.integration_time_s is not None:
        return sensor
    around = Surroundings.from_scene(scene)
    bands = [Boundary.of(around, node.radiance, node.pane) for node in quadrature.nodes]
    hottest = max(scene.background.temperatures_K)
    spray, reference = seen
    images = [
        picture(weights, bands, background_K=hottest)
        for weights in (spray, [reference] * len(bands))
    ]
    return sensor.exposed_for(max(float(image.max()) for image in images))


def _evaluate(
    scene: Scene,
    quadrature: Quadrature,
    spectral: tuple[Weights, ...],
    reference: Weights,
    sensor: SensorModel,
) -> Maps:
    if len(set(scene.background.temperatures_K)) < 2:
        # A trace is of use without DIT; the maps say why they are empty.
        return Maps.unevaluated(reference.background.shape, Reason.TOO_FEW_BACKGROUNDS)
    return evaluate_radiance(
        spectral,
        reference,
        background_temperatures_K=scene.background.temperatures_K,
        surroundings=Surroundings.from_scene(scene),
        filter_um=quadrature.filter_um,
        nodes=quadrature.nodes if len(spectral) > 1 else None,
        sensor=sensor,
        shots=scene.plan.shots,
        references=scene.plan.references,
    )


def _info(
    scene: Scene,
    device: Device,
    result: NodeTraces,
    maps: Maps,
    stages: _Stages,
    notes: dict[str, float],
    integration_time_s: float,
    spectral: SpectralInfo,
) -> RunInfo:
    accuracy = None
    if result.difference is not None:
        # The two pictures share the source that was solved for; measured on `gdi` (see
        # settings_for), what that hides adds about 30 % to their difference.
        accuracy = 1.3 * temperature_error_K(
            maps,
            result.difference,
            surroundings=Surroundings.from_scene(scene),
            filter_um=scene_filter(scene),
        )
    last = result.traces[-1]  # all are compiled alike
    versions = {name: version(name) for name in _VERSIONS}
    versions["python"] = platform.python_version()
    versions["opencl"] = f"{device.info.version}, driver {device.info.driver}"
    return RunInfo(
        device=f"{device.info.index} {device.info.name} ({device.info.platform})",
        device_reason=device.reason,
        stages=tuple(stages.done),
        accuracy_K=accuracy,
        spray=notes,
        counts=result.counts,
        defines={program.name: dict(program.defines) for program in last.programs},
        precision=last.precision,
        closure=result.closure,
        remarks=tuple(stages.remarks),
        integration_time_s=integration_time_s,
        spectral=spectral,
        versions=versions,
    )


def _save(run: Run, folder: Path) -> None:
    """Writes the run; run.json comes last, so that a folder with it is whole."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.yaml").write_text(dump_scene(run.scene), encoding="utf-8")
    run.weights.save(folder / "weights", pixel_m=run.pixel_m)
    save_nodes(folder / "weights", run.quadrature, run.spectral, pixel_m=run.pixel_m)
    run.reference.save(folder / "weights_reference", pixel_m=run.pixel_m)
    run.maps.save(folder / "maps", pixel_m=run.pixel_m)
    (folder / "run.json").write_text(run.info.to_json(), encoding="utf-8")


def _stored(folder: Path, scene: Scene) -> Run | None:
    """The finished run of this very scene in `folder`, if there is one.

    Raises:
        RunFolderError: the folder holds something else.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return None
    known = folder / "scene.yaml"
    if not known.is_file():
        raise RunFolderError(f"{folder}: is not empty and holds no run; give another folder")
    before = parse_scene(yaml.safe_load(known.read_text(encoding="utf-8")), source=str(known))
    if before != scene:
        raise RunFolderError(
            f"{folder}: holds a run of another scene ({before.name}, or other settings); give "
            "another folder, or remove this one"
        )
    if getattr(scene.spray, "file", None) is not None or not (folder / "run.json").is_file():
        return None
    run = open_run(folder)
    return run if run.info.versions.get("cldit") == version("cldit") else None


def open_run(path: str | Path) -> Run:
    """Reads a run folder.

    Raises:
        RunFolderError: the folder is missing, holds no finished run, or is damaged.
    """
    folder = Path(path)
    for name in ("scene.yaml", "run.json"):
        if not (folder / name).is_file():
            hint = "" if name == "scene.yaml" else "; run the same command again to finish it"
            raise RunFolderError(f"{folder}: holds no finished run ({name} is missing){hint}")
    scene = parse_scene(yaml.safe_load((folder / "scene.yaml").read_text(encoding="utf-8")))
    measured = folder / "acquisition" / "maps"
    patches = [patch.name for patch in scene.patches]
    try:
        info = RunInfo.from_json((folder / "run.json").read_text(encoding="utf-8"))
    except (ValueError, TypeError, KeyError) as error:
        raise RunFolderError(f"{folder / 'run.json'}: is damaged ({error})") from error
    grey = Quadrature.grey(
        scene_filter(scene),
        reference_K=reference_temperature_K(scene.background.temperatures_K),
    )
    quadrature, nodes = node_folders(folder / "weights", grey)
    return Run(
        scene=scene,
        weights=Weights.load(folder / "weights", patches=patches),
        quadrature=quadrature,
        spectral=tuple(Weights.load(node, patches=patches) for node in nodes),
        reference=Weights.load(folder / "weights_reference", patches=patches),
        maps=Maps.load(folder / "maps"),
        info=info,
        measured=Maps.load(measured) if measured.is_dir() else None,
        folder=folder,
    )


def with_stages(run: Run, stages: list[Stage], measured: Maps) -> Run:
    """The run with an acquisition's maps and stages added."""
    info = replace(run.info, stages=(*run.info.stages, *stages))
    return replace(run, info=info, measured=measured)
