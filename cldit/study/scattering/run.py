"""The study itself: every estimator against the truth, and where each fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.dit.maps import Maps
from cldit.gpu.device import Device
from cldit.scene import Scene
from cldit.study.scattering.estimators import Estimator, Knows, Said, estimators, seen
from cldit.study.scattering.models import LARGER, RIGHT, wrong_models
from cldit.study.scattering.truth import (
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
    """Bias and RMS in K without noise, and the part of the pixels in which the truth lies within
    the bound that is claimed, with noise."""

    bias_K: float
    rms_K: float
    held: float


@dataclass(frozen=True)
class Row:
    """One estimator, over pixels of emissivity 0.2 and more.

    knows: what the estimator is given. medium: against the temperature of all that emits; None
    where the estimator is after the droplets alone. droplets: against the droplets' own, where they
    emit more than the vapour. noise_K: median standard error at the scene's shots. width_K: median
    width of the bound. told: part of the pixels that get a temperature. where: RMS against what the
    estimator is after, by what the pixels see.
    """

    method: str
    needs: str
    knows: Knows
    medium: Error | None
    droplets: Error
    noise_K: float
    width_K: float
    told: float
    where: Mapping[str, float]


@dataclass(frozen=True)
class Study:
    """rows, and pictures (H, W) of errors in K.

    wet: part of the pixels in which the droplets emit more than the vapour. classes: part of the
    pixels in each class of `Row.where`. second: the scene through the second filter.
    """

    rows: tuple[Row, ...]
    errors: Mapping[str, Floats]
    wet: float
    classes: Mapping[str, float]
    scene: Scene
    second: Scene


@dataclass(frozen=True)
class Truth:
    """(H, W) each: temperatures of what emits and of the droplets; pixels that are looked at, and
    those in which droplets emit more than vapour; and classes of pixels."""

    medium_K: Floats
    droplets_K: Floats
    here: Mask
    wet: Mask
    classes: Mapping[str, Mask]

    @classmethod
    def of(cls, trace: Traced, maps: Maps) -> Truth:
        """What the `trace` says that the evaluation should find; `maps` are plain DIT's."""
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
    """Evaluates the traced scene by every estimator.

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
    """Runs all estimators, with the model named `right` as the truth."""
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
    told = truth.here & np.isfinite(exact.temperature_K)
    seen = told & truth.wet if estimator.about == "droplets" else told
    width = (noisy.high_K - noisy.low_K)[told]
    return Row(
        method=estimator.method,
        needs=estimator.needs,
        knows=estimator.knows,
        medium=None
        if estimator.about == "droplets"
        else _error(exact, noisy, truth.medium_K, told),
        droplets=_error(exact, noisy, truth.droplets_K, truth.wet & told),
        noise_K=_nan_median(None if exact.noise_K is None else exact.noise_K[told]),
        width_K=_nan_median(width),
        told=float(told.sum() / truth.here.sum()),
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
    """The same with the camera's noise, each arrangement measured for itself."""
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
