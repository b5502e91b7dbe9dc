"""Test bench for a driver: the driver connected to an emulator whose replies can be lost.

A package with a driver registers its test benches as an entry point of the group
`cldit.emulators`, under the driver's name: a mapping from a variant (`tcp`, `serial`) to a function
that makes a `Bed`.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

from cldit.errors import SceneError
from cldit.rig.errors import RigError
from cldit.testing.expect import ContractBroken
from cldit.testing.replies import Replies

GROUP = "cldit.emulators"


@dataclass(frozen=True)
class Step:
    """Step of a session; `right` compares the result of `call` with the instrument's state."""

    name: str
    call: Callable[[], Any]
    right: Callable[[Any], bool] = lambda value: True


@dataclass(frozen=True)
class Bed:
    """Test bench for a driver: one device, and access to the state of its emulator.

    steps: a session between connect() and make_safe(). left_on: describes what is on at the
    instrument; empty if nothing is. `told`: texts of the error if the instrument cannot be reached
    after the session. replies: channel of the replies; None for a simulated device, which is
    unplugged after its session. pulses: of generators, times [s] of the pulses sent to the `camera`
    or the `injector`. armed: of generators, describes what a trigger would send to the injector, or
    a level of its output above the lowest; empty if nothing. afresh: makes another device for the
    same emulator, as after a crash. sensor: of black bodies, breaks the sensor, which then reads
    one temperature [K]. hang_up: closes the sessions of the line, which may be opened again, or
    waits until the emulator closes them. wheel: of filter wheels, a
    `cldit.testing.wheels.WheelSide`.
    """

    device: Any
    steps: list[Step]
    left_on: Callable[[], str]
    told: tuple[str, ...]
    replies: Replies | None = None
    pulses: Callable[[str], list[float]] | None = None
    armed: Callable[[], str] | None = None
    afresh: Callable[[], Any] | None = None
    sensor: Callable[[float], None] | None = None
    hang_up: Callable[[], None] | None = None
    wheel: Any = None

    @property
    def injections(self) -> int:
        """Number of pulses sent to the injector."""
        return 0 if self.pulses is None else len(self.pulses("injector"))


Make = Callable[[ExitStack, Mapping[str, Any], float | None], Bed]
"""Starts the emulator within a stack; takes the driver's settings in the rig file, without the
address, which is the emulator's, and the time to wait for an answer [s]."""


def beds_of(driver: str) -> dict[str, Make]:
    """Installed test benches of a driver, by variant.

    Raises:
        SceneError: there are none, or they cannot be loaded.
    """
    for entry in entry_points(group=GROUP, name=driver):
        try:
            return dict(entry.load())
        except (ImportError, AttributeError) as error:
            raise SceneError(
                f"the emulators of {driver!r} ({entry.value}) cannot be loaded: {error}"
            ) from error
    raise SceneError(
        f"the driver {driver!r} has no emulator, so its behaviour after a lost answer is not "
        f"tested: register beds as an entry point of the group {GROUP} (docs/extending.md)"
    )


def problem_of(check: Callable[[float], object], *, answer_s: float) -> str:
    """Problem of a check whose driver waits `answer_s` for an answer; empty if there is none.

    A busy machine may take longer to answer than that, so the check is repeated with twenty times
    as long before it fails.
    """
    problem = ""
    for factor in (1.0, 20.0):
        try:
            check(factor * answer_s)
            return ""
        except (ContractBroken, RigError) as error:
            problem = str(error)
    return problem


@contextmanager
def opened(
    make: Make, settings: Mapping[str, Any] | None = None, *, answer_s: float | None = None
) -> Iterator[Bed]:
    """Context of a new bed, its emulator running, its device not connected; closed at the end.

    Args:
        make: from `beds_of`.
        settings: of the driver, without the address.
        answer_s: time for which the driver waits for an answer, if that can be set.

    Returns:
        The bed, as a context manager.
    """
    with ExitStack() as stack:
        bed = make(stack, settings or {}, answer_s)
        try:
            yield bed
        finally:
            bed.device.close()
