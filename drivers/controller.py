"""Base of the drivers of black bodies: limits, units, settings of the line, the safe set point."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Generic, Literal, TypeVar, get_args

from pydantic import model_validator

from cldit.constants import ZERO_CELSIUS_K
from cldit.rig.checks import check_setpoint
from cldit.rig.clock import Clock
from cldit.rig.errors import ConfigRejected, OddAnswer
from cldit.rig.link import Told
from cldit.rig.protocols import Limits
from cldit.rig.stability import Settling
from cldit.scene.checks import Section
from cldit.scene.values import Temperature

from .line_address import LineAddress

Unit = Literal["celsius", "fahrenheit", "kelvin"]
UNITS: tuple[Unit, ...] = get_args(Unit)
_SCALES = {"celsius": (ZERO_CELSIUS_K, 1.0), "fahrenheit": (459.67, 1.8), "kelvin": (0.0, 1.0)}
_COLDEST, _HOTTEST = 0.5, 1.5  # factors of the limits, beyond which an answer is impossible
_AGREE_K = 0.1  # a set point is read back rounded to a tenth
_ROOM_K = (ZERO_CELSIUS_K, 313.15)  # of a body that is off
_OVERSHOOT = 1.05  # of the upper limit


def to_kelvin(number: float, unit: Unit) -> float:
    """Temperature [K] of a number in a unit."""
    offset, per_kelvin = _SCALES[unit]
    return (number + offset) / per_kelvin


def from_kelvin(temperature_K: float, unit: Unit) -> float:
    """Number of a temperature [K] in a unit."""
    offset, per_kelvin = _SCALES[unit]
    return temperature_K * per_kelvin - offset


class BlackBodyLimits(Section):
    limits_K: tuple[Temperature, Temperature]  # of the set point

    @model_validator(mode="after")
    def _ordered(self) -> "BlackBodyLimits":
        if self.limits_K[0] >= self.limits_K[1]:
            raise ValueError(f"limits_K: {self.limits_K} is empty; allowed: (low, high)")
        return self


class ControllerSettings(BlackBodyLimits, LineAddress):
    safe_K: Temperature = 295.0  # set point when the rig is made safe; the nearest within limits

    @property
    def safe_setpoint_K(self) -> float:
        low, high = self.limits_K
        return min(max(self.safe_K, low), high)


S = TypeVar("S", bound=BlackBodyLimits)


class BlackBody(Settling, Generic[S]):
    """A background that rejects set points outside its limits."""

    _unit: Unit | None = "kelvin"  # of the instrument's numbers; None before it is read
    _unit_key = "unit"  # of the settings

    @property
    def _known_unit(self) -> Unit:
        # Of all units, Celsius has the lowest number for a temperature, so that a safe set point
        # that is written before the unit could be read is never too hot.
        return self._unit or "celsius"

    def __init__(self, settings: S, clock: Clock) -> None:
        self._settings = settings
        self._clock = clock
        self._setpoint = Told("set point")

    @property
    def safe_setpoint_K(self) -> float:
        return float(getattr(self._settings, "safe_setpoint_K", self._settings.limits_K[0]))

    @property
    def limits(self) -> Limits:
        return Limits(*self._settings.limits_K)

    def _plausible(self, query: str, temperature_K: float) -> float:
        """Checks the answer to a query against the limits of the source, because a damaged integer
        looks like any other; raises OddAnswer."""
        low, high = self._settings.limits_K
        coldest, hottest = low * _COLDEST, high * _HOTTEST
        if not coldest <= temperature_K <= hottest:
            raise OddAnswer(
                f"background: answered {temperature_K:g} K to {query}, expected {coldest:.0f} to "
                f"{hottest:.0f} K with limits_K {low:g} to {high:g}; is another program using it, "
                f"its unit another{self._other_unit(temperature_K)}, or its sensor broken?"
            )
        return temperature_K

    def _usual(self, temperature_K: float) -> bool:
        """True for a temperature between that of a room and the limits."""
        low, high = self._settings.limits_K
        return min(low, _ROOM_K[0]) <= temperature_K <= max(_OVERSHOOT * high, _ROOM_K[1])

    def _other_unit(self, got_K: float, fits: Callable[[float], bool] | None = None) -> str:
        """Text of the units in which the same number is a temperature that `fits`, by default a
        usual one: ` (fahrenheit: 295 K)`; empty if there is none."""
        number = from_kelvin(got_K, self._known_unit)
        kelvins = {unit: to_kelvin(number, unit) for unit in UNITS if unit != self._known_unit}
        texts = [f"{unit}: {at:.0f} K" for unit, at in kelvins.items() if (fits or self._usual)(at)]
        return f" ({', '.join(texts)})" if texts else ""

    def _check_unit_by(self, temperature_K: float) -> None:
        """Raises ConfigRejected if a reading is usual in another unit than the present one alone.

        In a body at the temperature of a room, this finds each unit in which it would become
        hotter than its set point.
        """
        fitting = self._other_unit(temperature_K)
        if fitting and not self._usual(temperature_K):
            raise ConfigRejected(
                f"background.settings.{self._unit_key}: {self._unit}: in it the reading "
                f"{from_kelvin(temperature_K, self._known_unit):.1f} is {temperature_K:.0f} K, "
                "neither a room's nor within limits_K; allowed: the unit at its front panel, which "
                f"the reading fits{fitting}"
            )

    def _confirmed(self, wanted_K: float, got_K: float) -> float:
        """Returns the set point as read back; raises ConfigRejected if it is not the wanted one."""
        if not abs(got_K - wanted_K) <= _AGREE_K:
            raise ConfigRejected(
                f"background: the set point reads back {got_K:.2f} K after {wanted_K:.2f} K was "
                "written; is the controller in local mode, or limited, or its unit another"
                f"{self._other_unit(got_K, lambda at: abs(at - wanted_K) < 1.0)}?"
            )
        self._setpoint.confirmed(f"{got_K:.1f} K")
        return got_K

    def _described(self, setpoint_K: float) -> str:
        """Describes the body for `make_safe`; a broken sensor does not keep it from being safe."""
        try:
            temperature = f"temperature {self.read_temperature():.1f} K"
        except OddAnswer:
            temperature = "no temperature"
        return f"set point {setpoint_K:.1f} K, {temperature}"

    def _prepare(self) -> None:
        self._check_unit_by(self.read_temperature())

    def _last_known(self) -> str:
        return str(self._setpoint)

    def set_setpoint(self, temperature_K: float) -> float:
        check_setpoint(self.limits, temperature_K)
        return self._aim(temperature_K)

    @abstractmethod
    def _aim(self, temperature_K: float) -> float:
        """Writes the set point, and returns it as read back."""
