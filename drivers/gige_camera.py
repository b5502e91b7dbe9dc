"""GenICam cameras on GigE Vision, through viva-genicam.

Feature names: GenICam SFNC 2. The camera's radiometric calibration is not in any register, so the
rig file gives it; counts per radiance are taken as proportional to the integration time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from cldit.camera.calibration import Calibration
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, MissingFrames, NotConnected, OutOfLimits
from cldit.rig.protocols import (
    Capabilities,
    DeviceInfo,
    Frame,
    Roi,
    Settings,
    TriggerInfo,
    TriggerMode,
)
from cldit.scene.checks import Section, Within

from .genicam import Features

_SOURCES = {TriggerMode.SOFTWARE: "Software", TriggerMode.EXTERNAL_EDGE: ""}
_MODES = frozenset({TriggerMode.INTERNAL, *_SOURCES})
_EDGES = {"rising": "RisingEdge", "falling": "FallingEdge"}
_BLOCKS = 65535  # 16-bit block ids count 1..65535 and again
_DISCOVERY_s = 0.3
_IN_FLIGHT_s = 0.5  # a picture arrives this long after its exposure, or never


ABOUT = DriverAbout(
    "camera",
    "GenICam cameras on GigE Vision",
    "untested on hardware; tested with three simulated GigE Vision cameras, two of them not ours",
    needs=("viva_genicam",),
)


class CalibrationSection(Section):
    """As `cldit.camera.calibration.Calibration`, at this integration time."""

    integration_time_s: Annotated[float, Within(1e-9, 10.0)]
    filter_um: tuple[float, float]
    counts_per_radiance: float
    offset_counts: float
    electrons_per_count: float
    read_noise_electrons: float
    saturation_counts: Annotated[int, Within(1, 65535)]


class GigeSettings(Section):
    address: str  # IP address
    interface: str | None = None  # IP address of the computer's port to the camera
    calibration: CalibrationSection
    line: str = "Line1"  # the camera's trigger input
    pixel_format: str = "Mono16"
    maximum_rate_Hz: Annotated[float, Within(1e-3, 1e6)] | None = None  # what the camera says
    heartbeat_s: Annotated[float, Within(1.5, 60.0)] = 2.0  # after a crash it is free then
    packet_size: Annotated[int, Within(576, 9000)] | None = None  # what the camera has


class GigeCamera:
    """A `cldit.rig.protocols.Camera`."""

    tested_on_hardware = False

    def __init__(self, settings: GigeSettings, context: RigContext) -> None:
        self._settings = settings
        self._camera: Any = None
        self._features: Features | None = None
        self._stream: Any = None
        self._identity = ("?", "GigE Vision camera", "", "")
        self._trigger: TriggerInfo | None = None
        self._armed = False
        self._triggered = self._received = 0  # since armed
        self._last_trigger_s = -np.inf
        self._period_s = 0.0
        self._base = -1  # frame id = base + 1 + blocks since the start
        self._last_id = -1
        self._first_block: int | None = None  # of this start
        self._clock_offset_ns: int | None = None
        self._ns_per_tick = 1.0
        self._counts = {"delivered": 0, "missed": 0, "flushed": 0, "incomplete": 0}

    # Life

    def connect(self, timeout_s: float = 10.0) -> None:
        if self._camera is not None:
            return
        import viva_genicam as viva

        end_s = time.monotonic() + timeout_s
        while True:
            try:
                self._open(viva)
                return
            except (viva.GenicamError, NotConnected) as error:
                self.close()
                # After a crash the camera is held until the last heartbeat is old enough.
                if time.monotonic() + 0.2 >= end_s:
                    raise NotConnected(
                        f"camera: {self._settings.address} cannot be used ({error}); check its "
                        "power and address, and that no other program holds it"
                    ) from error
                time.sleep(0.2)

    def _open(self, viva: Any) -> None:
        wanted = self._settings
        loopback = wanted.address.startswith("127.")  # searched only beside all others
        found = viva.discover(
            timeout_ms=round(1e3 * _DISCOVERY_s),
            iface=None if loopback else wanted.interface,
            all=loopback,
        )
        here = [device for device in found if device.ip == wanted.address]
        if not here:
            others = ", ".join(f"{d.ip} ({d.model})" for d in found) or "none"
            raise NotConnected(f"no such camera on the network; found: {others}")
        self._camera = viva.connect_gige(here[0], iface=wanted.interface)
        self._features = Features(self._camera)
        if self._features.has("GevHeartbeatTimeout"):
            self._camera.set_integer("GevHeartbeatTimeout", round(1e3 * wanted.heartbeat_s))
        names = ("DeviceVendorName", "DeviceModelName", "DeviceSerialNumber", "DeviceVersion")
        maker, model, serial, firmware = (
            self._camera.get_string(name) if self._features.has(name) else "" for name in names
        )
        self._identity = (maker, model, serial, firmware)
        self._period_s = 1.0 / (wanted.maximum_rate_Hz or self._features.maximum_rate_Hz())
        self._ns_per_tick, self._clock_offset_ns = self._features.clock()
        self._camera.acquisition_stop()
        self._connected().choose("PixelFormat", wanted.pixel_format)
        self.configure(wanted.calibration.integration_time_s)

    def close(self) -> None:
        camera, stream, self._camera, self._stream = self._camera, self._stream, None, None
        self._features = None
        self._armed = False
        for item in (stream, camera):
            if item is not None:
                try:
                    item.close()
                except Exception:  # it is gone already
                    continue

    def identify(self) -> DeviceInfo:
        maker, model, serial, firmware = self._identity
        return DeviceInfo(
            "camera",
            maker,
            model,
            serial,
            firmware,
            tested_on_hardware=self.tested_on_hardware,
        )

    def read_configuration(self) -> dict[str, Any]:
        settings = self._read_settings()
        roi = settings.roi
        return {
            "address": self._settings.address,
            "line": self._settings.line,
            "integration_time_s": settings.integration_time_s,
            "roi": [roi.x, roi.y, roi.width, roi.height],
            "pixel_format": settings.pixel_format,
            "calibration": self._calibration(settings.integration_time_s).to_dict(),
        }

    def make_safe(self) -> None:
        if self._camera is not None:
            self.disarm()

    def wait_ready(self, timeout_s: float) -> None:
        """Nothing in the SFNC says that a cooler is ready: watch the camera's own display."""
        self._connected()

    # Settings

    @property
    def capabilities(self) -> Capabilities:
        low, high = self._connected().exposure_limits_s()
        return Capabilities(
            trigger_modes=_MODES,
            integration_time_limits_s=(low, high),
            minimum_period_s=self._period_s,
            saturation_counts=self._settings.calibration.saturation_counts,
            sensor_pixels=self._sensor(),
            pixel_formats=self._connected().entries("PixelFormat"),
        )

    def configure(
        self, integration_time_s: float, roi: Roi | None = None, pixel_format: str | None = None
    ) -> Settings:
        self._connected()
        if self._armed:
            raise ConfigRejected("camera: is armed; disarm() before configure()")
        low, high = self._connected().exposure_limits_s()
        if not low <= integration_time_s <= high:
            raise OutOfLimits(
                f"camera: integration_time_s: {integration_time_s:g} is outside {low:g}..{high:g}"
            )
        columns, rows = self._sensor()
        part = Roi(0, 0, columns, rows) if roi is None else roi
        inside = part.x >= 0 and part.y >= 0 and part.width > 0 and part.height > 0
        if not inside or part.x + part.width > columns or part.y + part.height > rows:
            raise OutOfLimits(f"camera: roi: {part} does not fit on {columns} x {rows}")
        if pixel_format is not None:
            allowed = self._connected().entries("PixelFormat")
            if pixel_format not in allowed:
                raise ConfigRejected(
                    f"camera: pixel_format: {pixel_format!r}; allowed are {', '.join(allowed)}"
                )
            self._connected().choose("PixelFormat", pixel_format)
        self._connected().expose(integration_time_s)
        for name, value in (
            ("OffsetX", 0),
            ("OffsetY", 0),
            ("Width", part.width),
            ("Height", part.height),
            ("OffsetX", part.x),
            ("OffsetY", part.y),
        ):
            self._connected().set_integer(name, value)
        return self._read_settings()

    def prepare(self, trigger: TriggerInfo) -> None:
        self._connected()
        if (
            trigger.mode not in _MODES
            or min(trigger.n_frames, trigger.frames_per_trigger) < 1
            or trigger.activation not in _EDGES
        ):
            raise ConfigRejected(
                f"camera: {trigger}; allowed are {', '.join(sorted(_MODES))}, n_frames >= 1, and "
                "rising or falling"
            )
        if self._armed:
            raise ConfigRejected("camera: is armed; disarm() before prepare()")
        features = self._connected()
        features.stop_after(trigger.n_frames)
        source = None
        if trigger.mode is not TriggerMode.INTERNAL:
            source = _SOURCES[trigger.mode] or self._settings.line
        features.trigger(source, _EDGES[trigger.activation], trigger.frames_per_trigger)
        self._trigger = trigger

    # Pictures

    def arm(self) -> None:
        if self._connected() is not None and self._trigger is None:
            raise ConfigRejected("camera: prepare() before arm()")
        self._open_stream()
        self._connected().ask(lambda c: c.acquisition_start())
        self._armed, self._triggered, self._received = True, 0, 0

    def _open_stream(self) -> None:
        """A new stream for each start: block ids then count from 1, which the client would take
        for a late packet of the last picture on a stream that goes on."""
        wanted = self._settings
        options = {} if wanted.packet_size is None else {"packet_size": wanted.packet_size}
        if self._stream is not None:
            self._stream.close()
        self._stream = self._connected().ask(
            lambda c: c.stream(iface=wanted.interface, deliver_incomplete=True, **options)
        )
        self._base, self._first_block = self._last_id, None

    def flush(self) -> int:
        self._connected()
        if self._stream is None:
            return 0
        software = self._trigger is not None and self._trigger.mode is TriggerMode.SOFTWARE
        thrown = 0
        while True:
            coming = software and self._received < self._triggered
            if self._next(_IN_FLIGHT_s if coming else 1e-3) is None:
                break
            thrown += 1
        self._triggered = self._received
        self._counts["flushed"] += thrown
        return thrown

    def software_trigger(self) -> None:
        self._connected()
        trigger = self._trigger
        if not self._armed or trigger is None or trigger.mode is not TriggerMode.SOFTWARE:
            raise ConfigRejected("camera: prepare(SOFTWARE) and arm() before software_trigger()")
        if self._triggered >= trigger.n_frames:
            self._counts["missed"] += 1
            return
        time.sleep(max(self._last_trigger_s + 1.05 * self._period_s - time.monotonic(), 0.0))
        self._last_trigger_s = time.monotonic()
        self._connected().ask(lambda c: c.trigger_software())
        self._triggered += 1

    def read_frames(self, n: int, timeout_s: float) -> Iterator[Frame]:
        self._connected()
        incomplete = 0
        for received in range(n):
            frame = self._next(timeout_s)
            if frame is None:
                raise MissingFrames(n, received - incomplete, incomplete)
            incomplete += not frame.complete
            self._counts["delivered" if frame.complete else "incomplete"] += 1
            yield frame

    def disarm(self) -> None:
        self._connected().ask(lambda c: c.acquisition_stop())
        self._armed = False

    def statistics(self) -> dict[str, int]:
        return dict(self._counts)

    def _next(self, timeout_s: float) -> Frame | None:
        """None where none comes in time."""
        import viva_genicam as viva

        if self._connected() is not None and self._stream is None:
            time.sleep(timeout_s)
            return None
        try:
            got = self._stream.next_frame(max(1, round(1e3 * timeout_s)))
        except viva.TransportError as error:
            if "timeout" in str(error):
                return None
            raise NotConnected(f"camera: the stream broke ({error})") from error
        if got is None:
            raise NotConnected("camera: the stream has ended; connect again")
        now_ns = time.time_ns()
        self._received += 1
        self._last_id = self._frame_id(int(got.block_id))
        ticks = int(got.ts_dev or 0)
        device_ns = round(ticks * self._ns_per_tick)
        data = np.asarray(got.to_numpy())
        return Frame(
            data=data.astype(np.uint16, copy=False),
            frame_id=self._last_id,
            device_timestamp_ns=device_ns,
            host_timestamp_ns=(
                now_ns if self._clock_offset_ns is None else device_ns + self._clock_offset_ns
            ),
            complete=bool(got.is_complete),
            meta={"missing_packets": got.missing_packets or 0},
        )

    def _frame_id(self, block: int) -> int:
        """Ids go on from start to start; block ids do so on some cameras only. A picture that is
        lost right after a start shows by its absence."""
        if self._first_block is None:
            self._first_block = block
        since = block - self._first_block
        return self._base + 1 + (since % _BLOCKS if block <= _BLOCKS else since)

    # The camera's features

    def _sensor(self) -> tuple[int, int]:
        features = self._connected()
        return features.integer("SensorWidth"), features.integer("SensorHeight")

    def _read_settings(self) -> Settings:
        roi = Roi(
            *(self._connected().integer(name) for name in ("OffsetX", "OffsetY", "Width", "Height"))
        )
        pixel_format = self._connected().ask(lambda c: c.get_enum("PixelFormat"))
        return Settings(self._connected().exposure_s(), roi, pixel_format)

    def _calibration(self, integration_time_s: float) -> Calibration:
        given = self._settings.calibration
        values = given.model_dump(exclude={"integration_time_s"})
        at_hand = Calibration(**values)
        return replace(
            at_hand,
            counts_per_radiance=at_hand.counts_per_radiance
            * (integration_time_s / given.integration_time_s),
        )

    def _connected(self) -> Features:
        if self._features is None:
            raise NotConnected("camera: is not connected; call connect()")
        return self._features


def open_gige_camera(settings: dict[str, Any], context: RigContext) -> GigeCamera:
    """The driver `gige_camera`."""
    return GigeCamera(check_settings(GigeSettings, settings), context)
