"""Contract of filter wheels, a session with one, and the contract of their faults, with an emulator
whose wheel can stick and be turned by hand.

No move returns normally, and no reading names a filter, unless that filter is in front of the
camera: images under a wrong filter look like good ones.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from cldit.rig.errors import ConfigRejected, DeviceTimeout, RigError
from cldit.rig.protocols import FilterWheel, SpectralFilter
from cldit.testing.bed import Bed, Make, Step, opened, problem_of
from cldit.testing.expect import Allowed, Check, expect, refuses
from cldit.testing.replies import Fault

_ANSWER_s, _LATE, _MANY = 0.1, 1.5, 10**9  # a late answer takes 1.5 times the wait


def visits(wheel: FilterWheel, allowed: Allowed) -> None:
    """Checks that it moves to every filter, reads it back, and stays for a second request."""
    stored = wheel.read_configuration()["filters"]
    configured = tuple(SpectralFilter.model_validate(item) for item in stored)
    expect(
        configured == wheel.filters,
        f"the configuration has {configured}, `filters` {wheel.filters}",
    )
    for item in (*wheel.filters, wheel.filters[0], wheel.filters[0]):
        wheel.move(item.name)
        got = wheel.read_filter()
        expect(got == item.name, f"reads {got} after a move to {item.name}")
    expect(wheel.moving_s >= 0.0, f"moving_s: {wheel.moving_s}")


def refuses_unknown_filters(wheel: FilterWheel, allowed: Allowed) -> None:
    """Checks that a filter that it does not have is rejected, and nothing moves."""
    wheel.move(wheel.filters[0].name)
    error = refuses(lambda: wheel.move("no-such-filter"), ConfigRejected, "move to no filter")
    for item in wheel.filters:
        expect(item.name in str(error), f"{error}; expected {item.name} in it")
    got = wheel.read_filter()
    expect(got == wheel.filters[0].name, f"reads {got} after a rejected move")


WHEEL = [
    Check("visits", "moves the wheel to each of its filters", visits),
    Check("refusals", "requests a filter that it lacks", refuses_unknown_filters),
]


@dataclass(frozen=True)
class WheelSide:
    """State of an emulated wheel, and what happens to it.

    filter: name of the filter in front of the camera, None for none. turn: turns it by hand, to the
    next position. stick: from now on a move is accepted, and does not happen.
    """

    filter: Callable[[], str | None]
    turn: Callable[[], None]
    stick: Callable[[], None]


def wheel_steps(device: FilterWheel, side: WheelSide | None = None) -> list[Step]:
    """Session with a wheel of two filters or more; without `side` its state is not compared."""
    start, target = (item.name for item in device.filters[:2])

    def there(name: str) -> Callable[[Any], bool]:
        return lambda _: side is None or side.filter() == name

    def right(got: Any) -> bool:
        return side is None or got == side.filter()

    return [
        Step("configuration", device.read_configuration, bool),
        Step("move", lambda: device.move(target), there(target)),
        Step("filter", device.read_filter, right),
        Step("move back", lambda: device.move(start), there(start)),
        Step("filter again", device.read_filter, right),
    ]


def _side(bed: Bed) -> WheelSide:
    side = bed.wheel
    expect(side is not None, "the bed lacks `wheel`, the emulator's side")
    assert isinstance(side, WheelSide)
    return side


def sticks(bed: Bed, allowed: Allowed) -> None:
    """Checks that a move that does not happen raises DeviceTimeout with both positions."""
    side, wheel = _side(bed), bed.device
    start, target = wheel.filters[:2]
    wheel.move(start.name)
    side.stick()
    error = refuses(lambda: wheel.move(target.name), DeviceTimeout, "move of a stuck wheel")
    for part in (str(start.position), str(target.position), target.name):
        expect(part in str(error), f"{error}; expected {part!r} in it")
    got = wheel.read_filter()
    expect(got == side.filter(), f"reads {got}, but {side.filter()} is in front of the camera")


def turned_by_hand(bed: Bed, allowed: Allowed) -> None:
    """Checks that it reads where it is, not where it was sent, and that it moves back."""
    side, wheel = _side(bed), bed.device
    name = wheel.filters[0].name
    wheel.move(name)
    for _ in range(len(wheel.filters)):  # the last one may be a position without a filter
        side.turn()
        got = wheel.read_filter()
        expect(got == side.filter(), f"turned by hand: reads {got}, not {side.filter()}")
    expect(side.filter() != name, "the emulator was not turned")
    wheel.move(name)
    expect(side.filter() == name, f"moved back to {name}, but {side.filter()} is there")


FAULTS = [Check("sticks", "", sticks), Check("turned by hand", "", turned_by_hand)]
"""Checks that need an emulator."""


def check_spoiled(make: Make, settings: Mapping[str, Any] | None = None) -> int:
    """Checks that no missing, late, damaged or impossible answer becomes a filter, and that the
    line is used again once it works.

    `make` and `settings` are as for `cldit.testing.bed.opened`. Returns the number of sessions;
    raises ContractBroken.
    """
    calls: dict[str, Callable[[FilterWheel, str], object]] = {
        "read_filter()": lambda wheel, name: wheel.read_filter(),
        "move()": lambda wheel, name: wheel.move(name),
    }

    def check(fault: Fault, called: str, answer_s: float) -> None:
        with opened(make, settings, answer_s=answer_s) as bed:
            wheel, replies, side = bed.device, bed.replies, _side(bed)
            assert replies is not None
            wheel.connect()
            start, target = (item.name for item in wheel.filters[:2])
            wheel.move(start)
            replies.spoil(fault, replies.sent + 1, last=_MANY, late_s=_LATE * answer_s)
            text = f"{called} with every answer: {fault}"
            refuses(partial(calls[called], wheel, target), RigError, text)
            replies.heal()
            wheel.connect()
            got = wheel.read_filter()
            expect(got == side.filter(), f"{text}: then reads {got}, not {side.filter()}")

    for fault in Fault:
        for called in calls:
            problem = problem_of(partial(check, fault, called), answer_s=_ANSWER_s)
            expect(not problem, problem)
    return len(Fault) * len(calls)
