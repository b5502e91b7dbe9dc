"""Differences of two results in radiance, in standard errors, for least squares.

A pixel has two numbers, its emissivity e and its differential radiance, y = e (B(T_app) - x), with
a radiance x of each pixel. Unlike T_app they are linear in the light, also where the spray is thin.
Errors of T_app and emissivity change y by

    dy = e B'(T_app) dT + (r - x) de,    r = B(T_app)

and their covariance c, which the evaluation states, gives the x for which the errors of y and e are
independent:

    x = r + e B' c / var(e)

Camera noise alone puts it between the backgrounds (their middle, weighted by the noise), scatter of
the amount of spray, which leaves T_app as it is, at r. It is kept between the darkest and the
brightest of these. Where c is unknown, the largest that is possible counts against y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.curve import Curve
from cldit.comparison.pixels import together
from cldit.comparison.shown import Shown
from cldit.comparison.tested import seen_in_both
from cldit.errors import EvaluationError
from cldit.optics.response import scene_filter
from cldit.radiance.boundary import Boundary, Surroundings

_LEAST = 0.01  # of (e B')^2 var(T_app): the correlation is that of an estimate
_LEAST_PIXELS = 4


@dataclass(frozen=True, kw_only=True)
class RadianceData:
    """Measured e and y (2, N) of the pixels `where` (H, W), with their errors.

    error: (2, N) independent of each other, those of the model included. modes: (M, 2, N) changes
    by one standard deviation of errors that all pixels share. middle: (N,) x of the module.
    """

    measured: Shown
    where: Mask
    curve: Curve
    middle: Floats
    values: Floats
    error: Floats
    modes: Floats

    @classmethod
    def of(cls, measured: Shown, model: Shown) -> RadianceData:
        """Data in the pixels of the spray that a model sees, with its errors of T_app.

        Raises:
            EvaluationError: too few pixels are visible in both, or no error is stated.
        """
        scene = model.scene
        assert scene is not None
        data, simulated, _ = together(measured, model)
        square_K2 = data.independent_variance()
        if square_K2 is None:
            raise EvaluationError(f"{measured.name}: no error of T_app is stated")
        spread = data.maps.emissivity_standard_error.astype(float) ** 2
        spread -= sum((np.nan_to_num(part.emissivity) ** 2 for part in data.common), 0.0)
        spread = np.maximum(spread, 0.0)
        where = seen_in_both(data, simulated).visible & np.isfinite(square_K2) & np.isfinite(spread)
        if np.count_nonzero(where) < _LEAST_PIXELS:
            raise EvaluationError(
                f"{measured.name} and {model.name}: {np.count_nonzero(where)} pixels of the spray "
                "are visible in both; is it the same view?"
            )
        curve = Curve(filter_um=scene_filter(scene))
        boundary = Boundary.in_filter(
            Surroundings.from_scene(scene),
            curve.filter_um,
            reference_K=float(np.median(scene.background.temperatures_K)),
        )
        kelvin = data.maps.apparent_temperature_K[where].astype(float)
        emissivity = data.maps.emissivity[where].astype(float)
        steep = emissivity * curve.slope(kelvin)
        middle, square_of_y = _independent(
            curve.radiance(kelvin),
            boundary.leaving(scene.background.temperatures_K),
            steep=steep,
            square_of_e=spread[where],
            square_of_t=square_K2[where],
            covariance=data.independent_covariance_K[where],
        )
        over = curve.radiance(kelvin) - middle
        error_K = simulated.error_map_K
        of_model = np.full(where.shape, simulated.error_K or 0.0) if error_K is None else error_K
        square_of_y = square_of_y + (steep * np.nan_to_num(of_model[where])) ** 2
        modes = []
        for part in (*data.common, *data.systematic):
            change = np.nan_to_num(part.emissivity[where])
            change_of_y = steep * np.nan_to_num(part.kelvin[where]) + over * change
            modes.append(np.stack([change, change_of_y]))
        return cls(
            measured=data,
            where=where,
            curve=curve,
            middle=middle,
            values=np.stack([emissivity, emissivity * over]),
            error=np.sqrt(np.stack([np.maximum(spread[where], 1e-12), square_of_y])),
            modes=np.array(modes).reshape(len(modes), 2, len(kelvin)),
        )

    def residuals(self, model: Shown) -> Floats:
        """Differences (2 N + M,) from a model in standard errors, whose sum of squares is the
        generalised chi-square: what the shared errors leave, and their sizes.

        A pixel that the model does not evaluate has no spray: e and y are 0.
        """
        _, seen, _ = together(self.measured, model)
        emissivity = np.nan_to_num(seen.maps.emissivity[self.where].astype(float))
        kelvin = seen.maps.apparent_temperature_K[self.where].astype(float)
        finite = np.isfinite(kelvin)
        over = self.curve.radiance(np.where(finite, kelvin, 300.0)) - self.middle
        y = np.where(finite, emissivity * over, 0.0)
        z = ((np.stack([emissivity, y]) - self.values) / self.error).ravel()
        b = (self.modes / self.error).reshape(len(self.modes), z.size)
        sizes = np.linalg.solve(np.eye(len(b)) + b @ b.T, b @ z)
        return np.concatenate([z - sizes @ b, sizes])


def _independent(
    radiance: Floats,
    leaving: Floats,
    *,
    steep: Floats,
    square_of_e: Floats,
    square_of_t: Floats,
    covariance: Floats,
) -> tuple[Floats, Floats]:
    """x and var(y) (N,) from r, e B', the variances of e and T_app, and their covariance.

    leaving: radiances of the backgrounds, which limit x.
    """
    largest = np.sqrt(square_of_e * square_of_t)
    covariance = np.clip(covariance, -largest, largest)
    finite = np.isfinite(covariance)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = np.where(finite, radiance + steep * covariance / square_of_e, leaving.mean())
    darkest, brightest = leaving.min(), np.maximum(leaving.max(), radiance)
    middle = np.clip(np.nan_to_num(middle), darkest, brightest)
    over = radiance - middle
    mixed = steep * np.where(finite, over * np.nan_to_num(covariance), np.abs(over) * largest)
    of_t = steep**2 * square_of_t
    return middle, np.maximum(of_t + over**2 * square_of_e + 2.0 * mixed, _LEAST * of_t)
