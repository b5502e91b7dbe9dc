"""The calibration curve: black-body temperature -> radiance in the camera's filter, and back.

It follows from Planck's law over the filter and the detector (`Curve(filter_um)`). For a filter
that is known only approximately, the references of the recording correct it (`fit_curve`). Planck's
law depends on wavelength times temperature, so a filter with all wavelengths longer by a factor f
has the curve B(f T), up to a constant that cancels in the fit of each pixel. A single parameter is
fitted, so three backgrounds suffice, and extrapolation follows Planck's law.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import EvaluationError
from cldit.optics.planck import (
    band_radiance,
    band_radiance_slope,
    temperature_of_radiance,
    temperature_slope_of_radiance,
)
from cldit.optics.response import Filter, edges_um

_FARTHEST = 0.3  # largest relative stretch of the wavelengths
_POOREST_K = 5.0  # largest residual of the references


@dataclass(frozen=True, kw_only=True)
class Curve:
    """B(stretch T) over a filter; `stretch` 1 is Planck's law over the filter as given."""

    filter_um: Filter
    stretch: float = 1.0

    def radiance(self, temperature_K: ArrayLike) -> Floats:
        """Photons s-1 m-2 sr-1 of a black body, any shape."""
        given_K = np.asarray(temperature_K, np.float64)
        return band_radiance(self.stretch * given_K, filter_um=self.filter_um)

    def slope(self, temperature_K: ArrayLike) -> Floats:
        """d radiance / d T, any shape."""
        given_K = np.asarray(temperature_K, np.float64)
        rise = band_radiance_slope(self.stretch * given_K, filter_um=self.filter_um)
        return np.asarray(self.stretch * rise)

    def temperature(self, radiance: ArrayLike) -> Floats:
        """The inverse of `radiance`, any shape; K."""
        given_K = temperature_of_radiance(radiance, filter_um=self.filter_um)
        return np.asarray(given_K / self.stretch)

    def temperature_slope(self, radiance: ArrayLike) -> Floats:
        """d T / d radiance, any shape."""
        rise = temperature_slope_of_radiance(radiance, filter_um=self.filter_um)
        return np.asarray(rise / self.stretch)


@dataclass(frozen=True, kw_only=True)
class CurveFit:
    """A curve fitted to references.

    stretch_error: one standard deviation, from the residuals; 0 with three backgrounds.
    residual_K: (K,) residual of each background.
    """

    curve: Curve
    stretch_error: float
    residual_K: tuple[float, ...]

    @property
    def text(self) -> str:
        """One line for the report."""
        low, high = (self.curve.stretch * edge for edge in edges_um(self.curve.filter_um))
        worst = max(abs(off_K) for off_K in self.residual_K)
        return (
            f"wavelengths {self.curve.stretch:.4f} ± {self.stretch_error:.4f} times the filter's "
            f"({low:.3f} to {high:.3f} um), references within {worst:.2g} K"
        )


def fit_curve(temperature_K: Floats, counts: Floats, *, filter_um: Filter) -> CurveFit:
    """Fits the curve to `counts` (K,) of references at black-body temperatures (K,), K >= 3.

    It is a least-squares fit, in kelvin, of gain, offset and stretch to means over the pixels that
    see the background. Emission of windows and surroundings is part of the offset, losses are part
    of the gain.
    """
    if len(set(temperature_K.tolist())) < 3:
        raise EvaluationError(
            f"calibration: fitted to {len(set(temperature_K.tolist()))} backgrounds; allowed: at "
            "least three, or --calibration planck"
        )

    def line(stretch: float) -> tuple[Floats, float]:
        """Residuals in kelvin, and the gain."""
        curve = Curve(filter_um=filter_um, stretch=stretch)
        radiance, per_radiance = curve.radiance(temperature_K), 1.0 / curve.slope(temperature_K)
        unit = float(np.max(radiance))
        matrix = np.stack([radiance / unit * per_radiance, per_radiance], axis=1) / np.max(
            per_radiance
        )
        (gain, offset), *_ = np.linalg.lstsq(
            matrix, counts * per_radiance / np.max(per_radiance), rcond=None
        )
        off = (counts - gain * radiance / unit - offset) * per_radiance
        return np.asarray(off * unit / gain), float(gain)

    def residuals(free: Floats) -> Floats:
        return line(float(free[0]))[0]

    solution = scipy.optimize.least_squares(
        residuals,
        [1.0],
        bounds=([1.0 - _FARTHEST], [1.0 + _FARTHEST]),
        x_scale=0.01,
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    stretch = float(solution.x[0])
    residual, gain = line(stretch)
    if not (gain > 0.0 and np.max(np.abs(residual)) < _POOREST_K) or solution.active_mask[0]:
        raise EvaluationError(
            f"calibration: the references do not lie on the curve of any filter within "
            f"{100 * _FARTHEST:.0f} % of the given one (off by {np.max(np.abs(residual)):.3g} K); "
            "check the backgrounds' temperatures, or use --calibration planck"
        )
    spare = len(residual) - 3
    variance = float(residual @ residual) / spare if spare > 0 else 0.0
    curvature = float(np.sum(np.asarray(solution.jac) ** 2))
    return CurveFit(
        curve=Curve(filter_um=filter_um, stretch=stretch),
        stretch_error=float(np.sqrt(variance / curvature)) if curvature > 0 else 0.0,
        residual_K=tuple(residual.tolist()),
    )
