"""Energy balance: the boundary's weights and an isothermal emission of 1 sum to 1 in every pixel.

In a medium and an enclosure at one temperature every line of sight has the same radiance (second
law). So the kernels compute one more plane: the light from within at the enclosure's temperature.
Nothing is scaled to make the sum 1; a trace with a wrong sum is refused.

With method `source` the sum shows the errors of the solution (end of `trace_source`):

- rounding of the image, and the light beyond the cut-off;
- the measured defect of the sweeps: in a medium and an enclosure of radiance 1 they must give a
  mean radiance of 1 in every cell (`Sweeper.defect`, with few ordinates);
- the final residual of the solver.
"""

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Reals
from cldit.errors import TransportError


@dataclass(frozen=True)
class EnergyBalance:
    """Departure of the sum of weights from 1.

    largest: signed departure of the worst pixel. mean: over the pixels that see the medium.
    pixel: row and column of the worst.
    bound: largest allowed `value`: "largest", or "mean" if pixels have independent noise.
    """

    largest: float
    mean: float
    pixel: tuple[int, int]
    bound: float
    value: str = "largest"

    @classmethod
    def of(
        cls,
        outside: Reals,
        within: Reals,
        *,
        bound: float,
        noise: float = 0.0,
    ) -> "EnergyBalance":
        """Balance of an image; raises TransportError if the sum is further than `bound` from 1.

        Args:
            outside: (B, H, W) weights of the boundary.
            within: (H, W) light from the medium at radiance 1.
            bound: allowed departure.
            noise: 0, or the sums scatter from pixel to pixel without bias. Then `bound` is for the
                mean, plus five of its standard errors. These cannot be estimated from fewer than
                ten pixels; `noise` is then the smallest bound.
        """
        departure = outside.sum(axis=0, dtype=np.float64) + within - 1.0
        finite = np.isfinite(departure)
        at = int(np.argmax(np.where(finite, np.abs(departure), np.inf)))
        row, column = divmod(at, departure.shape[1])
        seen = departure[(within != 0.0) & finite]
        mean = float(seen.mean()) if seen.size else 0.0
        if noise and seen.size > 1:
            bound += 5.0 * float(seen.std(ddof=1)) / seen.size**0.5
        if noise and seen.size < 10:
            bound = max(bound, noise)
        value = "mean" if noise else "largest"
        balance = cls(float(departure.flat[at]), mean, (row, column), bound, value)
        bad = mean if noise else balance.largest
        if not np.isfinite(balance.largest) or not abs(bad) <= bound:
            raise TransportError(
                f"energy is not conserved: weights and isothermal emission sum to 1 {bad:+.3g} "
                f"({value}); allowed: {bound:.2g}; the worst pixel, in row {row}, column {column}, "
                f"has {balance.largest:+.3g}. Do not use this trace; set transport.precision: "
                "float64, or try another device"
            )
        return balance
