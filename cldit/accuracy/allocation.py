"""Error allocation: the tolerance is divided among the sources by what a smaller error costs.

Sources that the scene fixes take no share. They bound what is worth the cost: if they alone exceed
the tolerance, free sources that add little to them are small enough.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cldit.accuracy.errors import Estimate
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.accuracy.sources.base import ErrorSource
from cldit.optics.tolerance import kelvin_per_emissivity
from cldit.scene import Scene

# Of its share, which other sources than cells usually have. Cells get what these leave.
_LIKELY = 0.6
# Of their share, which cells have at least, whatever the fixed errors are.
_LEAST_OF_SHARE = 0.5
# Contribution of the free sources to the square of the fixed ones. By the cost powers of all
# sources the cost grows as the error to the power -5.5. The sum is then 5 % above the fixed
# errors alone, and one per cent of it costs (1 + 10) times as much as without fixed errors.
IN_VAIN = 0.1


def split(tolerance_K: float, sources: Mapping[str, ErrorSource]) -> dict[str, float]:
    """Error allowed to each source at the least total cost; the squares sum to the tolerance's.

    Independent errors add up in squares, sum(e_i^2) = E^2. With a Lagrange multiplier m for that
    constraint, the cost C is least where -dC/de_i = 2 m e_i. With p_i the cost power of source i,
    and C_i the part of the cost that it scales, -dC/de_i = p_i C_i / e_i, so e_i^2 is proportional
    to p_i C_i. Sources that multiply each other's cost all scale the whole of it: for these e_i^2
    is proportional to p_i alone.
    """
    total = sum(source.cost_power * source.cost_share for source in sources.values())
    return {
        name: tolerance_K * (source.cost_power * source.cost_share / total) ** 0.5
        for name, source in sources.items()
    }


def shares_of(left_K2: float, errors_K: Mapping[str, float]) -> dict[str, float]:
    """Shares of a sum of squares; a source within its share leaves the rest to the others."""
    shares_K = dict(errors_K)
    # In the order of the list, so that sums are the same to the bit in every run.
    open_ = [source.name for source in SOURCES if source.name in errors_K]
    while open_:
        limits_K = split(left_K2**0.5, {name: BY_NAME[name] for name in open_})
        within = [name for name in open_ if errors_K[name] <= limits_K[name]]
        if not within:
            return shares_K | limits_K
        left_K2 -= sum(errors_K[name] ** 2 for name in within)
        open_ = [name for name in open_ if name not in within]
    return shares_K


def free_sources(scene: Scene) -> tuple[str, ...]:
    """Names of the sources whose error the scene leaves to choice."""
    return tuple(source.name for source in SOURCES if source.is_free(scene))


@dataclass(frozen=True)
class Allocation:
    """Errors that the sources of a scene may have.

    tolerance_K: RMS error of T_app asked for. shares_K: of each free source. cells_K: of the cells,
    by what other sources are likely to leave. per_emissivity_K: see `kelvin_per_emissivity`.
    fixed_K: errors that no resolution makes smaller.
    """

    tolerance_K: float
    shares_K: Mapping[str, float]
    cells_K: float = 0.0
    per_emissivity_K: float = 1.0
    fixed_K: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene, tolerance_K: float, fixed: Iterable[Estimate] = ()) -> Allocation:
        """Shares for a tolerance, or for `fixed` errors with little added, if these exceed it.

        With F the fixed errors and R the rest, their sum falls by R^2 / (F^2 + R^2) per cent if R
        falls by one, while the cost grows by as many per cent whatever F is. Upper bounds do not
        count as F. The shares are never less than those of the tolerance.
        """
        causes = [e.cause for e in fixed if e.cause.error_K is not None]  # emissivity bounds none
        fixed_K = {cause.name: cause.error_K or 0.0 for cause in causes}
        fixed_K2 = sum(error_K**2 for error_K in fixed_K.values())
        large_K2 = sum((cause.error_K or 0.0) ** 2 for cause in causes if not cause.at_most)
        left_K2 = max(tolerance_K**2 - fixed_K2, IN_VAIN * large_K2)
        sources = {name: BY_NAME[name] for name in free_sources(scene)}
        free_K = max(left_K2, tolerance_K**2) ** 0.5
        shares_K = split(free_K, sources)
        share_K = shares_K.get("cells", 0.0)
        likely_K2 = left_K2 * (1.0 - _LIKELY**2 * (1.0 - (share_K / free_K) ** 2))
        cells_K = max(likely_K2, (_LEAST_OF_SHARE * share_K) ** 2) ** 0.5
        return cls(tolerance_K, shares_K, cells_K, kelvin_per_emissivity(scene), fixed_K)

    @property
    def emissivity(self) -> float:
        """RMS error of emissivity asked for."""
        return self.tolerance_K / self.per_emissivity_K

    def __getitem__(self, name: str) -> float:
        """Share of a source; the tolerance where it has none."""
        return self.shares_K.get(name, self.tolerance_K)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for run.json."""
        return {
            "wanted_K": self.tolerance_K,
            "wanted_emissivity": self.emissivity,
            "shares_K": dict(self.shares_K),
            "fixed_K": dict(self.fixed_K),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Allocation:
        """Reads the result of `to_dict`; raises KeyError where it is damaged."""
        wanted_K = data["wanted_K"]
        per_emissivity_K = wanted_K / data.get("wanted_emissivity", wanted_K)
        return cls(wanted_K, data["shares_K"], per_emissivity_K=per_emissivity_K)
