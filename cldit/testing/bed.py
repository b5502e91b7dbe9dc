"""A bed: a driver before its emulator, whose replies can be lost, and the instrument's side of it.

A package that brings a driver brings its beds as an entry point of the group `cldit.emulators`,
under the driver's name: a mapping from a variant (`tcp`, `serial`) to what makes a bed of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

from cldit.errors import SceneError
from cldit.testing.replies import Replies

GROUP = "cldit.emulators"


@dataclass(frozen=True)
class Step:
    """Part of a session. right: whether what `call` gave agrees with the instrument's side."""

    name: str
    call: Callable[[], Any]
    right: Callable[[Any], bool] = lambda value: True


@dataclass(frozen=True)
class Bed:
    """One device, and the instrument's side of it.

    steps: a session between connect() and make_safe(). left_on: what is on at the instrument, in
    words, empty where nothing is. told: what must be said of the instrument where it cannot be
    reached after the session. replies: their way, None for a simulated device, which is unplugged
    after its session. pulses: times [s] of the pulses that went out to the `camera` and to the
    `injector`; for generators.
    """

    device: Any
    steps: list[Step]
    left_on: Callable[[], str]
    told: tuple[str, ...]
    replies: Replies | None = None
    pulses: Callable[[str], list[float]] | None = None

    @property
    def injections(self) -> int:
        """Pulses at the injector."""
        return 0 if self.pulses is None else len(self.pulses("injector"))


Make = Callable[[ExitStack, Mapping[str, Any], float | None], Bed]
"""Switches the emulator on within a stack; takes the driver's settings as far as the rig file
gives them (without the address, which is the emulator's) and how long to wait for an answer [s]."""


def beds_of(driver: str) -> dict[str, Make]:
    """The beds that are installed for a driver, by variant.

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
        f"the driver {driver!r} has no emulator, so nobody tries what it does when an answer is "
        f"lost: give it beds as an entry point of the group {GROUP} (docs/extending.md)"
    )


@contextmanager
def opened(
    make: Make, settings: Mapping[str, Any] | None = None, *, answer_s: float | None = None
) -> Iterator[Bed]:
    """A new bed, its emulator switched on, its device not connected; closed at the end.

    Args:
        make: of `beds_of`.
        settings: the driver's, without the address.
        answer_s: how long the driver waits for an answer, where that can be set.

    Returns:
        The bed, as a context manager.
    """
    with ExitStack() as stack:
        bed = make(stack, settings or {}, answer_s)
        try:
            yield bed
        finally:
            bed.device.close()
