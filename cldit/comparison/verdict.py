"""Conclusion of a comparison: effect with its interval, power, p, keys that differ, best cause."""

from __future__ import annotations

from dataclasses import dataclass

from cldit.comparison.causes import Cause
from cldit.comparison.chi_square import LEVEL, probability
from cldit.comparison.shown import Observable
from cldit.scene.keys import KeyDifference

_TWO_SIDED = 1.96  # standard errors of an interval of 95 %
_KEYS = 3  # that are named
_NOT_SEEN = ("name", "description", "rig", "plan", "optics.compare_paper")  # keys without effect


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Conclusion on the difference of two results.

    differs: True if the errors do not explain it; None: there is no test, and `reason` is the
    reason. region: part of the spray with the smallest p, or `all` if the errors explain the
    difference. effect: mean change of the observable in it, error: its standard error, both None
    without errors; rms: of the change. seen: change of all pixels that the test finds with a
    probability of 95 %. p_value: probability of a larger difference by the errors alone. keys: of
    the scenes, that differ. causes: the best, and those that explain as much within chance.
    at_least: True if the size of an error is unknown.
    """

    differs: bool | None
    reason: str = ""
    region: str = "all"
    observable: Observable = "T_app"
    effect: float | None = None
    error: float | None = None
    rms: float | None = None
    seen: float | None = None
    p_value: float | None = None
    keys: tuple[KeyDifference, ...] = ()
    causes: tuple[Cause, ...] = ()
    at_least: bool = False

    @property
    def interval(self) -> tuple[float, float] | None:
        """Limits of the effect with a probability of 95 %."""
        if self.effect is None or self.error is None:
            return None
        half = _TWO_SIDED * self.error
        return self.effect - half, self.effect + half

    @property
    def power(self) -> bool:
        """False if the stated errors are so large that no difference of this size is seen."""
        return self.p_value is None or self.p_value <= 1.0 - LEVEL

    @property
    def text(self) -> str:
        """Result of the test, effect and power in one sentence."""
        if self.p_value is None or self.interval is None:
            return self.reason
        if self.differs:
            start = f"differs in {self.region}" if self.region != "all" else "differs"
        else:
            start = "no difference is seen" if self.power else "no power"
        bound = ", with errors as far as they are known" if self.at_least else ""
        low, high = self.interval
        unit = " K" if self.observable == "T_app" else ""
        where = "" if self.region == "all" else f" in {self.region}"
        seen = (
            f"a change of all pixels is seen in 95 % of all cases from {self.seen:.2g}{unit} on"
            if self.seen is not None and self.seen < 1e3
            else "a change of all pixels is not seen, however large"
        )
        remark = "" if self.power else "; the stated errors are larger than all that differs"
        return (
            f"{start} ({probability(self.p_value)}{bound}): {self.observable}{where} "
            f"{self.effect:+.2g}{unit}, 95 % between {low:+.2g} and {high:+.2g}{unit}, "
            f"RMS {self.rms:.2g}{unit}; {seen}{remark}"
        )

    @property
    def lines(self) -> tuple[str, ...]:
        """The text after the keys that differ, and before the causes."""
        lines = [self.text]
        keys = [key for key in self.keys if not key.key.startswith(_NOT_SEEN)]
        if keys:
            further = f" and {len(keys) - _KEYS} more" if len(keys) > _KEYS else ""
            lines.insert(0, f"keys: {'; '.join(key.text for key in keys[:_KEYS])}{further}")
        if self.causes:
            best, *alternatives = self.causes
            rest = (
                "explains it"
                if best.p_value >= LEVEL
                else f"explains {100 * best.share:.0f} % of it"
            )
            lines.append(f"best cause: {best.text} ({rest})")
            if alternatives:
                lines.append(f"as good: {'; '.join(cause.text for cause in alternatives)}")
        elif self.differs:
            lines.append("no stated error, and no temperature of walls or background, explains it")
        return tuple(lines)
