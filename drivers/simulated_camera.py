"""Simulated infrared camera in front of the bench."""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from cldit.camera.sensor import SensorModel
from cldit.rig.checks import check_exposure, check_format, check_roi, check_trigger
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, MissingFrames
from cldit.rig.protocols import (
    Capabilities,
    Frame,
    Roi,
    Settings,
    TriggerInfo,
    TriggerMode,
)
from cldit.scene.checks import Section, Within

from .simulated_scene import Pulse, SimulatedDevice, SimulatedScene, bench_of

_LIMITS_S = (320e-9, 1.0)
_FRAME_RATE_Hz = 146.7  # full frame of a typical 640 x 512 InSb camera
_FORMAT = "Mono16"
_MODES = frozenset({TriggerMode.INTERNAL, TriggerMode.SOFTWARE, TriggerMode.EXTERNAL_EDGE})


ABOUT = DriverAbout("camera", "an InSb camera", "simulated")


class CameraSettings(Section):
    """Faults of the camera, whose properties are in the scene of the bench."""

    drop: Annotated[float, Within(0.0, 1.0)] = 0.0  # fraction of the frames that never arrive
    incomplete: Annotated[float, Within(0.0, 1.0)] = 0.0  # fraction that arrives with lines missing
    unplug_after: Annotated[int, Within(0, 10**9)] | None = None  # frames before it is unplugged


class SimulatedCamera(SimulatedDevice):
    """Implements `cldit.rig.protocols.Camera`."""

    def __init__(
        self, settings: CameraSettings, context: RigContext, bench: SimulatedScene
    ) -> None:
        super().__init__("camera", "camera", settings.unplug_after)
        self._faults = settings
        self._torn: set[int] = set()
        self._clock = context.clock
        self._bench = bench
        self._model: SensorModel | None = None
        self._settings: Settings | None = None
        self._trigger: TriggerInfo | None = None
        self._armed, self._told = False, "not armed"
        self._taken = 0  # since armed
        self._frame_id = -1
        self._last_s = -np.inf
        self._buffer: deque[tuple[int, Pulse]] = deque()
        self._counts = {"delivered": 0, "missed": 0, "flushed": 0}
        bench.attach_camera(self)

    @property
    def capabilities(self) -> Capabilities:
        model = self._connected()
        columns, rows = self._bench.scene.camera.sensor.pixels
        return Capabilities(
            trigger_modes=_MODES,
            integration_time_limits_s=_LIMITS_S,
            minimum_period_s=1.0 / _FRAME_RATE_Hz,
            saturation_counts=int(model.calibration().saturation_counts),
            sensor_pixels=(columns, rows),
            pixel_formats=(_FORMAT,),
        )

    def _open(self, timeout_s: float) -> None:
        self._bench.open()
        self._model = SensorModel.from_scene(self._bench.scene)
        self.configure(self._model.integration_time_s)

    def _drop(self) -> None:
        self._armed = False
        self._model = None

    def _write_safe(self) -> None:
        self.disarm()
        self._buffer.clear()

    def _check_safe(self) -> str:
        return "disarmed"

    def _last_known(self) -> str:
        return self._told

    def read_configuration(self) -> dict[str, Any]:
        model = self._connected()
        settings = self._ready()
        return {
            "integration_time_s": settings.integration_time_s,
            "roi": [settings.roi.x, settings.roi.y, settings.roi.width, settings.roi.height],
            "pixel_format": settings.pixel_format,
            "calibration": model.calibration().to_dict(),
            "bad_pixels": self._bad_pixels(),
        }

    def _bad_pixels(self) -> list[list[int]]:
        """Row and column, in the region of interest, of the bad pixels."""
        roi = self._ready().roi
        bad = self._connected().bad_pixels()
        inside = bad[roi.y : roi.y + roi.height, roi.x : roi.x + roi.width]
        return [[int(row), int(column)] for row, column in np.argwhere(inside)]

    def wait_ready(self, timeout_s: float) -> None:
        self._connected()

    def configure(
        self, integration_time_s: float, roi: Roi | None = None, pixel_format: str | None = None
    ) -> Settings:
        self._connected()
        if self._armed:
            raise ConfigRejected("camera: is armed; disarm() before configure()")
        can = self.capabilities
        check_exposure(can, integration_time_s)
        check_format(can, pixel_format)
        part = check_roi(can, roi)
        self._model = SensorModel.from_scene(
            self._bench.scene, integration_time_s=integration_time_s
        )
        self._settings = Settings(integration_time_s, part, _FORMAT)
        return self._settings

    def prepare(self, trigger: TriggerInfo) -> None:
        self._connected()
        check_trigger(_MODES, trigger)
        self._trigger = trigger

    def arm(self) -> None:
        self._connected()
        if self._trigger is None:
            raise ConfigRejected("camera: prepare() before arm()")
        self._armed, self._told, self._taken = True, "armed", 0
        if self._trigger.mode is TriggerMode.INTERNAL:
            start_s = max(self._clock.now_s(), self._last_s + 1.0 / _FRAME_RATE_Hz)
            for index in range(self._trigger.n_frames):
                self._take(Pulse(start_s + index / _FRAME_RATE_Hz, False, -1))

    def flush(self) -> int:
        self._connected()
        thrown = len(self._buffer)
        self._buffer.clear()
        self._counts["flushed"] += thrown
        return thrown

    def software_trigger(self) -> None:
        self._connected()
        if not self._armed or self._trigger is None or self._trigger.mode != TriggerMode.SOFTWARE:
            raise ConfigRejected("camera: prepare(SOFTWARE) and arm() before software_trigger()")
        start_s = max(self._clock.now_s(), self._last_s + 1.0 / _FRAME_RATE_Hz)
        self._take(Pulse(start_s, False, -1))

    def read_frames(self, n: int, timeout_s: float) -> Iterator[Frame]:
        self._connected()
        for received in range(n):
            wait_s = self._buffer[0][1].time_s - self._clock.now_s() if self._buffer else np.inf
            if wait_s > timeout_s:
                self._clock.sleep(timeout_s)
                raise MissingFrames(n, received)
            self._clock.sleep(max(wait_s, 0.0))
            frame_id, pulse = self._buffer.popleft()
            self._counts["delivered"] += 1
            yield self._expose(frame_id, pulse)

    def disarm(self) -> None:
        self._connected()
        self._armed, self._told = False, "not armed"

    def statistics(self) -> dict[str, int]:
        return dict(self._counts)

    def forget(self, after_s: float) -> None:
        """Removes the triggers after this time."""
        kept = [entry for entry in self._buffer if entry[1].time_s <= after_s]
        self._frame_id -= len(self._buffer) - len(kept)
        self._buffer = deque(kept)

    def hear(self, pulse: Pulse) -> None:
        """Accepts an edge of the external line if armed, with frames left."""
        external = self._trigger is not None and self._trigger.mode == TriggerMode.EXTERNAL_EDGE
        if self._armed and external and self._trigger is not None:
            for number in range(self._trigger.frames_per_trigger):
                self._take(replace(pulse, time_s=pulse.time_s + number / _FRAME_RATE_Hz))
        else:
            self._counts["missed"] += 1

    def _take(self, pulse: Pulse) -> None:
        assert self._trigger is not None
        # Rounding errors of the clock must not lose a frame.
        soon = pulse.time_s - self._last_s < (1.0 - 1e-6) / _FRAME_RATE_Hz
        if soon or self._taken >= self._trigger.n_frames:
            self._counts["missed"] += 1
            return
        self._taken += 1
        self._frame_id += 1
        self._last_s = pulse.time_s
        chance = float(self._bench.random(pulse.time_s, 4).random())
        if chance < self._faults.drop:
            return
        if chance < self._faults.drop + self._faults.incomplete:
            self._torn.add(self._frame_id)
        self._buffer.append((self._frame_id, pulse))

    def _expose(self, frame_id: int, pulse: Pulse) -> Frame:
        model, part = self._connected(), self._ready().roi
        random = self._bench.random(pulse.time_s, 3, frame_id)
        counts = model.expose(self._bench.radiance(pulse), random)
        since_s = pulse.time_s - self._clock.now_s()
        self._used += 1
        data = counts[part.y : part.y + part.height, part.x : part.x + part.width]
        torn = frame_id in self._torn
        if torn:
            data[len(data) // 2 :] = 0
        return Frame(
            data=data,
            frame_id=frame_id,
            device_timestamp_ns=round(pulse.time_s * 1e9),
            host_timestamp_ns=round((self._clock.epoch_s() + since_s) * 1e9),
            complete=not torn,
        )

    def _connected(self) -> SensorModel:
        self._check()
        assert self._model is not None  # connect() makes it
        return self._model

    def _ready(self) -> Settings:
        assert self._settings is not None  # connect() configures
        return self._settings


def open_camera(settings: dict[str, Any], context: RigContext) -> SimulatedCamera:
    """The driver `simulated_camera`."""
    return SimulatedCamera(check_settings(CameraSettings, settings), context, bench_of(context))
