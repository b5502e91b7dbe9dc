"""Results on the same pixels, by averaging a trace onto coarser ones where necessary.

Radiances are averaged by area, as in a sensor (`cldit.camera.view`), and then evaluated; a mean of
temperatures would be a different quantity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.camera.curve import Curve
from cldit.camera.view import overlap_matrix
from cldit.comparison.shown import Shown
from cldit.dit.budget import Part
from cldit.dit.evaluate import evaluated, sensor_of
from cldit.dit.maps import Maps, Reason
from cldit.errors import EvaluationError
from cldit.optics.response import scene_filter
from cldit.radiance.weights import Weights

_SAME = 0.01  # of a pixel, over the whole image
_MOSTLY = 0.5  # share of the emissivity of a pixel that has a T_app
_ANY_K = 300.0  # where there is none


def same_pixels(baseline: Shown, compared: Shown, *, centred: bool = True) -> bool:
    """True if the pixels of both have the same positions, or sizes if not `centred`."""
    shape = baseline.maps.emissivity.shape
    if shape != compared.maps.emissivity.shape:
        return False
    drift = [
        abs(a - b) * count / b
        for a, b, count in zip(baseline.pixel_m, compared.pixel_m, reversed(shape), strict=True)
    ]
    return bool(max(*drift, *(_offsets(baseline, compared) if centred else ())) < _SAME)


def _offsets(baseline: Shown, compared: Shown) -> list[float]:
    """Distances of the centres, in pixels."""
    return [
        abs(a - b) / p
        for a, b, p in zip(baseline.centre_m, compared.centre_m, compared.pixel_m, strict=True)
    ]


def together(baseline: Shown, compared: Shown, *, centred: bool = True) -> tuple[Shown, Shown, str]:
    """Both on the same pixels, and a description of an average, empty without one.

    A trace is averaged onto the pixels of a recording, as by a rig; of two of a kind, the
    finer onto the pixels of the coarser one. centred: their centres must be the same. Raises
    EvaluationError if that is not possible.
    """
    if same_pixels(baseline, compared, centred=centred):
        return baseline, compared, ""
    grids = f"{baseline.name} has {baseline.grid}; {compared.name} has {compared.grid}"
    if (baseline.run is None) is (compared.run is None):
        swap = bool(np.prod(baseline.pixel_m) > np.prod(compared.pixel_m))
    else:
        swap = baseline.run is None
    trace, onto = (compared, baseline) if swap else (baseline, compared)
    averaged = _averaged(trace, onto, grids, centred=centred)
    averaged_baseline, averaged_compared = (onto, averaged) if swap else (averaged, onto)
    return averaged_baseline, averaged_compared, f"{trace.name} averaged onto {onto.grid}"


def _averaged(trace: Shown, onto: Shown, grids: str, *, centred: bool) -> Shown:
    if centred and max(_offsets(trace, onto)) > _SAME:
        raise EvaluationError(f"{grids}; the centres must be the same")
    rows, columns = onto.maps.emissivity.shape
    high, wide = trace.maps.emissivity.shape
    shares = (
        columns * onto.pixel_m[0] / (wide * trace.pixel_m[0]),
        rows * onto.pixel_m[1] / (high * trace.pixel_m[1]),
    )
    if max(shares) > 1.0 + 1e-6:
        raise EvaluationError(
            f"{grids}; the one that is averaged must cover the whole of the other image"
        )
    across = overlap_matrix(wide, columns, min(shares[0], 1.0))
    along = overlap_matrix(high, rows, min(shares[1], 1.0))

    def mean(image: NDArray[np.floating]) -> Floats:
        return np.asarray(along @ (across @ np.asarray(image, np.float64).T).T)

    if trace.run is None:
        squared = across.multiply(across), along.multiply(along)

        def mean_square(image: Floats) -> Floats:
            return np.asarray(squared[1] @ (squared[0] @ image.T).T)

        averaged = _averaged_recording(trace, grids, mean=mean, mean_square=mean_square)
        return replace(averaged, pixel_m=onto.pixel_m, centre_m=onto.centre_m)

    def means(weights: Weights) -> Weights:
        return weights.map(lambda image: mean(image).astype(np.float32))

    run = trace.run
    spectral = tuple(means(weights) for weights in run.spectral)
    reference = means(run.reference)
    sensor = sensor_of(run.scene, run.quadrature, (spectral, reference))
    maps = evaluated(run.scene, run.quadrature, spectral, reference, sensor)
    error_K, error = (
        None if image is None else _mean_known(image, mean)
        for image in (trace.error_map_K, trace.emissivity_error_map)
    )
    common = tuple(
        replace(part, kelvin=mean(part.kelvin), emissivity=mean(part.emissivity))
        for part in trace.common
    )
    return replace(
        trace,
        maps=maps,
        pixel_m=onto.pixel_m,
        centre_m=onto.centre_m,
        error_map_K=error_K,
        emissivity_error_map=error,
        common=common,
        run=None,
    )


def _averaged_recording(
    fine: Shown,
    grids: str,
    *,
    mean: Callable[[Floats], Floats],
    mean_square: Callable[[Floats], Floats],
) -> Shown:
    """A recording on coarser pixels: area means of emissivity and of the radiance of the spray.

    With E = e B(T_app), T_app is that of the means E / e over pixels that have one, and changes by
    mean(e B' dT) / (e B').
    `mean_square` sums with the squares of the weights, for independent errors of pixels.
    """
    scene = fine.scene or (fine.traced and fine.traced.scene)
    filter_um = scene_filter(scene) if scene else fine.filter_um
    if filter_um is None:
        raise EvaluationError(f"{grids}; the filter of {fine.name}, the finer one, is unknown")
    curve = Curve(filter_um=filter_um)
    kelvin = fine.maps.apparent_temperature_K.astype(np.float64)
    emissivity = np.nan_to_num(fine.maps.emissivity).astype(np.float64)
    has_kelvin = np.isfinite(kelvin)
    kelvin = np.where(has_kelvin, kelvin, _ANY_K)
    spray_radiance = np.where(has_kelvin, emissivity * curve.radiance(kelvin), 0.0)
    steep = np.where(has_kelvin, emissivity * curve.slope(kelvin), 0.0)
    mean_emissivity, warmed = mean(emissivity), mean(np.where(has_kelvin, emissivity, 0.0))
    seen = warmed > _MOSTLY * np.maximum(mean_emissivity, 1e-6)
    warm = curve.temperature(
        np.where(seen, mean(spray_radiance) / np.where(seen, warmed, 1.0), 0.0)
    )
    slope = np.where(seen, warmed * curve.slope(np.where(seen, warm, _ANY_K)), np.inf)

    def averaged(part: Part) -> Part:
        change = mean(steep * np.nan_to_num(part.kelvin)) / slope
        return replace(part, kelvin=change, emissivity=mean(np.nan_to_num(part.emissivity)))

    common = tuple(averaged(part) for part in fine.common)
    error_K, error, covariance = _averaged_errors(
        fine, common, steep, slope, mean_square=mean_square
    )
    nothing = np.full(mean_emissivity.shape, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.where(seen, covariance / (error * error_K), np.nan)
    images = {
        "emissivity": mean_emissivity,
        "apparent_temperature_K": np.where(seen, warm, np.nan),
        "emissivity_standard_error": error,
        "apparent_temperature_standard_error_K": np.where(seen, error_K, np.nan),
        "reduced_chi2": nothing,
        "fit_probability": nothing,
        "error_correlation": correlation,
    }
    reason = np.where(seen, Reason.OK, Reason.EMISSIVITY_TOO_LOW).astype(np.uint8)
    return replace(
        fine,
        maps=Maps(**{k: image.astype(np.float32) for k, image in images.items()}, reason=reason),
        error_map_K=None if fine.error_map_K is None else np.where(seen, error_K, np.nan),
        emissivity_error_map=None if fine.emissivity_error_map is None else error,
        common=common,
        systematic=tuple(averaged(part) for part in fine.systematic),
    )


def _averaged_errors(
    fine: Shown,
    common: Sequence[Part],
    steep: Floats,
    slope: Floats,
    *,
    mean_square: Callable[[Floats], Floats],
) -> tuple[Floats, Floats, Floats]:
    """Standard errors of T_app [K] and emissivity on coarser pixels, and their covariance.

    common: on these pixels. steep, slope: e B' on those of `fine`, and on these.
    """
    independent = fine.independent_variance()
    stated = fine.emissivity_error_map
    stated = fine.maps.emissivity_standard_error.astype(np.float64) if stated is None else stated
    of_e = np.nan_to_num(stated) ** 2
    of_e -= sum((np.nan_to_num(part.emissivity) ** 2 for part in fine.common), 0.0)
    square_e = mean_square(np.maximum(of_e, 0.0))
    square_e = square_e + sum((part.emissivity**2 for part in common), 0.0)
    error_K = np.full(slope.shape, np.nan)
    if independent is not None:
        error_K = mean_square(steep**2 * np.nan_to_num(independent)) / slope**2
        error_K = np.sqrt(error_K + sum((part.kelvin**2 for part in common), 0.0))
    covariance = mean_square(steep * np.nan_to_num(fine.independent_covariance_K)) / slope
    covariance = covariance + sum((part.kelvin * part.emissivity for part in common), 0.0)
    return error_K, np.sqrt(square_e), covariance


def _mean_known(error_K: Floats, mean: Callable[[Floats], Floats]) -> Floats:
    """Mean over the pixels that have an error; errors of neighbours are assumed to be the same."""
    finite = np.isfinite(error_K)
    share = mean(finite.astype(np.float64))
    total = mean(np.where(finite, error_K, 0.0))
    out: Floats = np.divide(total, share, out=np.full(share.shape, np.nan), where=share > 0)
    return out
