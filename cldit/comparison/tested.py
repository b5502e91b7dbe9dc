"""Test of a difference in all pixels of the spray and by region, with the errors of both results.

The difference is one of T_app, or of the emissivity, which is the extinction in a band where the
vapour is transparent. Numbers without a unit in their name are in that of the observable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.comparison.chi_square import LEVEL, ChiSquare, chi_square, combined_degrees, probability
from cldit.comparison.regions import Spray2D, positions_m
from cldit.comparison.shown import Observable, Shown
from cldit.dit.budget import Part
from cldit.dit.solve import LEAST_EMISSIVITY

# Single precision on different devices, and the accuracy of a trace.
_ROUNDED: dict[Observable, float] = {"T_app": 2e-3, "emissivity": LEAST_EMISSIVITY}
_CLEAR = 5.0  # standard errors of the emissivity, in pixels that count
_MOST_MODES = 16
_LEAST_PIXELS = 4  # of a region


@dataclass(frozen=True, kw_only=True)
class Mode(Part):
    """An error that all pixels share: changes (H, W) of the differences by one standard deviation.

    size: the value that fits the difference best, in standard deviations.
    """

    size: float = 0.0


@dataclass(frozen=True, kw_only=True)
class RegionDifference:
    """Difference of T_app or emissivity in a region of the spray, and its test by the errors.

    All numbers are None in fewer than 4 pixels, or without stated errors.
    unit: of rms, mean, its error and seen: K or 1.
    effective_pixels: number of independent pixels with the same scatter of chi-square.
    mean_error: standard error of the mean. chi2_reduced: chi-square per pixel, 1 if the errors
    explain the difference. p_value: probability of a larger difference by the errors alone. seen:
    change of all pixels that the test finds with a probability of 95 %.
    """

    pixels: int
    unit: str = "K"
    effective_pixels: float | None = None
    rms: float | None = None
    mean: float | None = None
    mean_error: float | None = None
    chi2_reduced: float | None = None
    p_value: float | None = None
    seen: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data; names of numbers in the unit end with it."""
        suffix = "_K" if self.unit == "K" else "_emissivity"
        of_unit = ("rms", "mean", "mean_error", "seen")
        data = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "unit"}
        return {f"{name}{suffix * (name in of_unit)}": value for name, value in data.items()}

    @property
    def cells(self) -> list[str]:
        """RMS, mean, reduced chi-square, p and number of pixels, as texts."""
        if self.p_value is None or self.chi2_reduced is None:
            return ["-", "-", "-", "unknown", str(self.pixels)]
        unit = " K" if self.unit == "K" else ""
        return [
            f"{self.rms:.3g}{unit}",
            f"{self.mean:+.2g} ± {self.mean_error:.2g}{unit}",
            f"{self.chi2_reduced:.2f}",
            probability(self.p_value).removeprefix("p = "),
            str(self.pixels),
        ]


@dataclass(frozen=True, kw_only=True)
class Tested:
    """A difference of an observable, tested.

    regions: `all` pixels that are visible in both, and the parts of the spray. modes: errors that
    all pixels share, with their best sizes. independent: (H, W) standard error; error: with
    the modes; NaN without stated errors. degrees: of freedom of both. where: parts (H, W);
    thin: the half of the pixels with the smaller emissivity. level: of the test.
    residuals: (H, W) in standard errors, less the modes that fit best.
    """

    regions: dict[str, RegionDifference]
    modes: tuple[Mode, ...]
    independent: Floats
    error: Floats
    residuals: Floats
    degrees: tuple[float, float]
    where: dict[str, Mask]
    thin: Mask
    observable: Observable
    level: float

    def again(self, change: Floats, name: str = "all") -> ChiSquare | None:
        """Chi-square of another change (H, W) with the same errors, in a region."""
        modes = [mode.of(self.observable) for mode in self.modes]
        parts = [mask for part, mask in self.where.items() if part != "all"]
        return chi_square(
            change,
            self.independent,
            np.array(modes).reshape(-1, *change.shape),
            self.where[name],
            degrees=self.degrees,
            parts=parts if name == "all" else (),
            strata=(self.thin, ~self.thin),
            level=self.level,
        )


def tested(
    change: Floats,
    baseline: Shown,
    compared: Shown,
    of_view: Sequence[tuple[Floats, Floats]],
    *,
    observable: Observable = "T_app",
    level: float = LEVEL,
) -> Tested:
    """Test of a change (H, W) of an observable at a level.

    of_view: changes of T_app and emissivity by the errors of an alignment.
    """
    spray = seen_in_both(baseline, compared, observable)
    unit = "K" if observable == "T_app" else "1"
    # The amount of spray scatters smoothly and changes thin pixels; the errors of opaque ones are
    # the camera's. So the errors of either half are correlated otherwise.
    seen = spray.emissivity[spray.visible]
    of_views = (
        Mode(name=f"view {n}", kelvin=kelvin, emissivity=emissivity)
        for n, (kelvin, emissivity) in enumerate(of_view, start=1)
    )
    modes = (*shared_modes(baseline, compared), *of_views)
    covariance = _covariance(baseline, compared, modes, spray.visible, observable)
    nothing = np.full(change.shape, np.nan)
    modes, variance, degrees = covariance or ((), nothing, (np.inf, np.inf))
    total = variance + sum((mode.of(observable) ** 2 for mode in modes), 0.0)
    statistic = Tested(
        regions={
            name: RegionDifference(pixels=int(np.sum(where & np.isfinite(change))), unit=unit)
            for name, where in spray.regions.items()
        },
        modes=modes,
        independent=np.sqrt(variance),
        error=np.sqrt(total),
        residuals=nothing,
        degrees=degrees,
        where=spray.regions,
        thin=spray.emissivity <= (np.median(seen) if seen.size else 0.0),
        observable=observable,
        level=level,
    )
    if covariance is None:
        return statistic
    results = {name: statistic.again(change, name) for name in statistic.where}
    of_all = results["all"]
    sizes = [0.0] * len(modes) if of_all is None else of_all.sizes.tolist()
    return replace(
        statistic,
        regions={
            name: _region(change, statistic, result, unit) for name, result in results.items()
        },
        modes=tuple(replace(m, size=size) for m, size in zip(modes, sizes, strict=True)),
        residuals=nothing if of_all is None else of_all.residuals,
    )


def _covariance(
    baseline: Shown,
    compared: Shown,
    modes: Sequence[Mode],
    visible: Mask,
    observable: Observable,
) -> tuple[tuple[Mode, ...], Floats, tuple[float, float]] | None:
    """The largest modes, the variance (H, W) of all other errors, and the degrees of freedom of
    both estimates (`Tested.degrees`); None without stated errors."""
    results = baseline, compared
    of_results = [shown.independent_variance(observable) for shown in results]
    stated = [variance for variance in of_results if variance is not None]
    if len(stated) < len(results):
        return None
    variance = stated[0] + stated[1] + _ROUNDED[observable] ** 2
    finite = visible & np.isfinite(variance)
    modes = [mode for mode in modes if mode.of(observable).any()]
    images = [mode.of(observable) for mode in modes]
    weights = [float(np.sum(image[finite] ** 2 / variance[finite])) for image in images]
    kept = sorted(np.argsort(weights)[::-1][:_MOST_MODES])
    for number, image in enumerate(images):
        if number not in kept:  # as if it were independent
            variance = variance + image**2
    of_pixels = combined_degrees(
        [float(np.sum((of / variance)[finite])) for of in stated],
        [shown.degrees for shown in results],
        total_variance=finite.sum(),
    )
    largest = tuple(modes[number] for number in kept)
    of_modes = combined_degrees([weights[n] for n in kept], [mode.degrees for mode in largest])
    return largest, variance, (of_pixels, of_modes)


def _region(change: Floats, test: Tested, result: ChiSquare | None, unit: str) -> RegionDifference:
    if result is None or result.pixels < _LEAST_PIXELS:
        return RegionDifference(pixels=0 if result is None else result.pixels, unit=unit)
    finite = np.isfinite(result.residuals)
    square = float(np.sum(test.independent[finite] ** 2)) * result.correlated / result.pixels**2
    square += sum(float(np.mean(mode.of(test.observable)[finite])) ** 2 for mode in test.modes)
    return RegionDifference(
        pixels=result.pixels,
        unit=unit,
        effective_pixels=result.effective,
        rms=float(np.sqrt(np.mean(change[finite] ** 2))),
        mean=float(np.mean(change[finite])),
        mean_error=square**0.5,
        chi2_reduced=result.reduced,
        p_value=result.p_value,
        seen=result.seen,
    )


def seen_in_both(baseline: Shown, compared: Shown, observable: Observable = "T_app") -> Spray2D:
    """Spray that is visible in both, by the emissivity of the one without noise, or by the mean.

    An emissivity that is noisy would select pixels by their noise, which that of T_app follows; the
    mean of two does not select the difference. It must exceed 5 standard errors where T_app counts,
    which is divided by it.
    """
    quiet = [shown for shown in (baseline, compared) if not shown.noisy] or [baseline, compared]
    emissivity = np.mean([shown.maps.emissivity for shown in quiet], axis=0, dtype=float)
    finite = np.isfinite(baseline.maps.emissivity) & np.isfinite(compared.maps.emissivity)
    for shown in (baseline, compared) if observable == "T_app" else ():
        finite &= np.isfinite(shown.maps.apparent_temperature_K)
        if shown.noisy:
            finite &= emissivity > _CLEAR * shown.maps.emissivity_standard_error
    x_m, z_m = positions_m(emissivity.shape, pixel_m=baseline.pixel_m, centre_m=baseline.centre_m)
    return Spray2D(emissivity=emissivity, x_m=x_m, z_m=z_m, counted=finite)


def shared_modes(baseline: Shown, compared: Shown) -> tuple[Mode, ...]:
    """Errors that all pixels share; a systematic error of the same name is the same in both.

    With both corrected for a quantity that is larger by s of its spreads they are equal if other +
    s change(other) = one + s change(one).
    """
    modes = [
        Mode(
            name=f"{part.name} of {result.name}",
            kelvin=sign * np.nan_to_num(part.kelvin),
            emissivity=sign * np.nan_to_num(part.emissivity),
            degrees=part.degrees,
        )
        for result, sign in ((baseline, -1.0), (compared, 1.0))
        for part in result.common
    ]
    of_baseline, of_compared = (
        {part.name: part for part in result.systematic} for result in (baseline, compared)
    )
    zero = np.zeros(baseline.maps.emissivity.shape)
    nothing = Part(name="", kelvin=zero, emissivity=zero)
    for name in dict.fromkeys((*of_baseline, *of_compared)):
        part, part_compared = (parts.get(name, nothing) for parts in (of_baseline, of_compared))
        modes.append(
            Mode(
                name=name,
                kelvin=np.nan_to_num(part.kelvin - part_compared.kelvin),
                emissivity=np.nan_to_num(part.emissivity - part_compared.emissivity),
            )
        )
    return tuple(modes)
