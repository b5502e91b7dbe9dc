"""Whether light is kept: the weights of what is outside, and of an emission of 1 within, make 1.

In a medium and an enclosure at one temperature every line of sight sees the same radiance (second
law). The kernels therefore carry one number more a pixel: what the medium would add if it had the
enclosure's temperature. Nothing is scaled to make the sum 1; a trace whose sum is not is refused.

For `source` that number holds what would be wrong with the solution:

- the image's own rounding and what a cut-off would lose;
- the defect of the sweeps, measured: in a medium and an enclosure of radiance 1 they must find a
  mean radiance of 1 in every cell (`Sweeper.defect`, on a few directions);
- the residual with which the solver ended.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.errors import TransportError

_FEW = 10  # pixels that do not tell their noise


@dataclass(frozen=True)
class EnergyBalance:
    """How far the sum of weights is from 1.

    largest: departure of the worst pixel, with its sign; pixel: row and column of it. mean: over
    the pixels that see the medium. value: which of the two must keep within `bound`: "largest", or
    "mean" where every pixel has noise of its own.
    """

    largest: float
    mean: float
    pixel: tuple[int, int]
    bound: float
    value: str = "largest"

    @classmethod
    def of(
        cls,
        outside: NDArray[np.floating],
        within: NDArray[np.floating],
        *,
        bound: float,
        noise: float = 0.0,
    ) -> EnergyBalance:
        """From weights of the boundary (B, H, W) and the part from within (H, W).

        noise: 0, or the sums scatter from pixel to pixel without bias; `bound` then holds for their
        mean, with five of its standard errors on top. Fewer than ten pixels do not tell these;
        their mean may be off by `noise` at least.

        Raises:
            TransportError: the sum is not finite, or further than the bound from 1.
        """
        left = outside.sum(axis=0, dtype=np.float64) + within - 1.0
        known = np.isfinite(left)
        at = int(np.argmax(np.where(known, np.abs(left), np.inf)))
        row, column = divmod(at, left.shape[1])
        seen = left[(within != 0.0) & known]
        mean = float(seen.mean()) if seen.size else 0.0
        if noise and seen.size > 1:
            bound += 5.0 * float(seen.std(ddof=1)) / seen.size**0.5
        if noise and seen.size < _FEW:
            bound = max(bound, noise)
        value = "mean" if noise else "largest"
        found = cls(float(left.flat[at]), mean, (row, column), bound, value)
        bad = mean if noise else found.largest
        if not np.isfinite(found.largest) or not abs(bad) <= bound:
            raise TransportError(
                f"light is made or lost: weights and isothermal emission sum to 1 {bad:+.3g} "
                f"({value}), allowed is {bound:.2g}; worst is the pixel in row {row}, column "
                f"{column} with {found.largest:+.3g}. This trace cannot be trusted; try "
                "transport.precision: float64, and if that does not help another device"
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; `from_dict` reads it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> EnergyBalance:
        row, column = data["pixel"]
        return cls(**{**data, "pixel": (int(row), int(column))})
