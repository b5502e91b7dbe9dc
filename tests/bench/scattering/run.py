"""Errors of every estimator against the simulated truth, by class of pixels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.dit.maps import Maps
from cldit.gpu.device import Device
from cldit.scene import Scene
from tests.bench.scattering.estimators import Estimator, Knows, Said, estimators, seen
from tests.bench.scattering.models import LARGER, RIGHT, wrong_models
from tests.bench.scattering.truth import (
    Traced,
    through_second_filter,
    traced,
    with_plates,
)

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]

LEAST_EMISSIVITY = 0.2


@dataclass(frozen=True)
class Error:
    """Bias and RMS in K without noise; held: fraction of the pixels, with noise, whose stated
    bounds contain the truth."""

    bias_K: float
    rms_K: float
    held: float


@dataclass(frozen=True)
class Row:
    """Errors of one estimator over pixels with an emissivity of 0.2 or more.

    knows: its inputs. medium: against the temperature of all that emits; None for estimators of
    droplets alone. droplets: against the droplet temperature, where droplets emit more than vapour.
    noise_K: median standard error with the shots of the scene. width_K: median width of the bounds.
    answered: fraction of the pixels with a result. where: RMS by class of pixels.
    """

    method: str
    needs: str
    knows: Knows
    medium: Error | None
    droplets: Error
    noise_K: float
    width_K: float
    answered: float
    where: Mapping[str, float]


@dataclass(frozen=True)
class Study:
    """Rows, and images (H, W) of errors in K.

    wet: fraction of the pixels where droplets emit more than vapour. classes: fraction in each
    class of `Row.where`. second: the scene through the second filter.
    """

    rows: tuple[Row, ...]
    errors: Mapping[str, Floats]
    wet: float
    classes: Mapping[str, float]
    scene: Scene
    second: Scene


@dataclass(frozen=True)
class Truth:
    """Temperatures of the medium and of droplets, pixels that count, those where droplets emit
    more than vapour, and classes of pixels, (H, W) each."""

    medium_K: Floats
    droplets_K: Floats
    here: Mask
    wet: Mask
    classes: Mapping[str, Mask]

    @classmethod
    def of(cls, trace: Traced, maps: Maps) -> Truth:
        """Truth by the sources of `trace`; `maps` are those of plain DIT."""
        lit = trace.reference.background > 0.999
        epsilon = maps.emissivity
        here = lit & (epsilon >= LEAST_EMISSIVITY) & np.isfinite(maps.apparent_temperature_K)
        total = trace.weights.vapour.astype(float) + trace.weights.liquid
        share = trace.vapour_share + trace.liquid_share
        with np.errstate(divide="ignore", invalid="ignore"):
            medium_K = trace.curve.temperature(np.where(here, total / share, np.nan))
            liquid = np.where(here & (trace.liquid_share > 0.05), trace.liquid_share, np.nan)
            droplets_K = trace.curve.temperature(trace.weights.liquid / liquid)
            scattered = trace.scattered().share
            wet = here & (trace.liquid_share > trace.vapour_share) & np.isfinite(droplets_K)
            classes = {
                "emissivity below 0.5": here & (epsilon < 0.5),
                "less than 0.2 scattered": here & (scattered < 0.2),
                "0.2 to 0.5 scattered": here & (scattered >= 0.2) & (scattered < 0.5),
                "more than 0.5 scattered": here & (scattered >= 0.5),
            }
        return cls(medium_K, droplets_K, here, wet, classes)


def scattering_study(
    scene: Scene, device: Device, *, cache: Path, progress: Say | None = None
) -> Study:
    """Traces the scene and its models, and evaluates them by every estimator.

    Raises:
        EvaluationError: the scene cannot be varied, or has one background.
    """

    def one(name: str, model: Scene) -> Traced:
        if progress is not None:
            progress(f"trace: {name}")
        return traced(with_plates(model), device, cache)

    scenes = wrong_models(scene)
    models = {name: one(name, model) for name, model in scenes.items()}
    second = {
        name: one(f"{name}, second filter", through_second_filter(scenes[name]))
        for name in (RIGHT, LARGER)
    }
    return evaluated(models, second, scene)


def evaluated(models: Mapping[str, Traced], second: Mapping[str, Traced], scene: Scene) -> Study:
    """Runs all estimators; the model named `right` is the truth. `second`: other filter."""
    exact = seen(models[RIGHT], second[RIGHT])
    noisy = _noisy(exact)
    truth = Truth.of(models[RIGHT], exact["as it is"])
    every = estimators(models[RIGHT], models, second)
    said = {(estimator.method, estimator.needs): estimator.say(exact) for estimator in every}
    rows = tuple(
        _row(estimator, said[estimator.method, estimator.needs], estimator.say(noisy), truth)
        for estimator in every
    )
    plain = said["plain DIT", "nothing"].temperature_K
    share, alone = (
        said[method, f"model: {LARGER}"].temperature_K
        for method in ("scattered share", "droplets alone")
    )
    errors = {
        "plain DIT - what emits": plain - truth.medium_K,
        f"scattered share, {LARGER} - what emits": share - truth.medium_K,
        "plain DIT - droplets": np.where(truth.wet, plain - truth.droplets_K, np.nan),
        f"droplets alone, {LARGER} - droplets": np.where(
            truth.wet, alone - truth.droplets_K, np.nan
        ),
    }
    number = int(truth.here.sum())
    classes = {name: float(mask.sum() / number) for name, mask in truth.classes.items()}
    wet = float(truth.wet.sum() / number)
    return Study(rows, errors, wet, classes, scene, second[RIGHT].scene)


def _row(estimator: Estimator, exact: Said, noisy: Said, truth: Truth) -> Row:
    after_K = truth.droplets_K if estimator.about == "droplets" else truth.medium_K
    known = truth.here & np.isfinite(exact.temperature_K)
    seen = known & truth.wet if estimator.about == "droplets" else known
    width = (noisy.high_K - noisy.low_K)[known]
    return Row(
        method=estimator.method,
        needs=estimator.needs,
        knows=estimator.knows,
        medium=None
        if estimator.about == "droplets"
        else _error(exact, noisy, truth.medium_K, known),
        droplets=_error(exact, noisy, truth.droplets_K, truth.wet & known),
        noise_K=_nan_median(None if exact.noise_K is None else exact.noise_K[known]),
        width_K=_nan_median(width),
        answered=float(known.sum() / truth.here.sum()),
        where={
            name: _rms((exact.temperature_K - after_K)[mask & seen])
            for name, mask in truth.classes.items()
        },
    )


def _error(exact: Said, noisy: Said, truth_K: Floats, here: Mask) -> Error:
    off = (exact.temperature_K - truth_K)[here]
    off = off[np.isfinite(off)]
    sure = here & np.isfinite(truth_K) & ~np.isnan(noisy.low_K) & ~np.isnan(noisy.high_K)
    within = (noisy.low_K <= truth_K) & (truth_K <= noisy.high_K)
    return Error(
        bias_K=float(np.mean(off)) if off.size else float("nan"),
        rms_K=_rms(off),
        held=float(np.mean(within[sure])) if sure.any() else float("nan"),
    )


def _rms(off: Floats) -> float:
    off = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(off**2))) if off.size else float("nan")


def _nan_median(values: Floats | None) -> float:
    if values is None:
        return float("nan")
    values = values[~np.isnan(values)]
    return float(np.median(values)) if values.size else float("nan")


def _noisy(exact: Mapping[str, Maps]) -> dict[str, Maps]:
    """Maps with the noise of the camera, independent for each arrangement."""
    random = np.random.default_rng(7)

    def drawn(image: NDArray[np.float32], error: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(image + error * random.standard_normal(image.shape), np.float32)

    return {
        name: replace(
            maps,
            emissivity=drawn(maps.emissivity, maps.emissivity_standard_error),
            apparent_temperature_K=drawn(
                maps.apparent_temperature_K, maps.apparent_temperature_standard_error_K
            ),
        )
        for name, maps in exact.items()
    }
