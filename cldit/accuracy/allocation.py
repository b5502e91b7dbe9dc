"""Error allocation: the tolerance is divided among the sources by what a smaller error costs.

Sources that the scene fixes take no share. They bound what is worth the cost: if they alone exceed
the tolerance, free sources that add little to them are small enough.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from cldit.accuracy.errors import Estimate
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.accuracy.sources.base import ErrorSource
from cldit.optics.tolerance import kelvin_per_emissivity
from cldit.scene import Scene

# The trace and the wavelengths usually end up below their shares. Cells can only be halved, at
# eight times the cost, so they may have what others are likely to leave.
_LIKELY = 0.6
# Predicted errors may leave cells next to nothing. At half of its share they are eight times as
# many; an error that is still too large is stated.
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

    tolerance_K: RMS error of T_app asked for. per_emissivity_K: see `kelvin_per_emissivity`.
    free_K: error that all free sources may have together; shares_K: each of them. predicted_K:
    errors that sources will have, whatever their share. fixed: those of them that no resolution
    makes smaller, True for an upper bound; None before they are known.
    """

    tolerance_K: float
    free_K: float
    shares_K: Mapping[str, float]
    predicted_K: Mapping[str, float] = field(default_factory=dict)
    fixed: Mapping[str, bool] | None = None
    per_emissivity_K: float = 1.0

    @classmethod
    def of(cls, scene: Scene, tolerance_K: float) -> Allocation:
        """All of the tolerance to the free sources."""
        per_emissivity_K = kelvin_per_emissivity(scene)
        shares_K = _shares(scene, tolerance_K)
        return cls(tolerance_K, tolerance_K, shares_K, per_emissivity_K=per_emissivity_K)

    @property
    def emissivity(self) -> float:
        """RMS error of emissivity asked for."""
        return self.tolerance_K / self.per_emissivity_K

    def __getitem__(self, name: str) -> float:
        """Share of a source; the error of all free sources where it has none."""
        return self.shares_K.get(name, self.free_K)

    @property
    def target_K(self) -> float:
        """Total error that is worth its cost: the tolerance, or the fixed errors with little added.

        With F the fixed errors and R the rest, their sum falls by R^2 / (F^2 + R^2) per cent if R
        falls by one, while the cost grows by as many per cent whatever F is. Upper bounds do not
        count as F.
        """
        least_K2 = 0.0
        for name, at_most in (self.fixed or {}).items():
            least_K2 += (1.0 if at_most else 1.0 + IN_VAIN) * self.predicted_K.get(name, 0.0) ** 2
        return float(max(self.tolerance_K, least_K2**0.5))

    def with_known(self, scene: Scene, estimates: Iterable[Estimate]) -> Allocation:
        """Adds the estimates of sources that are not free.

        Predicted errors of rays and ordinates that the scene sets count as fixed, too.
        """
        free = free_sources(scene)
        errors_K, fixed = {}, {name: False for name in ("pixel sampling", "trace")}
        for estimate in estimates:
            if estimate.cause.error_K is not None:  # of T_app: that of emissivity bounds no other
                errors_K[estimate.cause.name] = estimate.cause.error_K
                fixed[estimate.cause.name] = estimate.cause.at_most
        fixed = {name: at_most for name, at_most in fixed.items() if name not in free}
        return replace(self, predicted_K={**self.predicted_K, **errors_K}, fixed=fixed)

    def allocated(self, scene: Scene) -> Allocation:
        """Shares of what the known errors leave, never less than before."""
        left_K2 = self.target_K**2 - sum(error_K**2 for error_K in self.predicted_K.values())
        free_K = max(left_K2, self.tolerance_K**2) ** 0.5
        return replace(self, free_K=free_K, shares_K=_shares(scene, free_K))

    @property
    def cells_K(self) -> float:
        """Error that the cells may have: what the other sources are likely to leave."""
        least_K = _LEAST_OF_SHARE * self.shares_K["cells"]
        others_K = (error_K for name, error_K in self.likely_K.items() if name != "cells")
        left_K2 = self.target_K**2 - sum(error_K**2 for error_K in others_K)
        return float(max(left_K2, least_K**2) ** 0.5)

    @property
    def likely_K(self) -> dict[str, float]:
        """Errors that sources will have: as predicted, else a part of their share."""
        likely_K = {name: _LIKELY * share_K for name, share_K in self.shares_K.items()}
        return likely_K | {**self.predicted_K}

    def to_dict(self) -> dict[str, Any]:
        """Plain data for run.json."""
        return {
            "wanted_K": self.tolerance_K,
            "wanted_emissivity": self.emissivity,
            "shares_K": dict(self.shares_K),
            "foretold_K": dict(self.predicted_K),
            "fixed": None if self.fixed is None else dict(self.fixed),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Allocation:
        """Reads the result of `to_dict`; raises KeyError where it is damaged."""
        wanted_K = data["wanted_K"]
        stored = data["shares_K"], data["foretold_K"], data["fixed"]
        return cls(wanted_K, wanted_K, *stored, wanted_K / data.get("wanted_emissivity", wanted_K))


def _shares(scene: Scene, free_K: float) -> dict[str, float]:
    return split(free_K, {name: BY_NAME[name] for name in free_sources(scene)})
