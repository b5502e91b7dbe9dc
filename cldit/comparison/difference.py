"""Difference of two results in T_app, emissivity and optical depth, and its test by region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cldit.comparison.chi_square import ChiSquare, chi_square, combined_degrees
from cldit.comparison.keys import KeyDifference, key_differences
from cldit.comparison.modes import Mode, shared_modes
from cldit.comparison.pixels import together
from cldit.comparison.profiles import LineDifference, line_differences
from cldit.comparison.regions import Spray2D, positions_m
from cldit.comparison.registration import aligned
from cldit.comparison.shape import Value, shape_of
from cldit.comparison.shared import unshared
from cldit.comparison.shown import Openable, Shown, open_shown

Image = NDArray[np.float64]
Align = Literal["metadata", "images"]

LEVEL = 0.01  # probability below which two results differ
_ROUNDED_K = 2e-3  # single precision on different devices
_CLEAR = 5.0  # standard errors of the emissivity, in pixels that count
_MOST_MODES = 16
_LEAST_PIXELS = 4  # of a region


@dataclass(frozen=True, kw_only=True)
class MapDifference:
    """Map of `other` minus map of `one`, over the pixels in which both have a value.

    worst: the value of largest magnitude; worst_mm: its position (x, z). All are None without such
    a pixel.
    """

    name: str
    unit: str
    pixels: int
    mean: float | None = None
    rms: float | None = None
    worst: float | None = None
    worst_mm: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class RegionDifference:
    """Difference of T_app in a region of the spray, and its test by the errors.

    All numbers are None if they cannot be told: in fewer than 4 pixels, or without stated errors.

    effective_pixels: number of independent pixels with the same scatter of chi-square.
    mean_error_K: standard error of the mean. chi2_reduced: chi-square per pixel, 1 if the errors
    explain the difference. p_value: probability of a larger difference by the errors alone; by:
    what exceeds its errors most, `all pixels together` or `single pixels`.
    """

    pixels: int
    effective_pixels: float | None = None
    rms_K: float | None = None
    mean_K: float | None = None
    mean_error_K: float | None = None
    chi2_reduced: float | None = None
    p_value: float | None = None
    by: str | None = None

    @property
    def differs(self) -> bool:
        """True if the errors do not explain the difference."""
        return self.p_value is not None and self.p_value < LEVEL

    @property
    def cells(self) -> list[str]:
        """RMS, mean, reduced chi-square, p and number of pixels, as texts."""
        if self.p_value is None or self.chi2_reduced is None:
            return ["-", "-", "-", "cannot be told", str(self.pixels)]
        return [
            f"{self.rms_K:.3g} K",
            f"{self.mean_K:+.2g} ± {self.mean_error_K:.2g} K",
            f"{self.chi2_reduced:.2f}",
            _probability(self.p_value).removeprefix("= "),
            str(self.pixels),
        ]


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference between two results, other minus one.

    stated_K: standard error of T_app that each states, None if none. given_K: allowed by the caller
    instead. at_least: True if a cause of a stated error is unknown. only: number of pixels with a
    T_app only in the first, and only in the second. unshared_K, unshared_emissivity: the errors
    that they do not share; shared: names of sources whose errors they share; tested: of those by
    keys that omit physics in one alone, which no error explains. code: rooms of cldit whose sources
    differ. regions: `all` pixels that are visible in both, and the parts of the spray. modes:
    errors that all pixels share. averaged: description of an average onto the other's pixels. view:
    as found from the images, with its errors. keys: that differ between the scenes. seen: both in
    one view. change_K, error_K, residuals: (H, W), the second with the modes, the last in standard
    errors, less the modes that fit best.
    """

    one: str
    other: str
    maps: tuple[MapDifference, ...]
    only: tuple[int, int]
    stated_K: tuple[float | None, float | None]
    unshared_K: tuple[float | None, float | None]
    unshared_emissivity: tuple[float | None, float | None]
    shared: tuple[str, ...]
    tested: tuple[str, ...]
    code: tuple[str, ...]
    at_least: bool
    given_K: float | None
    regions: Mapping[str, RegionDifference]
    modes: tuple[Mode, ...]
    averaged: str
    view: str
    keys: tuple[KeyDifference, ...]
    seen: tuple[Shown, Shown] = field(repr=False)
    change_K: Image = field(repr=False)
    error_K: Image = field(repr=False)
    residuals: Image = field(repr=False)

    @property
    def t_app(self) -> MapDifference:
        """Difference of T_app."""
        return self.maps[0]

    @property
    def shapes(self) -> dict[str, tuple[Value, Value]]:
        """Penetration, angle and areas of both, each with its error."""
        one, other = (shape_of(each) for each in self.seen)
        return {name: (value, other[name]) for name, value in one.items()}

    @cached_property
    def profiles(self) -> dict[str, LineDifference]:
        """Profiles of both along the spray's axis and across it, with errors."""
        spray = seen_in_both(*self.seen)
        return line_differences(
            self.seen, spray, self.change_K, error_K=self.error_K, modes=self.modes
        )

    @property
    def same(self) -> bool:
        """True if every value is the same, and missing in the same pixels."""
        return self.only == (0, 0) and all(not one.worst for one in self.maps)

    @property
    def p_value(self) -> float | None:
        """Probability of a larger difference by the errors; None: cannot be told.

        The least of all pixels and of each part of the spray, for so many tests (Sidak 1967): what
        differs in a small part is lost among all pixels.
        """
        if self.regions["all"].p_value is None:
            return None
        known = [one.p_value for one in self.regions.values() if one.p_value is not None]
        return float(-np.expm1(len(known) * np.log1p(-min(min(known), 1.0 - 1e-16))))

    @property
    def where(self) -> tuple[str, ...]:
        """Parts of the spray in which the errors do not explain the difference."""
        return tuple(
            name for name, region in self.regions.items() if name != "all" and region.differs
        )

    @property
    def within(self) -> bool:
        """True if the errors explain the difference in T_app, or if all values are the same."""
        if self.same:
            return True
        if self.given_K is not None:
            return self.t_app.rms is not None and self.t_app.rms <= self.given_K
        return self.p_value is not None and self.p_value >= LEVEL

    @property
    def verdict(self) -> str:
        """Conclusion on one line."""
        if self.same:
            return "the same in every pixel"
        if self.t_app.rms is None:
            return "no pixel has a T_app in both"
        if self.given_K is not None:
            return f"{'within' if self.within else 'beyond'} the {self.given_K:.2g} K RMS allowed"
        p_value = self.p_value
        if p_value is None:
            if None in self.unshared_K:
                return "differs, but no error is stated to compare with; --within gives a limit"
            return "cannot be told: too few pixels are visible in both"
        errors = "errors that are not shared" if self.shared else "errors"
        known = ", as far as they are known" if self.at_least else ""
        if self.within:
            return f"explained by the {errors}{known}: p {_probability(p_value)}"
        parts = f", in {', '.join(self.where)}" if self.where else ""
        known_p = [
            (one.p_value, one.by) for one in self.regions.values() if one.p_value is not None
        ]
        by = f"; {min(known_p)[1]} differ most"
        return f"not explained by the {errors}{known}: p {_probability(p_value)}{parts}{by}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        images = {"seen", "change_K", "error_K", "residuals", "modes", "regions"}
        data = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in images}
        data["maps"] = [asdict(one) for one in self.maps]
        data["keys"] = [asdict(one) for one in self.keys]
        data["regions"] = {name: asdict(one) for name, one in self.regions.items()}
        data["modes"] = {one.name: one.size for one in self.modes}
        data["shapes"] = self.shapes
        data["profiles"] = {name: one.columns for name, one in self.profiles.items()}
        more = {"same": self.same, "within": self.within, "where": self.where}
        return {**data, **more, "verdict": self.verdict}


def _probability(value: float) -> str:
    return f"= {value:.2g}" if value > 1e-9 else "< 1e-9"


def difference(
    one: Openable,
    other: Openable,
    *,
    acquired: bool = False,
    resample: bool = False,
    within_K: float | None = None,
    align: Align = "metadata",
) -> Difference:
    """Difference of two results: runs, or folders of runs, of acquisitions or measured data.

    `acquired` takes recordings of runs, not their traces. `resample` averages a trace onto the
    pixels of the other one. `within_K` is the RMS allowed in T_app in place of the errors. `align`
    finds the view from the images, or takes it from the metadata. Raises
    RunFolderError without maps, EvaluationError if the pixels differ.
    """
    first, second = (open_shown(each, acquired=acquired) for each in (one, other))
    stated_K = first.error_K, second.error_K
    parts = unshared(first, second)
    by_images = align == "images"
    first, second, averaged = together(
        parts.one, parts.other, resample=resample, centred=not by_images
    )
    view, of_view = "", list[Image]()
    if by_images:
        first, second, found, of_view = aligned(first, second)
        view = found.text
    t_one, t_other = (
        each.maps.apparent_temperature_K.astype(np.float64) for each in (first, second)
    )
    has = np.isfinite(t_one), np.isfinite(t_other)
    change_K = t_other - t_one
    regions, modes, error_K, residuals = _tested(change_K, first, second, of_view)
    return Difference(
        one=first.name,
        other=second.name,
        maps=(
            _of("apparent_temperature_K", "K", t_one, t_other, second),
            _of("emissivity", "1", first.maps.emissivity, second.maps.emissivity, second),
            _of("optical_depth", "1", first.maps.optical_depth, second.maps.optical_depth, second),
        ),
        only=(int(np.sum(has[0] & ~has[1])), int(np.sum(has[1] & ~has[0]))),
        stated_K=stated_K,
        unshared_K=(first.error_K, second.error_K),
        unshared_emissivity=(first.emissivity_error, second.emissivity_error),
        shared=parts.shared,
        tested=parts.tested,
        code=parts.code,
        at_least=first.at_least or second.at_least,
        given_K=within_K,
        regions=regions,
        modes=modes,
        averaged=averaged,
        view=view,
        keys=key_differences(first.scene, second.scene) if first.scene and second.scene else (),
        seen=(first, second),
        change_K=change_K,
        error_K=error_K,
        residuals=residuals,
    )


def _of(
    name: str, unit: str, one: NDArray[np.floating], other: NDArray[np.floating], at: Shown
) -> MapDifference:
    change = np.asarray(other, np.float64) - one
    known = np.isfinite(change)
    if not known.any():
        return MapDifference(name=name, unit=unit, pixels=0)
    worst = np.unravel_index(np.nanargmax(np.abs(change)), change.shape)
    x_m, z_m = positions_m(change.shape, pixel_m=at.pixel_m, centre_m=at.centre_m)
    return MapDifference(
        name=name,
        unit=unit,
        pixels=int(known.sum()),
        mean=float(np.mean(change[known])),
        rms=float(np.sqrt(np.mean(change[known] ** 2))),
        worst=float(change[worst]),
        worst_mm=(float(1e3 * x_m[worst]), float(1e3 * z_m[worst])),
    )


def _tested(
    change_K: Image, one: Shown, other: Shown, of_view: Sequence[Image]
) -> tuple[dict[str, RegionDifference], tuple[Mode, ...], Image, Image]:
    """Regions, modes with their best sizes, standard errors, and standardised residuals."""
    spray = seen_in_both(one, other)
    regions = spray.regions
    modes = shared_modes(one, other) + tuple(
        Mode(f"view {number}", kelvin, 0.0 * kelvin)
        for number, kelvin in enumerate(of_view, start=1)
    )
    first, second = (each.independent_K2 for each in (one, other))
    nothing = np.full(change_K.shape, np.nan)
    if first is None or second is None:
        untested = {name: _untested(change_K, where) for name, where in regions.items()}
        return untested, (), nothing, nothing
    variance = first + second + _ROUNDED_K**2
    known = spray.visible & np.isfinite(variance)
    weights = [float(np.sum(mode.kelvin[known] ** 2 / variance[known])) for mode in modes]
    kept = sorted(np.argsort(weights)[::-1][:_MOST_MODES])
    for number, mode in enumerate(modes):
        if number not in kept:  # as if it were independent
            variance = variance + mode.kelvin**2
    modes = tuple(modes[number] for number in kept)
    kelvin = np.array([mode.kelvin for mode in modes]).reshape(-1, *change_K.shape)
    shares = [float(np.sum(square[known] / variance[known])) for square in (first, second)]
    degrees = (
        combined_degrees(shares, [each.degrees for each in (one, other)], whole=known.sum()),
        combined_degrees([weights[n] for n in kept], [mode.degrees for mode in modes]),
    )
    test = partial(chi_square, change_K, np.sqrt(variance), kelvin, degrees=degrees)
    error_K = np.sqrt(variance + np.sum(kelvin**2, axis=0))
    found = {name: test(where) for name, where in regions.items()}
    whole = found["all"]
    if whole is not None:
        sizes = whole.sizes.tolist()
        modes = tuple(replace(m, size=size) for m, size in zip(modes, sizes, strict=True))
    return (
        {
            name: _region(change_K, np.sqrt(variance), modes, regions[name], result)
            for name, result in found.items()
        },
        modes,
        error_K,
        nothing if whole is None else whole.residuals,
    )


def _region(
    change_K: Image,
    error_K: Image,
    modes: tuple[Mode, ...],
    where: NDArray[np.bool_],
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
        by=found.by,
    )


def _untested(change_K: Image, where: NDArray[np.bool_]) -> RegionDifference:
    values = change_K[where & np.isfinite(change_K)]
    if len(values) < _LEAST_PIXELS:
        return RegionDifference(pixels=len(values))
    return RegionDifference(
        pixels=len(values),
        rms_K=float(np.sqrt(np.mean(values**2))),
        mean_K=float(np.mean(values)),
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
