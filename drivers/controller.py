"""What the drivers of real black bodies share: limits, and the safe set point."""

from __future__ import annotations

from pydantic import model_validator

from cldit.rig.errors import ConfigRejected, OutOfLimits
from cldit.scene.checks import Section
from cldit.scene.values import Temperature

KELVIN = 273.15  # 0 °C
_AGREE_K = 0.1  # a set point may read back rounded to a tenth


class ControllerSettings(Section):
    limits_K: tuple[Temperature, Temperature]  # set points that the source may get
    safe_K: Temperature = 295.0  # set point when the rig is made safe; the nearest within limits

    @model_validator(mode="after")
    def _ordered(self) -> ControllerSettings:
        if self.limits_K[0] >= self.limits_K[1]:
            raise ValueError(f"limits_K: {self.limits_K} is empty; allowed is (low, high)")
        return self

    @property
    def safe_setpoint_K(self) -> float:
        low, high = self.limits_K
        return min(max(self.safe_K, low), high)


def check_limits(settings: ControllerSettings, temperature_K: float) -> None:
    """Raises OutOfLimits."""
    low, high = settings.limits_K
    if not low <= temperature_K <= high:
        raise OutOfLimits(f"background: {temperature_K:g} K is outside {low:g}..{high:g} K")


def check_readback(wanted_K: float, got_K: float) -> float:
    """`got_K`.

    Raises:
        ConfigRejected: it is another set point.
    """
    if not abs(got_K - wanted_K) <= _AGREE_K:
        raise ConfigRejected(
            f"background: the set point reads back {got_K:.2f} K after {wanted_K:.2f} K was "
            "written; is the controller in local mode, or limited?"
        )
    return got_K
