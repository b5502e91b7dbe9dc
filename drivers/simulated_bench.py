"""What stands between the simulated instruments: the traced scene, and the trigger line.

The bench holds no random state: what a shot looks like depends on the seed and on when it is
fired, so that a sequence that is killed and resumed never shows the same noise twice.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.camera.view import SensorView
from cldit.errors import RunFolderError, SceneError
from cldit.optics.planck import band_radiance
from cldit.radiance.weights import Weights, background_radiance, compose
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.scene import Scene, load_scene
from cldit.scene.checks import Section

ABOUT = DriverAbout(
    "bench",
    "what the simulated instruments look at",
    "simulated",
)


class BenchSettings(Section):
    run: Path  # folder with scene.yaml, weights/ and weights_reference/


@dataclass(frozen=True)
class Pulse:
    """One edge on the camera's trigger line, and whether fuel was in the air at that moment."""

    time_s: float
    injected: bool
    number: int


class Listener(Protocol):
    """What hangs on the trigger line."""

    def hear(self, pulse: Pulse) -> None: ...

    def forget(self, after_s: float) -> None: ...


class SimulatedBench:
    """Shared by the simulated devices of one rig."""

    def __init__(self, settings: BenchSettings, context: RigContext) -> None:
        self._run = context.folder / settings.run
        self._clock = context.clock
        self._seed = context.seed
        self._lock = threading.Lock()
        self._loaded: _Loaded | None = None
        self._cameras: list[Listener] = []
        self._temperature: Callable[[float], float] | None = None

    def open(self) -> None:
        """Reads the run; the first device that connects pays for it.

        Raises:
            RunFolderError, SceneError: the run is incomplete or damaged.
        """
        with self._lock:
            if self._loaded is None:
                self._loaded = _Loaded.read(self._run)

    @property
    def scene(self) -> Scene:
        return self._opened.scene

    @property
    def _opened(self) -> _Loaded:
        self.open()
        assert self._loaded is not None
        return self._loaded

    def attach_blackbody(self, temperature_K: Callable[[float], float]) -> None:
        """`temperature_K(time_s)` is asked at each exposure."""
        self._temperature = temperature_K

    def attach_camera(self, camera: Listener) -> None:
        """`camera` hears every pulse."""
        self._cameras.append(camera)

    def pulse(self, pulse: Pulse) -> None:
        """An edge on the trigger line, now or soon."""
        for camera in self._cameras:
            camera.hear(pulse)

    def cancel(self, *, after_s: float) -> None:
        """Edges after this time never come."""
        for camera in self._cameras:
            camera.forget(after_s)

    def random(self, time_s: float, *stream: int) -> np.random.Generator:
        """A generator of its own for what happens at `time_s`."""
        since_s = time_s - self._clock.now_s()
        microseconds = round((self._clock.epoch_s() + since_s) * 1e6)
        return np.random.default_rng([self._seed, microseconds, *stream])

    def radiance(self, pulse: Pulse) -> NDArray[np.float64]:
        """Photon radiance on the sensor (h, w) at the pulse, photons s-1 m-2 sr-1."""
        here = self._opened
        scene = here.scene
        background_K = scene.rig.background_start_K
        if self._temperature is not None:
            background_K = self._temperature(pulse.time_s)
        blackbody, wall = (
            float(band_radiance(temperature, filter_um=scene.optics.filter_um))
            for temperature in (background_K, scene.walls.temperature_K)
        )
        leaving = background_radiance(
            blackbody=blackbody, wall=wall, emissivity=scene.background.emissivity
        )
        weights = here.reference
        if pulse.injected:
            weights = here.shot(self.random(pulse.time_s, 1, pulse.number))
        return np.maximum(compose(weights, background=leaving, wall=wall), 0.0)


@dataclass(frozen=True)
class _Loaded:
    """A run on the sensor's pixels: weights with spray and without, and the spray's thickness."""

    scene: Scene
    spray: Weights
    reference: Weights
    transmission: NDArray[np.float64]
    pixel_m: tuple[float, float]

    @classmethod
    def read(cls, run: Path) -> _Loaded:
        path = run / "scene.yaml"
        if not path.is_file():
            raise RunFolderError(f"{run}: holds no scene.yaml; give the folder of a finished run")
        scene = load_scene(path)
        view = SensorView.from_scene(scene)
        spray = _on_sensor(run / "weights", scene, view)
        reference = _on_sensor(run / "weights_reference", scene, view)
        # Transmission is read off the boundary that fills most of the pixel.
        disc = reference.background >= reference.wall
        seen = np.where(disc, reference.background, reference.wall)
        through = np.where(disc, spray.background, spray.wall)
        safe = np.where(seen > 0.0, seen, 1.0)
        transmission = np.where(seen > 0.0, np.maximum(through, 0.0) / safe, 1.0)
        width, height = view.pixel_m
        return cls(scene, spray, reference, transmission, (width, height))

    def shot(self, rng: np.random.Generator) -> Weights:
        """Weights of one injection, whose optical depth is g times the traced one.

        With r the traced transmission, each weight becomes w_ref + s (w - w_ref) with
        s = (1 - r^g) / (1 - r): the background's is then w_ref r^g, and because one factor goes
        for all weights, a cavity at one temperature stays flat.
        """
        rig = self.scene.rig
        if rig.shot_scatter == 0.0:
            return self.spray
        shape = self.transmission.shape
        g = _scatter(
            rng,
            shape,
            sigma=rig.shot_scatter,
            length_m=rig.shot_scatter_length_m,
            pixel_m=self.pixel_m,
        )
        missing = 1.0 - self.transmission
        thin = np.abs(missing) < 1e-6  # there s -> g
        scale = np.where(thin, g, (1.0 - self.transmission**g) / np.where(thin, 1.0, missing))
        changed: dict[str, Any] = {}
        for item in fields(Weights):
            bare, spray = getattr(self.reference, item.name), getattr(self.spray, item.name)
            changed[item.name] = (bare + scale * (spray - bare)).astype(np.float32)
        return Weights(**changed)


def _on_sensor(folder: Path, scene: Scene, view: SensorView) -> Weights:
    traced = Weights.load(folder)
    columns, rows = scene.camera.pixels
    images: dict[str, Any] = {}
    for item in fields(Weights):
        image = getattr(traced, item.name)
        path = folder / f"{item.name}.tif"
        if image.shape != (rows, columns):
            raise RunFolderError(
                f"{path}: shape {image.shape}, but camera.pixels of the scene asks for "
                f"{(rows, columns)}; trace the run again"
            )
        if not np.all(np.isfinite(image)):
            raise RunFolderError(f"{path}: holds values that are not finite; trace the run again")
        images[item.name] = view.image(image).astype(np.float32)
    return Weights(**images)


def _scatter(
    rng: np.random.Generator,
    shape: tuple[int, ...],
    *,
    sigma: float,
    length_m: float,
    pixel_m: tuple[float, float],
) -> NDArray[np.float64]:
    """Lognormal field of mean 1: a smooth part correlated as exp(-(r/length)^2), and a global one.

    White noise is filtered in Fourier space, where exp(-(r/L)^2) belongs to the amplitude
    exp(-(pi L f)^2 / 2).
    """
    rows, columns = shape
    fx = np.fft.rfftfreq(columns, pixel_m[0])
    fy = np.fft.fftfreq(rows, pixel_m[1])
    amplitude = np.exp(-((np.pi * length_m) ** 2) * (fx[None, :] ** 2 + fy[:, None] ** 2) / 2.0)
    whole = np.full(len(fx), 2.0)  # rfft keeps one of each pair of columns
    whole[0] = 1.0
    if columns % 2 == 0:
        whole[-1] = 1.0
    variance = float(np.sum(amplitude**2 * whole)) / (rows * columns)
    white = np.fft.rfft2(rng.standard_normal((rows, columns)))
    smooth = np.fft.irfft2(white * amplitude, s=(rows, columns)) / np.sqrt(variance)
    exponent = sigma * (smooth + rng.standard_normal()) - sigma**2
    return np.asarray(np.exp(exponent))


def bench_of(context: RigContext) -> SimulatedBench:
    """The bench of a rig with simulated devices.

    Raises:
        SceneError: the rig has none.
    """
    if not isinstance(context.bench, SimulatedBench):
        raise SceneError(
            "bench: is missing; simulated devices need `bench: {driver: simulated_bench, "
            "settings: {run: FOLDER}}` in the rig file"
        )
    return context.bench


def open_bench(settings: dict[str, Any], context: RigContext) -> SimulatedBench:
    """The driver `simulated_bench`."""
    return SimulatedBench(check_settings(BenchSettings, settings), context)
