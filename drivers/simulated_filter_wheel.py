"""A simulated filter wheel in front of the simulated camera, which can stick, or be turned."""

from bisect import bisect_right
from typing import Annotated, Any

from cldit.rig.checks import check_filter
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import DeviceTimeout
from cldit.rig.link import HarmlessLink
from cldit.rig.protocols import SpectralFilter
from cldit.scene.checks import Section, Within

from .simulated_scene import SimulatedDevice, SimulatedScene, bench_of

ABOUT = DriverAbout("filter_wheel", "a wheel with the filters of the bench", "simulated")


class WheelSettings(Section):
    """Faults of the wheel, whose filters are those of the bench."""

    moving_s: Annotated[float, Within(0.0, 60.0)] = 1.0  # time of each move
    sticks_after: Annotated[int, Within(0, 10**9)] | None = None  # moves before it is stuck
    turned: Annotated[float, Within(0.0, 1.0)] = 0.0  # fraction of the readings after which
    # somebody turns it to the next position
    late: Annotated[float, Within(0.0, 1.0)] = 0.0  # fraction of the answers that come too late
    unplug_after: Annotated[int, Within(0, 10**9)] | None = None  # readings before it is unplugged


class SimulatedFilterWheel(HarmlessLink, SimulatedDevice):
    """Implements `cldit.rig.protocols.FilterWheel`."""

    def __init__(self, settings: WheelSettings, context: RigContext, bench: SimulatedScene) -> None:
        super().__init__("filter_wheel", "filter wheel", settings.unplug_after)
        self._settings = settings
        self._clock = context.clock
        self._bench = bench
        self._moves = 0
        # Times from which a position is in front of the camera; None during a move.
        self._history: list[tuple[float, int | None]] = [(context.clock.now_s(), 0)]
        bench.attach_wheel(self._place)

    def _open(self, timeout_s: float) -> None:
        self._bench.open()
        self._check()

    @property
    def filters(self) -> tuple[SpectralFilter, ...]:
        return self._bench.filters

    @property
    def moving_s(self) -> float:
        return self._settings.moving_s

    def read_configuration(self) -> dict[str, Any]:
        self._check()
        return {
            **self._settings.model_dump(mode="json"),
            "filters": [item.model_dump(mode="json") for item in self.filters],
            "position": self._now() + 1,
        }

    def move(self, name: str) -> None:
        self._check()
        target = check_filter({item.name: item.position for item in self.filters}, name) - 1
        if self._now() == target:
            return
        stuck = self._settings.sticks_after
        if stuck is None or self._moves < stuck:
            self._turn(target, self.moving_s)
        self._moves += 1
        self._clock.sleep(self.moving_s)
        if self._now() != target:
            raise DeviceTimeout(
                f"filter_wheel: is at position {self._now() + 1} {self.moving_s:g} s after "
                f"{target + 1} ({name}) was asked (its fault sticks_after)"
            )

    def read_filter(self) -> str | None:
        self._check()
        now_s = self._clock.now_s()
        self._used += 1
        chance = self._bench.random(now_s, 7, self._used).random(2)
        if chance[0] < self._settings.late:
            with self._asking():
                raise DeviceTimeout("filter_wheel: no answer to pos? (its fault late)")
        place = self._now()
        if chance[1] < self._settings.turned:
            self._turn((place + 1) % len(self.filters), 0.0)
        return self.filters[place].name

    def _turn(self, target: int, takes_s: float) -> None:
        now_s = self._clock.now_s()
        self._history += [(now_s, None), (now_s + takes_s, target)]

    def _place(self, time_s: float) -> int | None:
        """Index of the filter in front of the camera at a time; None while the wheel moves."""
        times_s = [since_s for since_s, _ in self._history]
        return self._history[max(bisect_right(times_s, time_s) - 1, 0)][1]

    def _now(self) -> int:
        """Index of the filter at which it is, or to which it moves."""
        place = self._history[-1][1]
        assert place is not None  # each move ends
        return place


def open_filter_wheel(settings: dict[str, Any], context: RigContext) -> SimulatedFilterWheel:
    """The driver `simulated_filter_wheel`."""
    return SimulatedFilterWheel(check_settings(WheelSettings, settings), context, bench_of(context))
