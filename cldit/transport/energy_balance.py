"""Energy balance: the boundary's weights and an isothermal emission of 1 sum to 1 in every pixel.

In a medium and an enclosure at one temperature every line of sight has the same radiance (second
law). So the kernels carry one more plane: what the medium adds at the enclosure's temperature.
Nothing is scaled to make the sum 1; a trace whose sum is off is refused.

With method `source` the plane holds the errors of the solution (end of `trace_source`):

- rounding of the image, and what the cut-off leaves out;
- the measured defect of the sweeps: in a medium and an enclosure of radiance 1 they must find a
  mean radiance of 1 in every cell (`Sweeper.defect`, with few ordinates);
- the residual with which the solver ended.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.errors import TransportError

_FEW = 10  # pixels, too few to estimate their noise


@dataclass(frozen=True)
class EnergyBalance:
    """Departure of the sum of weights from 1.

    largest: signed departure of the worst pixel. mean: over the pixels that see the medium.
    pixel: row and column of the worst.
    bound: allowed for `value`, "largest", or "mean" where every pixel has noise of its own.
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
        """The balance of an image.

        Args:
            outside: (B, H, W) weights of the boundary.
            within: (H, W) what the medium adds at radiance 1.
            bound: allowed departure.
            noise: 0, or the sums scatter from pixel to pixel without bias. Then `bound` is for the
                mean, plus five of its standard errors. Fewer than ten pixels cannot tell these;
                `noise` is then the least bound.

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
        balance = cls(float(left.flat[at]), mean, (row, column), bound, value)
        bad = mean if noise else balance.largest
        if not np.isfinite(balance.largest) or not abs(bad) <= bound:
            raise TransportError(
                f"light is made or lost: weights and isothermal emission sum to 1 {bad:+.3g} "
                f"({value}), allowed is {bound:.2g}; worst is the pixel in row {row}, column "
                f"{column} with {balance.largest:+.3g}. This trace cannot be trusted; try "
                "transport.precision: float64, and if that does not help another device"
            )
        return balance

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; `from_dict` reads it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> EnergyBalance:
        """Reads `to_dict`."""
        row, column = data["pixel"]
        return cls(**{**data, "pixel": (int(row), int(column))})
