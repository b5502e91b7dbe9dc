"""Protocol of a GigE Vision client, and its settings.

A client is a minimal adapter: no decisions, no read-back, errors of the library converted to those
of the rig. `genicam.py` and `genicam_camera.py` do the rest for all clients.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Annotated, Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cldit.scene.checks import Section, Within

TICKS = (0x93C, 0x940)  # bootstrap registers: ticks a second, high and low
TIMESTAMP_CONTROL, TIMESTAMP = 0x944, (0x948, 0x94C)


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


@dataclass(frozen=True)
class Image:
    """An image of a stream. pixels: (h, w) uint16, None if too much is missing; block: its number
    on the stream; device_ns: time on the camera's clock; missing_packets: None if unknown."""

    pixels: NDArray[np.uint16] | None
    block: int
    device_ns: int
    complete: bool
    missing_packets: int | None = None


class Client(Protocol):
    """A camera under control; all methods raise NotConnected or ConfigRejected."""

    def has(self, name: str) -> bool:
        """True if the camera's description has the feature."""

    def get_integer(self, name: str) -> int: ...

    def set_integer(self, name: str, value: int) -> None: ...

    def get_float(self, name: str) -> float: ...

    def set_float(self, name: str, value: float) -> None: ...

    def float_limits(self, name: str) -> tuple[float, float]: ...

    def get_string(self, name: str) -> str: ...

    def get_enum(self, name: str) -> str: ...

    def set_enum(self, name: str, entry: str) -> None: ...

    def get_text(self, name: str) -> str | None:
        """Value of a feature of any type, as GenICam writes it; None while it is unavailable."""

    def set_text(self, name: str, value: str) -> None: ...

    def entries(self, name: str) -> tuple[str, ...]:
        """Entries of an enumeration that are allowed at present."""

    def execute(self, command: str) -> None: ...

    def read_register(self, address: int) -> int:
        """Value of a register of 32 bits."""

    def write_register(self, address: int, value: int) -> None: ...

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def open_stream(self, frames: int) -> None:
        """Opens a stream with room for so many unread images, and closes the previous one."""

    def next_image(self, timeout_s: float) -> Image | None:
        """The next image; None if none arrives in time."""

    def close(self) -> None:
        """Releases the control; never raises."""


def nanoseconds_a_tick(client: Client) -> float | None:
    """Nanoseconds per tick of the camera's clock; None if it has none."""
    high, low = (client.read_register(at) for at in TICKS)
    ticks_per_s = (high << 32) | low
    return 1e9 / ticks_per_s if ticks_per_s else None


class _Watched:
    def __init__(self, client: Client, asking: Callable[[], AbstractContextManager[None]]) -> None:
        self._client, self._asking = client, asking

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._client, name)

        def call(*args: Any) -> Any:
            with self._asking():
                return method(*args)

        return call


def watched(client: Client, asking: Callable[[], AbstractContextManager[None]]) -> Client:
    """The client, with each call as an exchange of `cldit.rig.link.Linked`."""
    return cast(Client, _Watched(client, asking))
