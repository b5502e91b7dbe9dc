"""Test of a difference in all pixels of the spray and by region, with the errors of both results.

The difference may be of any quantity: its independent variance and the modes are given with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.comparison.chi_square import (
    LEVEL,
    ChiSquare,
    chi_square,
    combined_degrees,
    probability,
)
from cldit.comparison.modes import Mode, shared_modes
from cldit.comparison.regions import Spray2D, positions_m
from cldit.comparison.shown import Shown

_ROUNDED_K = 2e-3  # single precision on different devices
_CLEAR = 5.0  # standard errors of the emissivity, in pixels that count
_MOST_MODES = 16
_LEAST_PIXELS = 4  # of a region


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
    the modes; NaN without stated errors. degrees: of freedom of both. where: parts (H, W).
    residuals: (H, W) in standard errors, less the modes that fit best.
    """

    regions: dict[str, RegionDifference]
    modes: tuple[Mode, ...]
    own_K: Floats
    error_K: Floats
    residuals: Floats
    degrees: tuple[float, float]
    where: dict[str, Mask]

    def again(self, change_K: Floats, name: str = "all") -> ChiSquare | None:
        """Chi-square of another change (H, W) with the same errors, in a region."""
        kelvin = np.array([mode.kelvin for mode in self.modes]).reshape(-1, *change_K.shape)
        parts = [each for part, each in self.where.items() if part != "all"]
        return chi_square(
            change_K,
            self.own_K,
            kelvin,
            self.where[name],
            degrees=self.degrees,
            parts=parts if name == "all" else (),
        )


def tested(change_K: Floats, one: Shown, other: Shown, of_view: Sequence[Floats]) -> Tested:
    """Test of a change of T_app; `of_view` are changes by the errors of an alignment."""
    spray = seen_in_both(one, other)
    regions = spray.regions
    modes = shared_modes(one, other) + tuple(
        Mode(f"view {number}", kelvin, 0.0 * kelvin)
        for number, kelvin in enumerate(of_view, start=1)
    )
    first, second = (each.independent_K2 for each in (one, other))
    nothing = np.full(change_K.shape, np.nan)
    if first is None or second is None:
        known = np.isfinite(change_K)
        return Tested(
            regions={
                name: RegionDifference(pixels=int(np.count_nonzero(where & known)))
                for name, where in regions.items()
            },
            modes=(),
            own_K=nothing,
            error_K=nothing,
            residuals=nothing,
            degrees=(np.inf, np.inf),
            where=regions,
        )
    variance = first + second + _ROUNDED_K**2
    known = spray.visible & np.isfinite(variance)
    weights = [float(np.sum(mode.kelvin[known] ** 2 / variance[known])) for mode in modes]
    kept = sorted(np.argsort(weights)[::-1][:_MOST_MODES])
    for number, mode in enumerate(modes):
        if number not in kept:  # as if it were independent
            variance = variance + mode.kelvin**2
    modes = tuple(modes[number] for number in kept)
    shares = [float(np.sum(square[known] / variance[known])) for square in (first, second)]
    found = Tested(
        regions={},
        modes=modes,
        own_K=np.sqrt(variance),
        error_K=np.sqrt(variance + sum((mode.kelvin**2 for mode in modes), 0.0)),
        residuals=nothing,
        degrees=(
            combined_degrees(shares, [each.degrees for each in (one, other)], whole=known.sum()),
            combined_degrees([weights[n] for n in kept], [mode.degrees for mode in modes]),
        ),
        where=regions,
    )
    results = {name: found.again(change_K, name) for name in regions}
    whole = results["all"]
    sizes = [0.0] * len(modes) if whole is None else whole.sizes.tolist()
    return replace(
        found,
        regions={
            name: _region(change_K, found.own_K, modes, result) for name, result in results.items()
        },
        modes=tuple(replace(m, size=size) for m, size in zip(modes, sizes, strict=True)),
        residuals=nothing if whole is None else whole.residuals,
    )


def _region(
    change_K: Floats,
    error_K: Floats,
    modes: tuple[Mode, ...],
    found: ChiSquare | None,
) -> RegionDifference:
    if found is None or found.pixels < _LEAST_PIXELS:
        return RegionDifference(pixels=0 if found is None else found.pixels)
    known = np.isfinite(found.residuals)
    square = float(np.sum(error_K[known] ** 2)) * found.correlated / found.pixels**2
    square += sum(float(np.mean(mode.kelvin[known])) ** 2 for mode in modes)
    return RegionDifference(
        pixels=found.pixels,
        effective_pixels=found.effective,
        rms_K=float(np.sqrt(np.mean(change_K[known] ** 2))),
        mean_K=float(np.mean(change_K[known])),
        mean_error_K=square**0.5,
        chi2_reduced=found.reduced,
        p_value=found.p_value,
        seen_K=found.seen,
    )


def seen_in_both(one: Shown, other: Shown) -> Spray2D:
    """Spray that is visible in both, by the emissivity of the one without noise, or by the mean.

    An emissivity that is noisy would select pixels by their noise, which that of T_app follows. It
    must exceed 5 standard errors, for T_app is divided by it.
    """
    quiet = [each for each in (one, other) if not each.noisy] or [one, other]
    emissivity = np.mean([each.maps.emissivity for each in quiet], axis=0, dtype=float)
    known = np.isfinite(emissivity)
    for each in (one, other):
        known &= np.isfinite(each.maps.apparent_temperature_K)
        if each.noisy:
            known &= emissivity > _CLEAR * each.maps.emissivity_standard_error
    x_m, z_m = positions_m(emissivity.shape, pixel_m=one.pixel_m, centre_m=one.centre_m)
    return Spray2D(emissivity=emissivity, x_m=x_m, z_m=z_m, known=known)
