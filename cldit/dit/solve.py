"""From mean signals before each background to the maps, pixel by pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from cldit.camera.curve import Curve
from cldit.dit.fit import Pair, apparent_radiance, emissivity, fit_pair, shot_scatter
from cldit.dit.maps import Maps, Reason

Floats = NDArray[np.float64]

VISIBLE = 0.5  # share of the disc's radiance that a pixel must see without spray
DETECTION = 3.0  # an emissivity of fewer standard errors is not told from zero ...
LEAST_EMISSIVITY = 1e-4  # ... nor is one below the accuracy of a trace


@dataclass(frozen=True)
class Signals:
    """What pixels (...) saw before K backgrounds, as radiance, photons s-1 m-2 sr-1.

    source: (K,) radiance that left the background disc.
    mean: (K, ...) mean over the exposures.
    camera: variance of one exposure by the camera's noise, of any signals.
    exposures: (K,) how many; less where some count less than others.
    observed: (K, ...) sample variance of one exposure; 0 where there is only one.
    """

    source: Floats
    mean: Floats
    camera: Callable[[Floats], Floats]
    exposures: Floats
    observed: Floats | None = None


def solve(
    reference: Signals,
    injection: Signals,
    *,
    usable: NDArray[np.bool_],
    curve: Curve,
    shared: Floats | None = None,
) -> Maps:
    """Maps of the pixels (...).

    Standard errors come from the camera's noise and, for the injections, from the scatter observed
    between shots beyond it (`shot_scatter`; needs two shots before a background, and is then never
    below the camera's own noise). References are taken to scatter by the camera's noise alone.

    The lines are fitted twice: the second time with the camera's noise at the fitted signals, since
    noise taken from noisy counts would favour those that came out low.

    Args:
        reference, injection: means (K, ...) before each background, without and with spray.
        usable: (K, ...) False where a pixel's signal before that background must not be used.
        curve: black-body temperature to radiance.
        shared: (K,) variance of the background's radiance, common to both kinds; None: exact.
    """
    shape = usable.shape[1:]
    usable = usable & np.isfinite(reference.mean) & np.isfinite(injection.mean)
    usable = usable.reshape(len(usable), -1)

    def flat(image: Floats) -> Floats:
        return np.where(usable, image.reshape(usable.shape), 0.0)

    source = (reference.source, injection.source)
    mean = (flat(reference.mean), flat(injection.mean))
    exposures = (reference.exposures[:, None], injection.exposures[:, None])
    common = np.zeros(len(usable)) if shared is None else shared
    still = np.ones(usable.shape[1])

    def fit(signals: tuple[Floats, Floats], extra: Floats, slopes: tuple[Floats, Floats]) -> Pair:
        calm, varied = reference.camera(signals[0]), injection.camera(signals[1]) + extra
        return fit_pair(
            source,
            mean,
            variance=(calm / exposures[0], varied / exposures[1]),
            usable=usable,
            shared=common,
            slopes=slopes,
        )

    lines = fit(mean, np.zeros_like(mean[0]), (still, still))
    fitted = tuple(np.nan_to_num(one) for one in lines.at(source))
    extra = np.zeros_like(mean[0])
    if injection.observed is not None and np.any(injection.exposures > 1):
        extra = shot_scatter(
            fitted[1] - fitted[0],
            flat(injection.observed),
            camera=injection.camera(fitted[1]),
            degrees=np.where(usable, exposures[1] - 1.0, 0.0),
        )
    g, _, s, _ = np.nan_to_num(lines.values.T)
    lines = fit((fitted[0], fitted[1]), extra, (g, s))
    return _maps(lines, backgrounds=usable.sum(axis=0), curve=curve, shape=shape)


def _maps(
    lines: Pair, *, backgrounds: NDArray[np.int_], curve: Curve, shape: tuple[int, ...]
) -> Maps:
    epsilon, epsilon_variance = emissivity(lines)
    radiance, radiance_variance = apparent_radiance(lines)
    epsilon_error = np.sqrt(epsilon_variance)
    reason = np.zeros(backgrounds.shape, np.uint8)
    # The first that holds is the reason; comparisons with NaN are False, hence the negations.
    reason[~(radiance >= 0.0)] = Reason.NEGATIVE_RADIANCE
    clear = np.maximum(DETECTION * epsilon_error, LEAST_EMISSIVITY)
    reason[~(epsilon > clear)] = Reason.EMISSIVITY_TOO_LOW
    reason[~(lines.values[:, 0] >= VISIBLE)] = Reason.BACKGROUND_NOT_VISIBLE
    reason[backgrounds < 2] = Reason.TOO_FEW_BACKGROUNDS
    seen = (reason == Reason.OK) | (reason >= Reason.EMISSIVITY_TOO_LOW)
    warm = np.where(reason == Reason.OK, radiance, np.nan)
    temperature = curve.temperature(warm)
    with np.errstate(invalid="ignore"):  # 0 K: infinite slope, times an error that may be 0
        temperature_error = np.sqrt(radiance_variance) * curve.temperature_slope(warm)
    degrees = 2 * backgrounds - 4
    spare = seen & (degrees > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        reduced = np.where(spare, lines.chi2 / degrees, np.nan)
        chance = np.where(spare, chdtrc(np.maximum(degrees, 1), lines.chi2), np.nan)

    def image(value: Floats) -> NDArray[np.float32]:
        return value.astype(np.float32).reshape(shape)

    return Maps(
        emissivity=image(np.where(seen, epsilon, np.nan)),
        apparent_temperature_K=image(temperature),
        emissivity_standard_error=image(np.where(seen, epsilon_error, np.nan)),
        apparent_temperature_standard_error_K=image(temperature_error),
        reason=reason.reshape(shape),
        reduced_chi2=image(reduced),
        fit_probability=image(chance),
    )
