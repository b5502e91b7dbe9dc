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

import platformdirs
import yaml

from cldit.camera.sensor import SensorModel
from cldit.dit.accuracy import temperature_error_K
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.gpu.device import Device, open_device
from cldit.medium.frame import Frame
from cldit.medium.octree import Octree, build_octree
from cldit.optics.emitters import emitters
from cldit.optics.planck import band_radiance
from cldit.radiance.weights import Weights, background_radiance, compose
from cldit.scene import Scene, dump_scene, parse_scene
from cldit.spray.source import make_spray
from cldit.transport.trace import Trace, settings_for, trace

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
    remarks: tuple[str, ...] = ()  # what was inferred from the spray's files

    def to_json(self) -> str:
        data = {**self.__dict__, "stages": [stage.__dict__ for stage in self.stages]}
        return json.dumps(data, indent=2)

    @classmethod
    def from_json(cls, text: str) -> RunInfo:
        data = json.loads(text)
        stages = tuple(Stage(**stage) for stage in data["stages"])
        return cls(**{**data, "stages": stages, "remarks": tuple(data["remarks"])})


@dataclass(frozen=True)
class Run:
    """What `simulate` and `open_run` return.

    weights, reference: of the traced scene, and of the same scene without spray; (H, W) float32,
        row 0 at the top; emission in photons s-1 m-2 sr-1.
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
    tree, notes = _medium(scene, stages, cache or default_cache())
    settings = settings_for(scene)
    result = trace(tree, scene, device, settings, report=progress)
    reference = trace(_nothing(tree.frame), scene, device, settings).weights
    for name in ("compile", "scattering", "image"):
        note = "" if name in result.seconds else "left out: nothing scatters"
        if name == "scattering" and result.solution is not None:
            note = f"{result.counts['sweeps']} sweeps; {result.solution.passes} passes"
        stages.done.append(Stage(name, result.seconds.get(name, 0.0), note))
    with stages.stage("evaluation"):
        sensor = _sensor(scene, (result.weights, reference))
        maps = _evaluate(scene, result.weights, reference, sensor)
    run = Run(
        scene=scene,
        weights=result.weights,
        reference=reference,
        maps=maps,
        info=_info(scene, device, result, maps, stages, notes, sensor.integration_time_s),
        folder=folder,
    )
    if folder is not None:
        _save(run, folder)
    return run


def _medium(scene: Scene, stages: _Stages, cache: Path) -> tuple[Octree, dict[str, float]]:
    with stages.stage("spray") as note:
        spray = make_spray(scene.spray, cache=cache)
        note.append(scene.spray.model)
        stages.remark(spray.remarks)
    with stages.stage("optics"):
        points, cells = emitters(spray, scene.optics, cache=cache)
    domain = scene.domain
    frame = Frame.around(
        centre_m=domain.centre_m, edge_m=domain.edge_m, leaf_edge_m=domain.leaf_edge_m
    )
    with stages.stage("octree") as note:
        tree = build_octree(frame, points, cells, optical_depth_split=domain.optical_depth_split)
        note.append(f"{sum(tree.leaves)} leaves, finest {frame.cell_m * 1e3:.3g} mm")
    return tree, dict(spray.notes)


def _nothing(frame: Frame) -> Octree:
    """The same cube without a spray."""
    return build_octree(frame, None, [], optical_depth_split=1.0)


def _sensor(scene: Scene, seen: tuple[Weights, ...]) -> SensorModel:
    """The scene's sensor, set so that its hottest background does not saturate it."""
    sensor = SensorModel.from_scene(scene)
    if scene.camera.sensor.integration_time_s is not None:
        return sensor
    filter_um = scene.optics.filter_um
    wall = float(band_radiance(scene.walls.temperature_K, filter_um=filter_um))
    hottest = max(scene.background.temperatures_K)
    leaves = background_radiance(
        blackbody=float(band_radiance(hottest, filter_um=filter_um)),
        wall=wall,
        emissivity=scene.background.emissivity,
    )
    images = [compose(weights, background=leaves, wall=wall) for weights in seen]
    return sensor.exposed_for(max(float(image.max()) for image in images))


def _evaluate(scene: Scene, weights: Weights, reference: Weights, sensor: SensorModel) -> Maps:
    return evaluate_radiance(
        weights,
        reference,
        background_temperatures_K=scene.background.temperatures_K,
        background_emissivity=scene.background.emissivity,
        wall_temperature_K=scene.walls.temperature_K,
        filter_um=scene.optics.filter_um,
        sensor=sensor,
        shots=scene.plan.shots,
        references=scene.plan.references,
    )


def _info(
    scene: Scene,
    device: Device,
    result: Trace,
    maps: Maps,
    stages: _Stages,
    notes: dict[str, float],
    integration_time_s: float,
) -> RunInfo:
    accuracy = None
    if result.weights_difference is not None:
        # The two pictures share the source that was solved for; measured on `gdi` (see
        # settings_for), what that hides adds about 30 % to their difference.
        accuracy = 1.3 * temperature_error_K(
            maps,
            result.weights_difference,
            wall_temperature_K=scene.walls.temperature_K,
            filter_um=scene.optics.filter_um,
        )
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
        defines={program.name: dict(program.defines) for program in result.programs},
        precision=result.precision,
        remarks=tuple(stages.remarks),
        integration_time_s=integration_time_s,
        versions=versions,
    )


def _save(run: Run, folder: Path) -> None:
    """Writes the run; run.json comes last, so that a folder with it is whole."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.yaml").write_text(dump_scene(run.scene), encoding="utf-8")
    run.weights.save(folder / "weights", pixel_m=run.pixel_m)
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
    try:
        info = RunInfo.from_json((folder / "run.json").read_text(encoding="utf-8"))
    except (ValueError, TypeError, KeyError) as error:
        raise RunFolderError(f"{folder / 'run.json'}: is damaged ({error})") from error
    return Run(
        scene=scene,
        weights=Weights.load(folder / "weights"),
        reference=Weights.load(folder / "weights_reference"),
        maps=Maps.load(folder / "maps"),
        info=info,
        measured=Maps.load(measured) if measured.is_dir() else None,
        folder=folder,
    )


def with_stages(run: Run, stages: list[Stage], measured: Maps) -> Run:
    """The run with an acquisition's maps and stages added."""
    info = replace(run.info, stages=(*run.info.stages, *stages))
    return replace(run, info=info, measured=measured)
