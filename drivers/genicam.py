"""A GigE Vision camera through viva-genicam, with the errors of the rig, and its settings.

Features are read back after they are written; `gige_camera.py` does the rest.
"""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import Field

from cldit.rig.checks import check_answer
from cldit.rig.errors import ConfigRejected, NotConnected, OddAnswer, RigError
from cldit.rig.protocols import Frame
from cldit.scene.checks import Section, Within

T = TypeVar("T")

_DISCOVERY_s = 0.3
# viva raises one class for a feature that the camera rejects and for one without an answer.
_FAILED, _REFUSED = "register I/O failed", "device reported status"
TICKS = (0x93C, 0x940)  # bootstrap registers: ticks a second, high and low
TIMESTAMP_CONTROL, TIMESTAMP = 0x944, (0x948, 0x94C)
_LATCH = 2  # bit of the timestamp control register (GigE Vision 2.0)
_RATES = (  # first those that the camera can reach
    "ResultingFrameRate",
    "ResultingFrameRateAbs",
    "AcquisitionFrameRate",
    "AcquisitionFrameRateAbs",
)


class CalibrationSection(Section):
    """`cldit.camera.calibration.Calibration` at an integration time."""

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
    maximum_rate_Hz: Annotated[float, Within(1e-3, 1e6)] | None = None  # None: the camera's
    heartbeat_s: Annotated[float, Within(1.5, 60.0)] = 2.0  # after a crash the camera is free then
    features: dict[str, bool | int | float | str] = Field(default_factory=dict)  # set, read back
    packet_size: Annotated[int, Within(576, 9000)] | None = None  # None: the camera's


class Client:
    """A camera under control through viva-genicam. All methods raise NotConnected or
    ConfigRejected, the errors of the rig for those of the library.

    asking: context of each exchange, see `cldit.rig.link.Linked`.
    """

    def __init__(
        self, settings: GigeSettings, asking: Callable[[], AbstractContextManager[None]]
    ) -> None:
        """Takes control of the camera; raises NotConnected."""
        import viva_genicam as viva

        self._viva = viva
        self._settings = settings
        self._asking = asking
        self._stream: Any = None
        loopback = "127.0.0.1" if settings.address.startswith("127.") else None
        try:
            devices = viva.discover(
                timeout_ms=round(1e3 * _DISCOVERY_s), iface=settings.interface or loopback
            )
            matching = [device for device in devices if device.ip == settings.address]
            if not matching:
                listed = ", ".join(f"{d.ip} ({d.model})" for d in devices) or "none"
                raise NotConnected(f"no such camera on the network; found: {listed}")
            self._camera = viva.connect_gige(matching[0], iface=settings.interface)
        except viva.GenicamError as error:
            raise NotConnected(str(error)) from error
        try:
            self._nodes = frozenset(self._ask(lambda c: c.nodes()))
            try:
                self._ns_per_tick = nanoseconds_a_tick(self) or 1.0
            except ConfigRejected:  # no such register
                self._ns_per_tick = 1.0
        except RigError:
            self.close()
            raise

    def _ask(self, action: Callable[[Any], T]) -> T:
        """Result of `action(camera)`, with errors of the rig."""
        with self._asking():
            try:
                return action(self._camera)
            except self._viva.GenicamError as error:
                # Errors of the transport are among them.
                lost = isinstance(error, self._viva.TransportError)
                if lost or (_FAILED in str(error) and _REFUSED not in str(error)):
                    raise NotConnected(
                        f"camera: the link failed ({error}); check the cable"
                    ) from error
                raise ConfigRejected(f"camera: {error}") from error

    def has(self, name: str) -> bool:
        """True if the camera's description has the feature."""
        return name in self._nodes

    def get_integer(self, name: str) -> int:
        return int(self._ask(lambda c: c.get_integer(name)))

    def set_integer(self, name: str, value: int) -> None:
        self._ask(lambda c: c.set_integer(name, value))

    def get_float(self, name: str) -> float:
        return check_answer("camera", name, self._ask(lambda c: c.get_float(name)))

    def get_enum(self, name: str) -> str:
        return str(self._ask(lambda c: c.get_enum(name)))

    def get_text(self, name: str) -> str | None:
        """Value of a feature of any type, as GenICam writes it; None while it is unavailable."""
        try:
            return str(self._ask(lambda c: c.get(name)))
        except ConfigRejected:  # unavailable, or the answer was damaged
            value = self._ask(lambda c: c.feature_state(name)).value
            return None if value is None else str(value)

    def set_text(self, name: str, value: str) -> None:
        self._ask(lambda c: c.set(name, value))

    def entries(self, name: str) -> tuple[str, ...]:
        """Entries of an enumeration that are allowed at present; none if the camera lacks it."""
        if not self.has(name):
            return ()
        return tuple(self._ask(lambda c: c.available_enum_entries(name)))

    def execute(self, command: str) -> None:
        self._ask(lambda c: c.execute(command))

    def read_register(self, address: int) -> int:
        """Value of a register of 32 bits."""
        return int.from_bytes(self._ask(lambda c: c.read_register(address, 4)), "big")

    def start(self) -> None:
        self._ask(lambda c: c.acquisition_start())

    def stop(self) -> None:
        self._ask(lambda c: c.acquisition_stop())

    def open_stream(self) -> None:
        """Opens a stream, and closes the previous one."""
        settings = self._settings
        options = {} if settings.packet_size is None else {"packet_size": settings.packet_size}
        if self._stream is not None:
            self._stream.close()
        self._stream = self._ask(
            lambda c: c.stream(iface=settings.interface, deliver_incomplete=True, **options)
        )

    def next_image(self, timeout_s: float) -> Frame | None:
        """The next image, with its number on the stream; None if none arrives in time. It has no
        pixels if too much of it is missing."""
        with self._asking():
            try:
                got = self._stream.next_frame(max(1, round(1e3 * timeout_s)))
            except self._viva.TransportError as error:
                if "timeout" in str(error):
                    return None
                raise NotConnected(f"camera: the stream broke ({error})") from error
            if got is None:
                raise NotConnected("camera: the stream has ended; connect again")
        try:
            pixels = np.asarray(got.to_numpy()).astype(np.uint16, copy=False)
        except self._viva.GenicamError:  # incomplete: its end is missing
            pixels = np.zeros((0, 0), np.uint16)
        return Frame(
            data=pixels,
            frame_id=int(got.block_id),
            device_timestamp_ns=round(int(got.ts_dev or 0) * self._ns_per_tick),
            host_timestamp_ns=time.time_ns(),
            complete=bool(got.is_complete) and pixels.size > 0,
            meta={"missing_packets": got.missing_packets or 0},
        )

    def close(self) -> None:
        """Releases the control; never raises."""
        for item in (self._stream, self._camera):
            if item is not None:
                try:
                    item.close()
                except Exception:  # already gone
                    continue

    # Features, written and read back

    def put_integer(self, name: str, value: int) -> None:
        self.set_integer(name, value)
        got = self.get_integer(name)
        if got != value:
            raise ConfigRejected(f"camera: {name}: reads back {got} after {value} was written")

    def choose(self, name: str, entry: str) -> None:
        self._ask(lambda c: c.set_enum(name, entry))
        got = self.get_enum(name)
        if got != entry:
            raise ConfigRejected(f"camera: {name}: reads back {got} after {entry} was written")

    def text(self, name: str) -> str:
        """Value of a text feature; empty if the camera lacks it."""
        return str(self._ask(lambda c: c.get_string(name))) if self.has(name) else ""

    def named(self, *names: str) -> str:
        """The name that the camera has among several for one feature (SFNC 2 renamed some)."""
        for name in names:
            if self.has(name):
                return name
        raise ConfigRejected(f"camera: has no feature {' or '.join(names)}")

    @property
    def _exposure(self) -> str:
        return self.named("ExposureTime", "ExposureTimeAbs")

    def sensor_pixels(self) -> tuple[int, int]:
        """Columns and rows of the sensor."""
        columns = self.get_integer(self.named("SensorWidth", "WidthMax"))
        return columns, self.get_integer(self.named("SensorHeight", "HeightMax"))

    def exposure_s(self) -> float:
        """Exposure that the camera reads back; raises OddAnswer for one beyond its limits."""
        seconds = 1e-6 * self.get_float(self._exposure)
        low_s, high_s = self.exposure_limits_s()
        if not 0.0 < seconds or not 0.9 * low_s <= seconds <= 1.1 * high_s:  # limits are rounded
            raise OddAnswer(
                f"camera: reads back an exposure of {seconds:g} s, expected {low_s:g} to {high_s:g}"
            )
        return seconds

    def expose(self, seconds: float) -> None:
        """Sets the exposure, which `exposure_s` reads back."""
        self._ask(lambda c: c.set_float(self._exposure, 1e6 * seconds))

    def exposure_limits_s(self) -> tuple[float, float]:
        limits = self._ask(lambda c: c.feature_state(self._exposure)).range
        return 1e-6 * limits.min, 1e-6 * limits.max

    def stop_after(self, frames: int) -> None:
        """Makes the camera stop after so many frames; if it cannot, its driver reads no more."""
        if self.has("AcquisitionFrameCount"):
            self.choose("AcquisitionMode", "MultiFrame")
            self.put_integer("AcquisitionFrameCount", frames)
        else:
            self.choose("AcquisitionMode", "Continuous")

    def trigger(self, source: str | None, activation: str, frames: int) -> None:
        """Makes each edge at `source` start so many frames; None lets the camera run freely.

        Several frames are started by FrameBurstStart of SFNC 2, or the former AcquisitionStart.
        """
        selectors = self.entries("TriggerSelector")
        for selector in selectors:  # one that stays on would block the others
            self.choose("TriggerSelector", selector)
            self.choose("TriggerMode", "Off")
        if source is None:
            return
        if frames > 1 and "FrameBurstStart" in selectors:
            self.put_integer("AcquisitionBurstFrameCount", frames)
            self.choose("TriggerSelector", "FrameBurstStart")
        elif frames > 1 and "AcquisitionStart" in selectors and self.has("AcquisitionFrameCount"):
            self.choose("TriggerSelector", "AcquisitionStart")
        elif frames > 1:
            raise ConfigRejected(
                "camera: none of its triggers starts several frames; allowed in the plan: frames: 1"
            )
        elif selectors:
            self.choose("TriggerSelector", "FrameStart")
        self.choose("TriggerSource", source)
        if self.has("TriggerActivation"):
            self.choose("TriggerActivation", activation)
        elif activation != "RisingEdge":
            raise ConfigRejected("camera: triggers on the rising edge only")
        self.choose("TriggerMode", "On")

    def maximum_rate_Hz(self) -> float:
        """Frame rate that the camera reports; raises ConfigRejected if it reports none."""
        for name in _RATES:
            if self.has(name):
                return self.get_float(name)
        raise ConfigRejected("camera: does not report its frame rate; set maximum_rate_Hz")

    def clock_offset_ns(self) -> int | None:
        """Offset from the camera's nanoseconds to wall time, by the quickest of several readings;
        None if the camera's clock cannot be read."""
        offset_ns, best_ns = None, 10**9
        seen: set[int] = set()
        try:
            ns_per_tick = nanoseconds_a_tick(self)
            if ns_per_tick is None:
                return None
            for _ in range(5):
                before_ns = time.time_ns()
                self._ask(lambda c: c.write_register(TIMESTAMP_CONTROL, _LATCH.to_bytes(4, "big")))
                after_ns = time.time_ns()
                high, low = (self.read_register(at) for at in TIMESTAMP)
                ticks = (high << 32) | low
                seen.add(ticks)
                if after_ns - before_ns < best_ns:
                    best_ns = after_ns - before_ns
                    offset_ns = (before_ns + after_ns) // 2 - round(ticks * ns_per_tick)
        except RigError:
            return None
        return offset_ns if len(seen) > 1 else None  # a stopped clock is useless


def nanoseconds_a_tick(client: Client) -> float | None:
    """Nanoseconds per tick of the camera's clock; None if it has none."""
    high, low = (client.read_register(at) for at in TICKS)
    ticks_per_s = (high << 32) | low
    return 1e9 / ticks_per_s if ticks_per_s else None
