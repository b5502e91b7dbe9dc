"""Results on the same pixels, by averaging a trace onto coarser ones where necessary.

Radiances are averaged by area, as in a sensor (`cldit.camera.view`), and then evaluated; a mean of
temperatures would be a different quantity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cldit.camera.view import overlap_matrix
from cldit.comparison.shown import Shown
from cldit.dit.traced_maps import evaluated, sensor_of
from cldit.errors import EvaluationError
from cldit.radiance.weights import Weights

_SAME = 0.01  # of a pixel, over the whole image

Image = NDArray[np.float64]


def same_pixels(one: Shown, other: Shown, *, centred: bool = True) -> bool:
    """True if the pixels of both have the same positions, or sizes if not `centred`."""
    shape = one.maps.emissivity.shape
    if shape != other.maps.emissivity.shape:
        return False
    drift = [
        abs(a - b) * count / b
        for a, b, count in zip(one.pixel_m, other.pixel_m, reversed(shape), strict=True)
    ]
    return bool(max(*drift, *(_offsets(one, other) if centred else ())) < _SAME)


def _offsets(one: Shown, other: Shown) -> list[float]:
    """Distances of the centres, in pixels."""
    return [
        abs(a - b) / p for a, b, p in zip(one.centre_m, other.centre_m, other.pixel_m, strict=True)
    ]


def together(
    one: Shown, other: Shown, *, resample: bool, centred: bool = True
) -> tuple[Shown, Shown, str]:
    """Both on the same pixels, and a description of an average, empty if there was none.

    resample: average a trace onto the pixels of a recording, as a rig does; of two traces, the
    finer onto the pixels of the coarser one. centred: their centres must be the same. Raises
    EvaluationError if that is not allowed or not possible.
    """
    if same_pixels(one, other, centred=centred):
        return one, other, ""
    what = f"{one.name} has {one.grid}; {other.name} has {other.grid}"
    if not resample:
        raise EvaluationError(
            f"{what}; allowed: the same pixels, or --resample (resample=True), which averages "
            "a trace onto the other's pixels"
        )
    swap = one.run is None or (
        other.run is not None and np.prod(one.pixel_m) > np.prod(other.pixel_m)
    )
    trace, onto = (other, one) if swap else (one, other)
    averaged = _averaged(trace, onto, what, centred=centred)
    first, second = (onto, averaged) if swap else (averaged, onto)
    return first, second, f"{trace.name} averaged onto {onto.grid}"


def _averaged(trace: Shown, onto: Shown, what: str, *, centred: bool) -> Shown:
    if trace.run is None:
        raise EvaluationError(f"{what}; both were recorded: only a trace can be averaged")
    if centred and max(_offsets(trace, onto)) > _SAME:
        raise EvaluationError(f"{what}; the centres must be the same")
    rows, columns = onto.maps.emissivity.shape
    high, wide = trace.maps.emissivity.shape
    shares = (
        columns * onto.pixel_m[0] / (wide * trace.pixel_m[0]),
        rows * onto.pixel_m[1] / (high * trace.pixel_m[1]),
    )
    if max(shares) > 1.0 + 1e-6:
        raise EvaluationError(f"{what}; the trace must cover the whole of the other image")
    across = overlap_matrix(wide, columns, min(shares[0], 1.0))
    along = overlap_matrix(high, rows, min(shares[1], 1.0))

    def mean(image: NDArray[np.floating]) -> Image:
        return np.asarray(along @ (across @ np.asarray(image, np.float64).T).T)

    def means(weights: Weights) -> Weights:
        return weights.map(lambda image: mean(image).astype(np.float32))

    run = trace.run
    spectral = tuple(means(one) for one in run.spectral)
    reference = means(run.reference)
    sensor = sensor_of(run.scene, run.quadrature, (spectral, reference))
    maps = evaluated(run.scene, run.quadrature, spectral, reference, sensor)
    error_map_K = None if trace.error_map_K is None else _mean_known(trace.error_map_K, mean)
    common = tuple(
        replace(part, kelvin=mean(part.kelvin), emissivity=mean(part.emissivity))
        for part in trace.common
    )
    return replace(
        trace,
        maps=maps,
        pixel_m=onto.pixel_m,
        centre_m=onto.centre_m,
        error_map_K=error_map_K,
        common=common,
        run=None,
    )


def _mean_known(error_K: Image, mean: Callable[[Image], Image]) -> Image:
    """Mean over the pixels that have an error; errors of neighbours are assumed to be the same."""
    known = np.isfinite(error_K)
    share = mean(known.astype(np.float64))
    total = mean(np.where(known, error_K, 0.0))
    out: Image = np.divide(total, share, out=np.full(share.shape, np.nan), where=share > 0)
    return out
