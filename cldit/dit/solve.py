"""From mean signals before each background to the maps, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.dit.fit import Line, apparent_radiance, emissivity, fit_line, shot_scatter
from cldit.dit.maps import Maps, Reason
from cldit.optics.planck import temperature_of_radiance, temperature_slope_of_radiance
from cldit.optics.response import Filter

Floats = NDArray[np.float64]

VISIBLE = 0.5  # share of the disc's radiance that a pixel must see without spray
DETECTION = 3.0  # an emissivity of fewer standard errors is not told from zero ...
LEAST_EMISSIVITY = 1e-4  # ... nor is one below the accuracy of a trace


@dataclass(frozen=True)
class Signals:
    """What pixels (...) saw before K backgrounds, as radiance, photons s-1 m-2 sr-1.

    source: (K,) radiance that left the background disc.
    mean: (K, ...) mean over the exposures.
    camera: (K, ...) variance of one exposure by the camera's noise.
    exposures: (K,) how many.
    observed: (K, ...) sample variance of one exposure; 0 where there is only one.
    """

    source: Floats
    mean: Floats
    camera: Floats
    exposures: Floats
    observed: Floats | None = None


def solve(
    reference: Signals,
    injection: Signals,
    *,
    usable: NDArray[np.bool_],
    filter_um: Filter,
) -> Maps:
    """Maps of the pixels (...).

    Standard errors come from the camera's noise and, for the injections, from the scatter observed
    between shots beyond it (`shot_scatter`; needs two shots before a background, and is then never
    below the camera's own noise). References are taken to scatter by the camera's noise alone.

    Args:
        usable: (K, ...) False where a pixel's signal before that background must not be used.
    """
    usable = usable & np.isfinite(reference.mean) & np.isfinite(injection.mean)
    column = (-1,) + (1,) * (usable.ndim - 1)
    calm = np.where(usable, reference.camera, 0.0) / reference.exposures.reshape(column)
    shots = injection.exposures.reshape(column)
    noise = np.where(usable, injection.camera, 0.0)
    lines = _Lines(
        source=(reference.source.reshape(column), injection.source.reshape(column)),
        mean=(np.where(usable, reference.mean, 0.0), np.where(usable, injection.mean, 0.0)),
        usable=usable,
    )
    varied = noise / shots
    fits = lines.fit(calm, varied)
    if injection.observed is not None and np.any(injection.exposures > 1):
        difference = np.nan_to_num(lines.difference(fits))
        extra = shot_scatter(
            difference,
            np.where(usable, injection.observed, 0.0),
            camera=noise,
            degrees=np.where(usable, shots - 1.0, 0.0),
        )
        varied = (noise + extra) / shots
        fits = lines.fit(calm, varied)
    chi2 = lines.reduced_chi2(fits, calm + varied)
    return _maps(fits, chi2, enough=usable.sum(axis=0) >= 2, filter_um=filter_um)


@dataclass(frozen=True)
class _Lines:
    """The two fits, (reference, injection), with common weights."""

    source: tuple[Floats, Floats]
    mean: tuple[Floats, Floats]
    usable: NDArray[np.bool_]

    def fit(self, calm: Floats, varied: Floats) -> tuple[Line, Line]:
        noisy = calm + varied
        # Without any noise all backgrounds count alike.
        weight = np.where(self.usable, 1.0 / np.where(noisy > 0, noisy, 1.0), 0.0)
        before, during = (
            fit_line(x, y, weight=weight, variance=variance)
            for x, y, variance in zip(self.source, self.mean, (calm, varied), strict=True)
        )
        return before, during

    def difference(self, fits: tuple[Line, Line]) -> Floats:
        """Fitted Delta I before the injections' backgrounds."""
        before, during = fits
        return during.at(self.source[1]) - before.at(self.source[1])

    def reduced_chi2(self, fits: tuple[Line, Line], variance: Floats) -> Floats:
        before, during = fits
        off = self.mean[1] - during.at(self.source[1]) - self.mean[0] + before.at(self.source[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = np.where(self.usable, off**2 / variance, 0.0)
            degrees = self.usable.sum(axis=0) - 2
            return np.where(degrees > 0, terms.sum(axis=0) / degrees, np.nan)


def _maps(
    fits: tuple[Line, Line],
    chi2: Floats,
    *,
    enough: NDArray[np.bool_],
    filter_um: Filter,
) -> Maps:
    before, during = fits
    epsilon, epsilon_variance = emissivity(before, during)
    radiance, radiance_variance = apparent_radiance(before, during)
    epsilon_error = np.sqrt(epsilon_variance)
    reason = np.zeros(enough.shape, np.uint8)
    # The first that holds is the reason; comparisons with NaN are False, hence the negations.
    reason[~(radiance >= 0.0)] = Reason.NEGATIVE_RADIANCE
    clear = np.maximum(DETECTION * epsilon_error, LEAST_EMISSIVITY)
    reason[~(epsilon > clear)] = Reason.EMISSIVITY_TOO_LOW
    reason[~(before.slope >= VISIBLE)] = Reason.BACKGROUND_NOT_VISIBLE
    reason[~enough] = Reason.TOO_FEW_BACKGROUNDS
    seen = (reason == Reason.OK) | (reason >= Reason.EMISSIVITY_TOO_LOW)
    warm = np.where(reason == Reason.OK, radiance, np.nan)
    temperature = temperature_of_radiance(warm, filter_um=filter_um)
    with np.errstate(invalid="ignore"):  # 0 K: infinite slope, times an error that may be 0
        temperature_error = np.sqrt(radiance_variance) * temperature_slope_of_radiance(
            warm, filter_um=filter_um
        )
    return Maps(
        emissivity=np.where(seen, epsilon, np.nan).astype(np.float32),
        apparent_temperature_K=temperature.astype(np.float32),
        emissivity_standard_error=np.where(seen, epsilon_error, np.nan).astype(np.float32),
        apparent_temperature_standard_error_K=temperature_error.astype(np.float32),
        reason=reason,
        reduced_chi2=np.where(seen, chi2, np.nan).astype(np.float32),
    )
