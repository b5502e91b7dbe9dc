"""GenICam cameras on GigE Vision, through viva-genicam.

Feature names: GenICam SFNC 2. No register contains the radiometric calibration, so the rig file
gives it; counts per radiance are assumed proportional to the integration time.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from cldit.camera.calibration import Calibration
from cldit.rig.checks import check_exposure, check_format, check_roi, check_trigger
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, MissingFrames, NotConnected, RigError
from cldit.rig.link import Linked
from cldit.rig.protocols import (
    Capabilities,
    DeviceInfo,
    Frame,
    Roi,
    Settings,
    TriggerInfo,
    TriggerMode,
)

from .count_features import read_features, set_features, unstated
from .genicam import Client, GigeSettings

_SOURCES = {TriggerMode.SOFTWARE: "Software", TriggerMode.EXTERNAL_EDGE: ""}
_MODES = frozenset({TriggerMode.INTERNAL, *_SOURCES})
_EDGES = {"rising": "RisingEdge", "falling": "FallingEdge"}
_BLOCKS = 65535  # 16-bit block ids count 1..65535, then from 1
_IN_FLIGHT_s = 0.5  # longest time from an exposure to its image


ABOUT = DriverAbout(
    "camera",
    "GenICam cameras on GigE Vision, through viva-genicam",
    "untested on hardware; tested with three simulated GigE Vision cameras, two of them not ours",
    needs=("viva_genicam",),
)


class GenicamCamera(Linked):
    """Implements `cldit.rig.protocols.Camera`."""

    def __init__(self, settings: GigeSettings) -> None:
        super().__init__(
            "camera",
            f"GigE Vision camera at {settings.address}",
            by_hand="pull its trigger cable, or switch it off",
            address=lambda: f"camera {settings.address}",
            # After a lost link, the camera keeps the control until its heartbeat expires; twice as
            # long is left to find it again.
            reach_s=3.0 * settings.heartbeat_s,
        )
        self._settings = settings
        self._client: Client | None = None
        self._told = "not armed"
        self._streams = False
        self._info = DeviceInfo("camera", "?", "GigE Vision camera", tested_on_hardware=False)
        self._trigger: TriggerInfo | None = None
        self._armed = False
        self._triggered = self._received = 0  # since armed
        self._last_trigger_s = -np.inf
        self._period_s = 0.0
        self._base = -1  # frame id = base + 1 + blocks since the start
        self._last_id = -1
        self._first_block: int | None = None  # of this start
        self._clock_offset_ns: int | None = None
        self._counts = {"delivered": 0, "missed": 0, "flushed": 0, "incomplete": 0}

    # Life

    def _open(self, timeout_s: float) -> None:
        end_s = time.monotonic() + timeout_s
        while True:
            try:
                self._begin()
                return
            except ConfigRejected:
                raise
            except RigError as error:
                self._drop()
                # After a crash, the camera keeps the control until the heartbeat expires.
                if time.monotonic() + 0.2 >= end_s:
                    raise NotConnected(
                        f"camera: {self._settings.address} cannot be used ({error}); check its "
                        "power and address, and that no other program uses it"
                    ) from error
                time.sleep(0.2)

    def _begin(self) -> None:
        settings = self._settings
        client = self._client = Client(settings, self._asking)
        if client.has("GevHeartbeatTimeout"):
            client.set_integer("GevHeartbeatTimeout", round(1e3 * settings.heartbeat_s))

    def _identify(self) -> None:
        self.disarm()  # before anything is read that could be impossible

    def _prepare(self) -> None:
        settings, features = self._settings, self._connected()
        names = ("DeviceVendorName", "DeviceModelName", "DeviceSerialNumber", "DeviceVersion")
        maker, model, serial, firmware = (features.text(name) for name in names)
        self._info = DeviceInfo("camera", maker, model, serial, firmware, tested_on_hardware=False)
        rate_Hz = settings.maximum_rate_Hz or features.maximum_rate_Hz()
        if not rate_Hz > 0.0:
            raise NotConnected(f"camera: its frame rate is {rate_Hz:g} Hz, expected more than 0")
        self._period_s = 1.0 / rate_Hz
        self._clock_offset_ns = features.clock_offset_ns()
        set_features(features, settings.features)
        features.choose("PixelFormat", settings.pixel_format)
        self.configure(settings.calibration.integration_time_s)

    def _drop(self) -> None:
        client, self._client = self._client, None
        self._armed = self._streams = False
        if client is not None:
            client.close()

    def _write_safe(self) -> None:
        self.disarm()

    def _check_safe(self) -> str:
        return "disarmed"

    def _last_known(self) -> str:
        return self._told

    def identify(self) -> DeviceInfo:
        return self._info

    def read_configuration(self) -> dict[str, Any]:
        settings = self._read_settings()
        roi = settings.roi
        counting = read_features(self._connected())
        return {
            "address": self._settings.address,
            "line": self._settings.line,
            "integration_time_s": settings.integration_time_s,
            "roi": [roi.x, roi.y, roi.width, roi.height],
            "pixel_format": settings.pixel_format,
            "features": counting,
            "unstated": unstated(counting, self._settings.features),
            "calibration": self._calibration(settings.integration_time_s).to_dict(),
        }

    def wait_ready(self, timeout_s: float) -> None:
        """Checks the connection only: the SFNC has no feature for a cooler that is ready."""
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
            sensor_pixels=self._connected().sensor_pixels(),
            pixel_formats=self._connected().entries("PixelFormat"),
        )

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
        if pixel_format is not None:
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
            self._connected().put_integer(name, value)
        return self._read_settings()

    def prepare(self, trigger: TriggerInfo) -> None:
        features = self._connected()
        check_trigger(_MODES, trigger)
        if self._armed:
            raise ConfigRejected("camera: is armed; disarm() before prepare()")
        features.stop_after(trigger.n_frames)
        source = None
        if trigger.mode is not TriggerMode.INTERNAL:
            source = _SOURCES[trigger.mode] or self._settings.line
        features.trigger(source, _EDGES[trigger.activation], trigger.frames_per_trigger)
        self._trigger = trigger

    # Images

    def arm(self) -> None:
        client = self._connected()
        if self._trigger is None:
            raise ConfigRejected("camera: prepare() before arm()")
        # Block ids count from 1 after each start. On the old stream the client would ignore them as
        # late packets of the last image, so each start has a new stream.
        client.open_stream()
        self._streams = True
        self._base, self._first_block = self._last_id, None
        self._told = f"armed for {self._trigger.n_frames} frames, trigger {self._trigger.mode}"
        client.start()
        self._armed, self._triggered, self._received = True, 0, 0

    def flush(self) -> int:
        self._connected()
        if not self._streams:
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
        self._connected().execute("TriggerSoftware")
        self._last_trigger_s = time.monotonic()  # the exposure was before this
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
        self._connected().stop()
        self._armed, self._told = False, "disarmed"

    def statistics(self) -> dict[str, int]:
        return dict(self._counts)

    def _next(self, timeout_s: float) -> Frame | None:
        """The next frame; None if none arrives in time."""
        client = self._connected()
        if not self._streams:
            time.sleep(timeout_s)
            return None
        got = client.next_image(timeout_s)
        if got is None:
            return None
        self._received += 1
        self._last_id = self._frame_id(got.frame_id)
        host_ns, offset_ns = got.host_timestamp_ns, self._clock_offset_ns
        if offset_ns is not None:
            host_ns = got.device_timestamp_ns + offset_ns
        return replace(got, frame_id=self._last_id, host_timestamp_ns=host_ns)

    def _frame_id(self, block: int) -> int:
        """Id of a frame, continuous over starts, as block ids are on some cameras only. An image
        that is lost right after a start is detected by its absence."""
        if self._first_block is None:
            self._first_block = block
        since = block - self._first_block
        return self._base + 1 + (since % _BLOCKS if block <= _BLOCKS else since)

    # The camera's features

    def _read_settings(self) -> Settings:
        client = self._connected()
        roi = Roi(*map(client.get_integer, ("OffsetX", "OffsetY", "Width", "Height")))
        return Settings(client.exposure_s(), roi, client.get_enum("PixelFormat"))

    def _calibration(self, integration_time_s: float) -> Calibration:
        stated = self._settings.calibration
        values = stated.model_dump(exclude={"integration_time_s"})
        values["counts_per_radiance"] *= integration_time_s / stated.integration_time_s
        return Calibration(**values)

    def _connected(self) -> Client:
        with self._asking():  # raises if it is not connected
            assert self._client is not None
            return self._client


def open_gige_camera(settings: dict[str, Any], context: RigContext) -> GenicamCamera:
    """The driver `gige_camera`."""
    return GenicamCamera(check_settings(GigeSettings, settings))
