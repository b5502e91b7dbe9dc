"""Test of a difference in all pixels of the spray and by region, with the errors of both results.

The difference may be of any quantity: its independent variance and the modes are given with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.comparison.chi_square import LEVEL, ChiSquare, chi_square, combined_degrees, probability
from cldit.comparison.regions import Spray2D, positions_m
from cldit.comparison.shown import Shown
from cldit.dit.budget import Part

_ROUNDED_K = 2e-3  # single precision on different devices
_CLEAR = 5.0  # standard errors of the emissivity, in pixels that count
_MOST_MODES = 16
_LEAST_PIXELS = 4  # of a region


@dataclass(frozen=True)
class Mode:
    """An error that all pixels share: changes (H, W) of the differences by one standard deviation.

    size: the value that fits the difference best, in standard deviations. degrees: of freedom of
    the estimate of this standard deviation.
    """

    name: str
    kelvin: Floats = field(repr=False)
    emissivity: Floats = field(repr=False)
    size: float = 0.0
    degrees: float = math.inf


@dataclass(frozen=True, kw_only=True)
class RegionDifference:
    """Difference of T_app in a region of the spray, and its test by the errors.

    All numbers are None in fewer than 4 pixels, or without stated errors.
    effective_pixels: number of independent pixels with the same scatter of chi-square.
    mean_error_K: standard error of the mean. chi2_reduced: chi-square per pixel, 1 if the errors
    explain the difference. p_value: probability of a larger difference by the errors alone. seen_K:
    change of all pixels that the test finds with a probability of 95 %.
    """

    pixels: int
    effective_pixels: float | None = None
    rms_K: float | None = None
    mean_K: float | None = None
    mean_error_K: float | None = None
    chi2_reduced: float | None = None
    p_value: float | None = None
    seen_K: float | None = None

    @property
    def differs(self) -> bool:
        """True if the errors do not explain the difference."""
        return self.p_value is not None and self.p_value < LEVEL

    @property
    def cells(self) -> list[str]:
        """RMS, mean, reduced chi-square, p and number of pixels, as texts."""
        if self.p_value is None or self.chi2_reduced is None:
            return ["-", "-", "-", "unknown", str(self.pixels)]
        return [
            f"{self.rms_K:.3g} K",
            f"{self.mean_K:+.2g} ± {self.mean_error_K:.2g} K",
            f"{self.chi2_reduced:.2f}",
            probability(self.p_value).removeprefix("p = "),
            str(self.pixels),
        ]


@dataclass(frozen=True, kw_only=True)
class Tested:
    """A difference of T_app, tested.

    regions: `all` pixels that are visible in both, and the parts of the spray. modes: errors that
    all pixels share, with their best sizes. own_K: (H, W) independent standard error; error_K: with
    the modes; NaN without stated errors. degrees: of freedom of both. where: parts (H, W);
    thin: the half of the pixels with the smaller emissivity.
    residuals: (H, W) in standard errors, less the modes that fit best.
    """

    regions: dict[str, RegionDifference]
    modes: tuple[Mode, ...]
    own_K: Floats
    error_K: Floats
    residuals: Floats
    degrees: tuple[float, float]
    where: dict[str, Mask]
    thin: Mask

    def again(self, change_K: Floats, name: str = "all") -> ChiSquare | None:
        """Chi-square of another change (H, W) with the same errors, in a region."""
        kelvin = np.array([mode.kelvin for mode in self.modes]).reshape(-1, *change_K.shape)
        parts = [mask for part, mask in self.where.items() if part != "all"]
        return chi_square(
            change_K,
            self.own_K,
            kelvin,
            self.where[name],
            degrees=self.degrees,
            parts=parts if name == "all" else (),
            strata=(self.thin, ~self.thin),
        )


def tested(change_K: Floats, baseline: Shown, compared: Shown, of_view: Sequence[Floats]) -> Tested:
    """Test of a change of T_app; `of_view` are changes by the errors of an alignment."""
    spray = seen_in_both(baseline, compared)
    regions = spray.regions
    # The amount of spray scatters smoothly and changes thin pixels; the errors of opaque ones are
    # the camera's. So the errors of either half are correlated otherwise.
    seen = spray.emissivity[spray.visible]
    thin = spray.emissivity <= (np.median(seen) if seen.size else 0.0)
    modes = shared_modes(baseline, compared) + tuple(
        Mode(f"view {number}", kelvin, 0.0 * kelvin)
        for number, kelvin in enumerate(of_view, start=1)
    )
    of_baseline, of_compared = (shown.independent_K2 for shown in (baseline, compared))
    nothing = np.full(change_K.shape, np.nan)
    untested = Tested(
        regions={
            name: RegionDifference(pixels=int(np.count_nonzero(where & np.isfinite(change_K))))
            for name, where in regions.items()
        },
        modes=(),
        own_K=nothing,
        error_K=nothing,
        residuals=nothing,
        degrees=(np.inf, np.inf),
        where=regions,
        thin=thin,
    )
    if of_baseline is None or of_compared is None:
        return untested
    variance = of_baseline + of_compared + _ROUNDED_K**2
    finite = spray.visible & np.isfinite(variance)
    weights = [float(np.sum(mode.kelvin[finite] ** 2 / variance[finite])) for mode in modes]
    kept = sorted(np.argsort(weights)[::-1][:_MOST_MODES])
    for number, mode in enumerate(modes):
        if number not in kept:  # as if it were independent
            variance = variance + mode.kelvin**2
    modes = tuple(modes[number] for number in kept)
    of_pixels = combined_degrees(
        [float(np.sum((of / variance)[finite])) for of in (of_baseline, of_compared)],
        [baseline.degrees, compared.degrees],
        total_variance=finite.sum(),
    )
    of_modes = combined_degrees([weights[n] for n in kept], [mode.degrees for mode in modes])
    total = variance + sum((mode.kelvin**2 for mode in modes), 0.0)
    statistic = replace(
        untested,
        modes=modes,
        own_K=np.sqrt(variance),
        error_K=np.sqrt(total),
        degrees=(of_pixels, of_modes),
    )
    results = {name: statistic.again(change_K, name) for name in regions}
    of_all = results["all"]
    sizes = [0.0] * len(modes) if of_all is None else of_all.sizes.tolist()
    return replace(
        statistic,
        regions={
            name: _region(change_K, statistic.own_K, modes, result)
            for name, result in results.items()
        },
        modes=tuple(replace(m, size=size) for m, size in zip(modes, sizes, strict=True)),
        residuals=nothing if of_all is None else of_all.residuals,
    )


def _region(
    change_K: Floats, error_K: Floats, modes: tuple[Mode, ...], result: ChiSquare | None
) -> RegionDifference:
    if result is None or result.pixels < _LEAST_PIXELS:
        return RegionDifference(pixels=0 if result is None else result.pixels)
    finite = np.isfinite(result.residuals)
    square = float(np.sum(error_K[finite] ** 2)) * result.correlated / result.pixels**2
    square += sum(float(np.mean(mode.kelvin[finite])) ** 2 for mode in modes)
    return RegionDifference(
        pixels=result.pixels,
        effective_pixels=result.effective,
        rms_K=float(np.sqrt(np.mean(change_K[finite] ** 2))),
        mean_K=float(np.mean(change_K[finite])),
        mean_error_K=square**0.5,
        chi2_reduced=result.reduced,
        p_value=result.p_value,
        seen_K=result.seen,
    )


def seen_in_both(baseline: Shown, compared: Shown) -> Spray2D:
    """Spray that is visible in both, by the emissivity of the one without noise, or by the mean.

    An emissivity that is noisy would select pixels by their noise, which that of T_app follows. It
    must exceed 5 standard errors, for T_app is divided by it.
    """
    quiet = [shown for shown in (baseline, compared) if not shown.noisy] or [baseline, compared]
    emissivity = np.mean([shown.maps.emissivity for shown in quiet], axis=0, dtype=float)
    finite = np.isfinite(emissivity)
    for shown in (baseline, compared):
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
            f"{part.name} of {result.name}",
            sign * np.nan_to_num(part.kelvin),
            sign * np.nan_to_num(part.emissivity),
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
                name,
                np.nan_to_num(part.kelvin - part_compared.kelvin),
                np.nan_to_num(part.emissivity - part_compared.emissivity),
            )
        )
    return tuple(modes)
