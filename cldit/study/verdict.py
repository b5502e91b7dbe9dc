"""Whether a number is what a paper says; computed from the number, never written."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One statement of the paper beside what was found.

    value: what was found, in `unit`; NaN where nothing could be found, which agrees with nothing.
    low, high: between which it agrees; None is open. why: the reason where it does not agree.
    """

    claim: str
    value: float
    unit: str = ""
    low: float | None = None
    high: float | None = None
    why: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the number is within the bounds."""
        if not math.isfinite(self.value):
            return False
        above = self.low is None or self.value >= self.low
        return above and (self.high is None or self.value <= self.high)

    @property
    def found(self) -> str:
        """The number with its unit."""
        return _with_unit(self.value, self.unit) if math.isfinite(self.value) else "no value"

    @property
    def allowed(self) -> str:
        """What would agree."""
        if self.low is not None and self.high is not None:
            if self.low == -self.high:
                return f"±{_with_unit(self.high, self.unit)}"
            return f"{self.low:g} to {_with_unit(self.high, self.unit)}"
        if self.high is not None:
            return f"at most {_with_unit(self.high, self.unit)}"
        return f"at least {_with_unit(self.low or 0.0, self.unit)}"

    @property
    def word(self) -> str:
        """`agrees` or `disagrees`."""
        return "agrees" if self.agrees else "disagrees"


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".rstrip()


def summary(verdicts: tuple[Verdict, ...]) -> str:
    """One sentence."""
    agreed = sum(each.agrees for each in verdicts)
    if agreed == len(verdicts):
        return f"All {agreed} statements agree."
    return f"{agreed} of {len(verdicts)} statements agree."
