"""Simulated optical bench, shared by the simulated instruments: traced scene and trigger line.

The bench has no random state: a shot depends on the seed and on its time, so that a sequence that
is killed and resumed never has the same noise twice.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cldit.arrays import Floats
from cldit.camera.sensor import SensorModel
from cldit.camera.view import SensorView
from cldit.errors import RunFolderError, SceneError
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance
from cldit.radiance.weights import Weights
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import NotConnected
from cldit.rig.link import Linked
from cldit.rig.protocols import DeviceInfo, FilterName, SpectralFilter
from cldit.run.ensemble import member_folder
from cldit.run.stored_files import node_folders
from cldit.scene import Scene, load_scene
from cldit.scene.checks import Section, Within
from cldit.scene.delays import SAME_s, delay_text, spray_time_s
from cldit.scene.scatter import members_of
from cldit.scene.vessel import Windows

_KEPT_MEMBERS = 64  # of 5 MB each on a sensor of 640 x 512

ABOUT = DriverAbout("bench", "the scene of the simulated instruments", "simulated")


class SceneSettings(Section):
    run: Path  # folder with scene.yaml, weights/ and weights_reference/, and members/ of several
    runs: tuple[Path, ...] = ()  # of the same scene at other times of the spray
    # Behind each filter of a wheel, runs of the same scene with other `optics`, in place of these.
    filters: dict[FilterName, Annotated[tuple[Path, ...], Field(min_length=1)]] = Field(
        default_factory=dict
    )
    shot_scatter: Annotated[float, Within(0.0, 5.0)] | None = None  # None: the scene's
    windows: Windows | None = None  # in front of the camera; None: the scene's


@dataclass(frozen=True)
class Pulse:
    """One edge on the camera's trigger line; `injected` is True if fuel was in the air then.

    after_injection_s: time since the injector's pulse of this shot. injection: number of
    injections before it.
    """

    time_s: float
    injected: bool
    number: int
    after_injection_s: float = 0.0
    injection: int = 0


class Listener(Protocol):
    """A device on the trigger line."""

    def hear(self, pulse: Pulse) -> None: ...

    def forget(self, after_s: float) -> None: ...


class SimulatedScene:
    """Simulated optical bench of one rig."""

    def __init__(self, settings: SceneSettings, context: RigContext) -> None:
        self._runs = [
            [context.folder / run for run in runs]
            for runs in ((settings.run, *settings.runs), *settings.filters.values())
        ]  # without a wheel, then behind each filter
        self._settings = settings
        self._clock = context.clock
        self._seed = context.seed
        self._lock = threading.Lock()
        self._loaded: tuple[tuple[_Loaded, ...], ...] = ()  # as `_runs`
        self._cameras: list[Listener] = []
        self._temperature: Callable[[float], float] | None = None
        self._wheel: Callable[[float], int | None] | None = None
        self._first_member = int(self.random(context.clock.now_s(), 6).integers(2**31))
        self._member = lru_cache(maxsize=_KEPT_MEMBERS)(self._read_member)

    def _read_member(self, behind: int, place: int, number: int) -> "_Loaded":
        return _Loaded.read(member_folder(self._runs[behind][place], number), self._settings)

    def open(self) -> None:
        """Reads the runs, when the first device connects.

        Raises RunFolderError, SceneError if a run is damaged, or not one of the same scene.
        """
        with self._lock:
            if not self._loaded:
                loaded = tuple(
                    tuple(_Loaded.read(run, self._settings) for run in runs) for runs in self._runs
                )
                for runs, loaded_runs in zip(self._runs, loaded, strict=True):
                    _check_times(runs, [run_data.scene for run_data in loaded_runs])
                for name, behind in zip(self._settings.filters, loaded[1:], strict=True):
                    _check_filter(name, behind, loaded[0])
                self._loaded = loaded

    @property
    def scene(self) -> Scene:
        return self._opened[0].scene

    @property
    def filters(self) -> tuple[SpectralFilter, ...]:
        """Filters of a wheel, with the camera's calibration."""
        self.open()
        behind = zip(self._settings.filters, self._loaded[1:], strict=True)
        return tuple(
            _spectral_filter(number, name, runs[0].scene)
            for number, (name, runs) in enumerate(behind, 1)
        )

    @property
    def spray_times_s(self) -> tuple[float, ...]:
        """Times of the runs after the start of injection; none for sprays without a time."""
        times = (spray_time_s(run.scene) for run in self._opened)
        return tuple(time_s for time_s in times if time_s is not None)

    @property
    def _opened(self) -> "tuple[_Loaded, ...]":
        self.open()
        return self._loaded[0]

    def _at(self, pulse: Pulse, behind: int) -> "_Loaded":
        """The run of the spray nearest in time; of several injections, the one of this pulse.

        Each session begins with another member, as it depends on the time of opening.
        """
        self.open()
        place = 0
        runs = self._loaded[behind]
        if len(runs) > 1:
            times_s = [spray_time_s(run.scene) or 0.0 for run in runs]
            off_s = [abs(time_s - pulse.after_injection_s) for time_s in times_s]
            place = off_s.index(min(off_s))
        nearest = runs[place]
        members = members_of(nearest.scene)
        if members == 1 or not pulse.injected:
            return nearest
        return self._member(behind, place, 1 + (self._first_member + pulse.injection) % members)

    def attach_blackbody(self, temperature_K: Callable[[float], float]) -> None:
        """Connects the black body, whose temperature is read at each exposure."""
        self._temperature = temperature_K

    def attach_wheel(self, place: Callable[[float], int | None]) -> None:
        """Connects a filter wheel: index of its filter at a time, None while it moves. Raises
        SceneError if there are no filters."""
        if not self._settings.filters:
            raise SceneError(
                "bench: filters: is missing; a simulated wheel needs the run folders behind each "
                "of its filters in the settings of the bench: `filters: {NAME: [FOLDER], ..}`"
            )
        self._wheel = place

    def attach_camera(self, camera: Listener) -> None:
        """Connects a camera to the trigger line."""
        self._cameras.append(camera)

    def pulse(self, pulse: Pulse) -> None:
        """Sends an edge on the trigger line, now or soon."""
        for camera in self._cameras:
            camera.hear(pulse)

    def cancel(self, *, after_s: float) -> None:
        """Cancels the edges after this time."""
        for camera in self._cameras:
            camera.forget(after_s)

    def random(self, time_s: float, *stream: int) -> np.random.Generator:
        """Random generator for the events of a time."""
        since_s = time_s - self._clock.now_s()
        microseconds = round((self._clock.epoch_s() + since_s) * 1e6)
        return np.random.default_rng([self._seed, microseconds, *stream])

    def radiance(self, pulse: Pulse) -> Floats:
        """Photon radiance on the sensor (h, w) at the pulse, photons s-1 m-2 sr-1."""
        place = -1 if self._wheel is None else self._wheel(pulse.time_s)
        run = self._at(pulse, 0 if place is None else place + 1)
        if place is None:  # the wheel's rim, too cold to be seen
            return np.zeros_like(run.reference.images["background"], np.float64)
        background_K = run.scene.rig.background_start_K
        if self._temperature is not None:
            background_K = self._temperature(pulse.time_s)
        weights: Sequence[Weights] = [run.reference] * len(run.boundaries)
        if pulse.injected:
            weights = run.shot(self.random(pulse.time_s, 1, pulse.number))
        seen = camera_radiance(weights, run.boundaries, background_K=background_K)
        return np.maximum(seen, 0.0)


@dataclass(frozen=True)
class _Loaded:
    """A run on the sensor's pixels: weights with spray, of each spectral node, and without.

    transmission: of the spray, in each node.
    """

    scene: Scene
    boundaries: tuple[Boundary, ...]
    spray: tuple[Weights, ...]
    reference: Weights
    transmission: tuple[Floats, ...]
    pixel_m: tuple[float, float]

    @classmethod
    def read(cls, run: Path, settings: SceneSettings) -> "_Loaded":
        path = run / "scene.yaml"
        if not path.is_file():
            raise RunFolderError(f"{run}: holds no scene.yaml; give the folder of a finished run")
        scene = _changed_scene(load_scene(path), settings)
        view = SensorView.from_scene(scene)
        grey = Quadrature.grey(
            scene_filter(scene),
            reference_K=reference_temperature_K(scene.background.temperatures_K),
        )
        quadrature, folders = node_folders(run / "weights", grey)
        spray = tuple(_on_sensor(folder, scene, view) for folder in folders)
        reference = _on_sensor(run / "weights_reference", scene, view)
        surroundings = Surroundings.from_scene(scene)
        return cls(
            scene=scene,
            boundaries=tuple(
                Boundary.of(surroundings, node.radiance, node.pane) for node in quadrature.nodes
            ),
            spray=spray,
            reference=reference,
            transmission=tuple(_transmission(weights, reference) for weights in spray),
            pixel_m=view.pixel_m,
        )

    def shot(self, rng: np.random.Generator) -> Sequence[Weights]:
        """Weights of one injection, whose optical depth is g times the traced one.

        With r the traced transmission, each weight becomes w_ref + s (w - w_ref) with
        s = (1 - r^g) / (1 - r): the background's is then w_ref r^g, and because all weights have
        one factor, a cavity at one temperature stays flat. g is the same in all nodes.
        """
        scatter = self.scene.spray.scatter
        if scatter.optical_depth == 0.0:
            return self.spray
        g = _scatter(
            rng,
            self.transmission[0].shape,
            sigma=scatter.optical_depth,
            length_m=scatter.length_m,
            pixel_m=self.pixel_m,
        )
        return [
            self._changed(spray, transmission, g)
            for spray, transmission in zip(self.spray, self.transmission, strict=True)
        ]

    def _changed(self, spray: Weights, transmission: Floats, g: Floats) -> Weights:
        missing = 1.0 - transmission
        thin = np.abs(missing) < 1e-6  # there s -> g
        scale = np.where(thin, g, (1.0 - transmission**g) / np.where(thin, 1.0, missing))
        bare = self.reference.images
        return Weights.of(
            {
                name: (bare[name] + scale * (image - bare[name])).astype(np.float32)
                for name, image in spray.images.items()
            }
        )


def _check_times(runs: Sequence[Path], scenes: Sequence[Scene]) -> None:
    common = scenes[0].model_dump(exclude=_OF_A_TIME)
    times_s: list[float] = []
    for run, scene in zip(runs, scenes, strict=True):
        time_s = spray_time_s(scene)
        if len(scenes) > 1 and time_s is None:
            raise SceneError(f"bench: runs: {run}: its spray has no time_s; give one `run` alone")
        if scene.model_dump(exclude=_OF_A_TIME) != common:
            raise SceneError(f"bench: runs: {run}: differs from {runs[0]} in more than its spray")
        if time_s is not None and any(abs(time_s - earlier_s) < SAME_s for earlier_s in times_s):
            raise SceneError(f"bench: runs: {run}: another run is at {delay_text(time_s)} too")
        times_s += [] if time_s is None else [time_s]


def _spectral_filter(position: int, name: str, scene: Scene) -> SpectralFilter:
    """The filter of a scene, with its camera's calibration."""
    model = SensorModel.from_scene(scene)
    stated = model.calibration().to_dict()
    return SpectralFilter(
        position=position,
        name=name,
        filter_um=stated["filter_um"],
        integration_time_s=model.integration_time_s,
        counts_per_radiance=stated["counts_per_radiance"],
    )


def _check_filter(name: str, runs: Sequence["_Loaded"], plain: Sequence["_Loaded"]) -> None:
    """Raises SceneError unless the runs behind a filter are those without a wheel but for the
    optics: only their filter may differ."""

    def scenes(part: Sequence["_Loaded"]) -> list[dict[str, Any]]:
        timed = sorted((run.scene for run in part), key=lambda scene: spray_time_s(scene) or 0.0)
        return [scene.model_dump(exclude=_OF_A_FILTER) for scene in timed]

    if scenes(runs) != scenes(plain):
        raise SceneError(
            f"bench: filters: {name}: its runs differ from `run` and `runs` in more than `optics` "
            "and `transport`; allowed: the same scene at the same times behind another filter"
        )


_OF_A_TIME = {"name": True, "spray": True, "plan": True}
_OF_A_FILTER = {"name", "optics", "transport", "plan"}


def _changed_scene(scene: Scene, settings: SceneSettings) -> Scene:
    """The traced scene with the rig file's injector and windows, which do not affect a trace."""
    spray = scene.spray
    if settings.shot_scatter is not None:
        scatter = spray.scatter.model_copy(update={"optical_depth": settings.shot_scatter})
        spray = spray.model_copy(update={"scatter": scatter})
    windows = scene.windows if settings.windows is None else settings.windows
    return scene.model_copy(update={"spray": spray, "windows": windows})


def _transmission(spray: Weights, reference: Weights) -> Floats:
    """Transmission of the boundary that fills most of each pixel."""
    names = ("background", "wall", *reference.patches)
    bare = np.stack([reference.images[name] for name in names])
    largest = np.argmax(bare, axis=0)[None]
    seen = np.take_along_axis(bare, largest, axis=0)[0]
    images = np.stack([spray.images[name] for name in names])
    through = np.take_along_axis(images, largest, axis=0)[0]
    safe = np.where(seen > 0.0, seen, 1.0)
    return np.where(seen > 0.0, np.maximum(through, 0.0) / safe, 1.0)


def _on_sensor(folder: Path, scene: Scene, view: SensorView) -> Weights:
    traced = Weights.load(folder, patches=[patch.name for patch in scene.patches])
    columns, rows = scene.camera.pixels
    images: dict[str, NDArray[np.float32]] = {}
    for name, image in traced.images.items():
        path = folder / f"{name}.tif"
        if image.shape != (rows, columns):
            raise RunFolderError(
                f"{path}: shape {image.shape}, but camera.pixels of the scene is "
                f"{(rows, columns)}; trace the run again"
            )
        if not np.all(np.isfinite(image)):
            raise RunFolderError(
                f"{path}: contains values that are not finite; trace the run again"
            )
        images[name] = view.image(image).astype(np.float32)
    return Weights.of(images)


def _scatter(
    rng: np.random.Generator,
    shape: tuple[int, ...],
    *,
    sigma: float,
    length_m: float,
    pixel_m: tuple[float, float],
) -> Floats:
    """Lognormal field of mean 1: a smooth part correlated as exp(-(r/length)^2), and a global one.

    White noise is filtered in Fourier space, where exp(-(r/L)^2) has the amplitude
    exp(-(pi L f)^2 / 2).
    """
    rows, columns = shape
    fx = np.fft.rfftfreq(columns, pixel_m[0])
    fy = np.fft.fftfreq(rows, pixel_m[1])
    amplitude = np.exp(-((np.pi * length_m) ** 2) * (fx[None, :] ** 2 + fy[:, None] ** 2) / 2.0)
    multiplicity = np.full(len(fx), 2.0)  # rfft keeps one of each pair of columns
    multiplicity[0] = 1.0
    if columns % 2 == 0:
        multiplicity[-1] = 1.0
    variance = float(np.sum(amplitude**2 * multiplicity)) / (rows * columns)
    white = np.fft.rfft2(rng.standard_normal((rows, columns)))
    smooth = np.fft.irfft2(white * amplitude, s=(rows, columns)) / np.sqrt(variance)
    exponent = sigma * (smooth + rng.standard_normal()) - sigma**2
    return np.asarray(np.exp(exponent))


class SimulatedDevice(Linked):
    """A simulated instrument, which has no line, and is unplugged after `unplug_after` uses."""

    def __init__(self, kind: str, name: str, unplug_after: int | None) -> None:
        super().__init__(kind, f"simulated {name}", by_hand="remove `unplug_after`")
        self._unplug_after = unplug_after
        self._used = 0

    def _drop(self) -> None:
        """Does nothing, because there is no line."""

    def identify(self) -> DeviceInfo:
        return DeviceInfo(self._kind, "cldit", self._where, simulated=True)

    def _check(self) -> None:
        """Raises NotConnected if it is not connected, or unplugged."""
        with self._asking():
            if self._unplug_after is not None and self._used >= self._unplug_after:
                raise NotConnected(
                    f"{self._kind}: {self._where} was unplugged (its fault unplug_after)"
                )


def bench_of(context: RigContext) -> SimulatedScene:
    """The bench of a rig with simulated devices; raises SceneError if there is none."""
    if not isinstance(context.bench, SimulatedScene):
        raise SceneError(
            "bench: is missing; simulated devices need `bench: {driver: simulated_scene, "
            "settings: {run: FOLDER}}` in the rig file"
        )
    return context.bench


def open_bench(settings: dict[str, Any], context: RigContext) -> SimulatedScene:
    """The driver `simulated_scene`."""
    return SimulatedScene(check_settings(SceneSettings, settings), context)
