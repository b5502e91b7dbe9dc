"""Difference of two results in T_app, emissivity and optical depth, beside stated errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.run import Run
from cldit.scene import Scene
from cldit.show.comparison.pixels import together
from cldit.show.comparison.shared import unshared
from cldit.show.comparison.shown import Shown, open_shown

Image = NDArray[np.float64]

_BEYOND = 2.0  # standard errors
# Share of the pixels that may differ by more: that of errors of 1 / 0.6 of those that are stated.
_MOST_BEYOND = 0.23
_ROUNDED_K = 2e-3  # single precision on different devices


@dataclass(frozen=True)
class KeyDifference:
    """A key of the scene and its two values; None if a scene does not have the key."""

    key: str
    one: Any
    other: Any

    @property
    def text(self) -> str:
        """`walls.temperature_K: 450 and 500`."""
        return f"{self.key}: {_value(self.one)} and {_value(self.other)}"


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
class Difference:
    """Difference between two results.

    stated_K: standard error of T_app that each states, None if none. given_K: allowed by the caller
    instead. at_least: True if a cause of a stated error is unknown. only: number of pixels with a
    T_app only in the first, and only in the second. unshared_K: the errors that they do not share;
    shared: names of sources whose errors they share; tested: of those by keys that omit physics in
    one alone, which no error explains. beyond: share of the pixels whose T_app differ by more than
    twice the errors that are not shared there; None if none are stated. chi2: mean of the squared
    difference over the square of these errors, 1 if they explain it. averaged: description of an
    average onto the other's pixels. keys: that differ between the scenes.
    """

    one: str
    other: str
    maps: tuple[MapDifference, ...]
    only: tuple[int, int]
    stated_K: tuple[float | None, float | None]
    unshared_K: tuple[float | None, float | None]
    shared: tuple[str, ...]
    tested: tuple[str, ...]
    at_least: bool
    given_K: float | None
    beyond: float | None
    chi2: float | None
    averaged: str
    keys: tuple[KeyDifference, ...]

    @property
    def t_app(self) -> MapDifference:
        """Difference of T_app."""
        return self.maps[0]

    @property
    def allowed_K(self) -> float | None:
        """RMS that the errors explain that are not shared; None if they are not stated."""
        if self.given_K is not None:
            return self.given_K
        one, other = self.unshared_K
        return None if one is None or other is None else math.hypot(one, other, _ROUNDED_K)

    @property
    def same(self) -> bool:
        """True if every value is the same, and missing in the same pixels."""
        return self.only == (0, 0) and all(not one.worst for one in self.maps)

    @property
    def within(self) -> bool:
        """True if the stated errors explain the difference in T_app, or if all values are the same.

        They explain its RMS, and it in enough pixels: a few pixels of large error, as a recording
        has, would otherwise hide a difference in all others.
        """
        if self.same:
            return True
        if self.t_app.rms is None or self.allowed_K is None:
            return False
        return self.t_app.rms <= self.allowed_K and not self._in_many_pixels

    @property
    def _in_many_pixels(self) -> bool:
        return self.given_K is None and (self.beyond or 0.0) > _MOST_BEYOND

    @property
    def verdict(self) -> str:
        """Conclusion on one line."""
        if self.same:
            return "the same in every pixel"
        if self.t_app.rms is None:
            return "no pixel has a T_app in both"
        allowed = "" if self.allowed_K is None else f"{self.allowed_K:.2g} K RMS"
        if not allowed:
            return "differs, but no error is stated to compare with; --within gives an allowance"
        source = "allowed" if self.given_K is not None else "explained by both errors"
        if self.shared and self.given_K is None:
            source += " that are not shared"
        if self.at_least and self.given_K is None:
            source += ", at least"
        if self._in_many_pixels and self.t_app.rms <= (self.allowed_K or 0.0):
            return f"beyond the errors of the pixels, though {allowed} are {source}"
        return f"{'within' if self.within else 'beyond'} the {allowed} {source}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        data = asdict(self)
        more = {"allowed_K": self.allowed_K, "same": self.same, "within": self.within}
        return {**data, **more, "verdict": self.verdict}


def compare(
    one: str | Path | Run | Shown,
    other: str | Path | Run | Shown,
    *,
    acquired: bool = False,
    resample: bool = False,
    within_K: float | None = None,
) -> Difference:
    """Compares two runs, or a run with a recording.

    Args:
        one, other: runs, or folders of runs, of evaluated acquisitions or measured data.
        acquired: of runs, compare the recordings of their rigs, not the traces.
        resample: if pixels differ, average a trace onto the pixels of the recording, or of the
            coarser trace.
        within_K: RMS allowed in T_app; None: explained by both stated errors.

    Raises:
        RunFolderError: there are no maps.
        EvaluationError: the pixels differ, and may not or cannot be made the same.
    """
    first, second = (open_shown(each, acquired=acquired) for each in (one, other))
    stated_K = first.error_K, second.error_K
    parts = unshared(first, second)
    first, second, averaged = together(parts.one, parts.other, resample=resample)
    t_one, t_other = (
        each.maps.apparent_temperature_K.astype(np.float64) for each in (first, second)
    )
    has = np.isfinite(t_one), np.isfinite(t_other)
    maps = (
        _of("apparent_temperature_K", "K", t_one, t_other, second),
        _of("emissivity", "1", first.maps.emissivity, second.maps.emissivity, second),
        _of("optical_depth", "1", first.maps.optical_depth, second.maps.optical_depth, second),
    )
    beyond, chi2 = _compared(t_other - t_one, first, second)
    return Difference(
        one=first.name,
        other=second.name,
        maps=maps,
        only=(int(np.sum(has[0] & ~has[1])), int(np.sum(has[1] & ~has[0]))),
        stated_K=stated_K,
        unshared_K=(first.error_K, second.error_K),
        shared=parts.shared,
        tested=parts.tested,
        at_least=first.at_least or second.at_least,
        given_K=within_K,
        beyond=beyond,
        chi2=chi2,
        averaged=averaged,
        keys=key_differences(first.scene, second.scene) if first.scene and second.scene else (),
    )


def _of(
    name: str, unit: str, one: NDArray[np.floating], other: NDArray[np.floating], at: Shown
) -> MapDifference:
    change = np.asarray(other, np.float64) - one
    known = np.isfinite(change)
    if not known.any():
        return MapDifference(name=name, unit=unit, pixels=0)
    row, column = np.unravel_index(np.nanargmax(np.abs(change)), change.shape)
    rows, columns = change.shape
    x = at.centre_m[0] + (int(column) - (columns - 1) / 2) * at.pixel_m[0]
    z = at.centre_m[1] - (int(row) - (rows - 1) / 2) * at.pixel_m[1]
    return MapDifference(
        name=name,
        unit=unit,
        pixels=int(known.sum()),
        mean=float(np.mean(change[known])),
        rms=float(np.sqrt(np.mean(change[known] ** 2))),
        worst=float(change[row, column]),
        worst_mm=(1e3 * x, 1e3 * z),
    )


def _compared(change_K: Image, one: Shown, other: Shown) -> tuple[float | None, float | None]:
    """Share of pixels that differ by more than twice the errors there, and reduced chi-square."""
    errors = [each.error_K if each.error_map_K is None else each.error_map_K
              for each in (one, other)]  # fmt: skip
    if errors[0] is None or errors[1] is None:
        return None, None
    error = np.hypot(np.hypot(errors[0], errors[1]), _ROUNDED_K)
    known = np.isfinite(change_K) & np.isfinite(error)
    if not known.any():
        return None, None
    ratio = (np.abs(change_K) / error)[known]
    return float(np.mean(ratio > _BEYOND)), float(np.mean(ratio**2))


def key_differences(one: Scene, other: Scene) -> tuple[KeyDifference, ...]:
    """Keys whose values differ between two scenes, in the order of the scene file."""
    first, second = (dict(_leaves(each.model_dump(mode="json"))) for each in (one, other))
    return tuple(
        KeyDifference(key, first.get(key), second.get(key))
        for key in dict.fromkeys((*first, *second))
        if first.get(key) != second.get(key)
    )


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Values by their paths; a list of numbers or texts is a value."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _leaves(part, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(part, Mapping) for part in value):
        for number, part in enumerate(value):
            yield from _leaves(part, f"{path}[{number}]")
    else:
        yield path, value


def _value(value: Any) -> str:
    if value is None:
        return "nothing"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
