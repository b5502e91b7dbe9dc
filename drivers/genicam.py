"""Features of a GenICam camera, each read back after it is written, with errors of the rig."""

import time

from cldit.rig.errors import ConfigRejected, OddAnswer, RigError

from .genicam_client import TIMESTAMP, TIMESTAMP_CONTROL, Client, nanoseconds_a_tick

_LATCH = 2  # bit of the timestamp control register (GigE Vision 2.0)
_RATES = (  # first those that the camera can reach
    "ResultingFrameRate",
    "ResultingFrameRateAbs",
    "AcquisitionFrameRate",
    "AcquisitionFrameRateAbs",
)


class Features:
    """Features through a connected client."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.has = client.has
        self.integer = client.get_integer

    def set_integer(self, name: str, value: int) -> None:
        self.client.set_integer(name, value)
        got = self.integer(name)
        if got != value:
            raise ConfigRejected(f"camera: {name}: reads back {got} after {value} was written")

    def choose(self, name: str, entry: str) -> None:
        self.client.set_enum(name, entry)
        got = self.client.get_enum(name)
        if got != entry:
            raise ConfigRejected(f"camera: {name}: reads back {got} after {entry} was written")

    def entries(self, name: str) -> tuple[str, ...]:
        """Entries of an enumeration; none if the camera lacks it."""
        return self.client.entries(name) if self.has(name) else ()

    def text(self, name: str) -> str:
        """Value of a text feature; empty if the camera lacks it."""
        return self.client.get_string(name) if self.has(name) else ""

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
        columns = self.integer(self.named("SensorWidth", "WidthMax"))
        return columns, self.integer(self.named("SensorHeight", "HeightMax"))

    def exposure_s(self) -> float:
        """Exposure that the camera reads back; raises OddAnswer for one beyond its limits."""
        seconds = 1e-6 * self.client.get_float(self._exposure)
        low_s, high_s = self.exposure_limits_s()
        if not 0.0 < seconds or not 0.9 * low_s <= seconds <= 1.1 * high_s:  # limits are rounded
            raise OddAnswer(
                f"camera: reads back an exposure of {seconds:g} s, expected {low_s:g} to {high_s:g}"
            )
        return seconds

    def expose(self, seconds: float) -> None:
        """Sets the exposure, which `exposure_s` reads back."""
        self.client.set_float(self._exposure, 1e6 * seconds)

    def exposure_limits_s(self) -> tuple[float, float]:
        low, high = self.client.float_limits(self._exposure)
        return 1e-6 * low, 1e-6 * high

    def stop_after(self, frames: int) -> None:
        """Makes the camera stop after so many frames; if it cannot, its driver reads no more."""
        if self.has("AcquisitionFrameCount"):
            self.choose("AcquisitionMode", "MultiFrame")
            self.set_integer("AcquisitionFrameCount", frames)
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
            self.set_integer("AcquisitionBurstFrameCount", frames)
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
                return self.client.get_float(name)
        raise ConfigRejected("camera: does not report its frame rate; set maximum_rate_Hz")

    def clock_offset_ns(self) -> int | None:
        """Offset from the camera's nanoseconds to wall time, by the quickest of several readings;
        None if the camera's clock cannot be read."""
        offset_ns, best_ns = None, 10**9
        seen: set[int] = set()
        try:
            ns_per_tick = nanoseconds_a_tick(self.client)
            if ns_per_tick is None:
                return None
            for _ in range(5):
                before_ns = time.time_ns()
                self.client.write_register(TIMESTAMP_CONTROL, _LATCH)
                after_ns = time.time_ns()
                high, low = (self.client.read_register(at) for at in TIMESTAMP)
                ticks = (high << 32) | low
                seen.add(ticks)
                if after_ns - before_ns < best_ns:
                    best_ns = after_ns - before_ns
                    offset_ns = (before_ns + after_ns) // 2 - round(ticks * ns_per_tick)
        except RigError:
            return None
        return offset_ns if len(seen) > 1 else None  # a stopped clock is useless
