"""Difference of two results in T_app, emissivity and optical depth, and its test by region."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from cldit.arrays import Floats
from cldit.camera.alignment import Alignment
from cldit.comparison.causes import Cause, causes, trials
from cldit.comparison.chi_square import LEVEL, sidak_level
from cldit.comparison.members import injections_p
from cldit.comparison.pixels import together
from cldit.comparison.profiles import LineDifference, line_differences
from cldit.comparison.regions import Value, positions_m, shape_of
from cldit.comparison.registration import aligned
from cldit.comparison.shared import unshared
from cldit.comparison.shown import Observable, OneFilter, Shown, open_shown
from cldit.comparison.tested import Mode, RegionDifference, Tested, seen_in_both, tested
from cldit.comparison.verdict import Verdict
from cldit.run.ensemble import INJECTIONS
from cldit.scene.keys import KeyDifference, key_differences

Align = Literal["metadata", "images"]
_COMPARED = {"apparent_temperature_K": "K", "emissivity": "1", "optical_depth": "1"}
_CONCLUSIONS = ("effect", "interval", "seen")


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
    """Difference between two results, other minus one.

    stated_K: standard error of T_app that each states, None if none. given_K: allowed by the caller
    instead. at_least: True if a cause of a stated error is unknown. only: number of pixels with a
    T_app only in the first, and only in the second. unshared_K, unshared_emissivity: the errors
    that they do not share; shared: names of sources whose errors they share; tested: of those by
    keys that omit physics in one alone, which no error explains. code: rooms of cldit whose sources
    differ. injections_p: by permutation of the injections of both, if both have several. regions:
    `all` pixels that are visible in both, and the parts of the spray. modes: errors that all pixels
    share. averaged: description of an average onto the other's pixels. view: as found from the
    images, with its errors. keys: that differ between the scenes. causes: that explain the
    difference best. seen: both in one view. change_K: (H, W) of T_app. change, error, residuals:
    (H, W) of the observable that is tested, the second with the modes, the last in standard errors,
    less the modes that fit best. filters: number of those that are tested, for the level of each.
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
    injections_p: float | None
    regions: Mapping[str, RegionDifference]
    modes: tuple[Mode, ...]
    averaged: str
    view: str
    keys: tuple[KeyDifference, ...]
    causes: tuple[Cause, ...]
    seen: tuple[Shown, Shown] = field(repr=False)
    change_K: Floats = field(repr=False)
    change: Floats = field(repr=False)
    error: Floats = field(repr=False)
    residuals: Floats = field(repr=False)
    observable: Observable = "T_app"
    filters: int = 1

    @property
    def t_app(self) -> MapDifference:
        """Difference of T_app."""
        return self.maps[0]

    @property
    def shapes(self) -> dict[str, tuple[Value, Value]]:
        """Penetration, angle and areas of both, each with its error."""
        baseline, compared = (shape_of(shown) for shown in self.seen)
        return {name: (value, compared[name]) for name, value in baseline.items()}

    @cached_property
    def profiles(self) -> dict[str, LineDifference]:
        """Profiles of both along the spray's axis and across it, with errors."""
        spray = seen_in_both(*self.seen, self.observable)
        of_t_app = self.observable == "T_app"
        error_K = self.error if of_t_app else np.full(self.error.shape, np.nan)
        return line_differences(self.seen, spray, self.change_K, error_K=error_K, modes=self.modes)

    @property
    def level(self) -> float:
        """Level of the test in this filter."""
        return sidak_level(LEVEL, self.filters)

    @property
    def same(self) -> bool:
        """True if every value is the same, and missing in the same pixels."""
        return self.only == (0, 0) and all(not quantity.worst for quantity in self.maps)

    @property
    def p_value(self) -> float | None:
        """Probability of a larger difference by the errors; None: unknown.

        Each part of the spray has a test of its own: what differs in a small part is lost among all
        pixels. Injections on both sides are compared by their permutation; if there are errors that
        all pixels share, too, a difference must exceed both.
        """
        by_errors, by_members = self.regions["all"].p_value, self.injections_p
        if by_errors is None or by_members is None:
            return by_errors
        common = (part.name for shown in self.seen for part in shown.common)
        fixed_errors = any(not name.startswith(INJECTIONS) for name in common)
        return max(by_errors, by_members) if fixed_errors else by_members

    @property
    def where(self) -> tuple[str, ...]:
        """Parts of the spray in which the errors do not explain the difference."""
        return tuple(
            name
            for name, region in self.regions.items()
            if name != "all" and region.p_value is not None and region.p_value < self.level
        )

    @property
    def within(self) -> bool:
        """True if the errors explain the difference, or if all values are the same."""
        if self.same:
            return True
        if self.given_K is not None:
            return self.t_app.rms is not None and self.t_app.rms <= self.given_K
        return self.p_value is not None and self.p_value >= self.level

    @property
    def verdict(self) -> Verdict:
        """Conclusion, with effect, power, keys and causes."""
        if self._untested:
            return Verdict(differs=None, reason=self._untested, keys=self.keys)
        differs = not self.within
        chances = {name: self.regions[name].p_value or 0.0 for name in self.where}
        name = min(chances, key=lambda name: chances[name]) if differs and chances else "all"
        region = self.regions[name]
        return Verdict(
            differs=differs,
            region=name,
            observable=self.observable,
            effect=region.mean,
            error=region.mean_error,
            rms=region.rms,
            seen=self.regions["all"].seen,
            p_value=self.p_value,
            keys=self.keys,
            causes=self.causes if differs else (),
            at_least=self.at_least,
        )

    @property
    def _untested(self) -> str:
        """Conclusion without a test by the errors; empty if there is one."""
        if self.same:
            return "the same in every pixel"
        if self.observable == "T_app" and self.t_app.rms is None:
            return "no pixel has a T_app in both"
        if self.given_K is not None:
            return f"{'within' if self.within else 'beyond'} the {self.given_K:.2g} K RMS allowed"
        if self.p_value is None:
            if None in (
                self.unshared_K if self.observable == "T_app" else self.unshared_emissivity
            ):
                return "differs, but no error is stated to compare with; --within gives a limit"
            return "cannot be tested: too few pixels are visible in both"
        return ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        images = {"seen", "change_K", "change", "error", "residuals", "modes", "regions"}
        data = {
            item.name: getattr(self, item.name) for item in fields(self) if item.name not in images
        }
        data["maps"] = [asdict(quantity) for quantity in self.maps]
        data["keys"] = [asdict(key) for key in self.keys]
        data["regions"] = {name: region.to_dict() for name, region in self.regions.items()}
        data["modes"] = {mode.name: mode.size for mode in self.modes}
        data["shapes"] = self.shapes
        data["profiles"] = {name: line.columns for name, line in self.profiles.items()}
        verdict, suffix = self.verdict, "_K" if self.observable == "T_app" else "_emissivity"
        del data["causes"]
        return {
            **data,
            "same": self.same,
            "within": self.within,
            "where": self.where,
            "verdict": {
                "text": verdict.lines,
                "differs": verdict.differs,
                "region": verdict.region,
                "p_value": verdict.p_value,
                **{f"{name}{suffix}": getattr(verdict, name) for name in _CONCLUSIONS},
                "causes": [asdict(cause) for cause in verdict.causes],
            },
        }


def difference(
    baseline: OneFilter,
    compared: OneFilter,
    *,
    acquired: bool = False,
    within_K: float | None = None,
    align: Align = "metadata",
    observable: Observable = "T_app",
    filters: int = 1,
) -> Difference:
    """Difference of two results: runs, or folders of runs, of acquisitions or measured data.

    `acquired` takes recordings of runs, not their traces. `within_K` is the RMS allowed in T_app in
    place of the errors. `align` finds the view from the images, or takes it from the metadata.
    `observable` is tested, at the level of one of so many `filters`.
    Raises RunFolderError without maps, EvaluationError if the pixels cannot be brought together.
    """
    opened = [open_shown(openable, acquired=acquired) for openable in (baseline, compared)]
    parts = unshared(opened[0], opened[1])
    unaligned = parts.baseline, parts.compared
    reference, result, averaged = together(*unaligned, centred=align == "metadata")
    view, of_view = None, list[tuple[Floats, Floats]]()
    if align == "images":
        reference, result, view, of_view = aligned(reference, result)
    change_K = _change("apparent_temperature_K", reference, result)
    change = change_K if observable == "T_app" else _change("emissivity", reference, result)
    test = tested(
        change, reference, result, of_view, observable=observable, level=sidak_level(LEVEL, filters)
    )
    has, other_has = (np.isfinite(s.maps.apparent_temperature_K) for s in (reference, result))
    return Difference(
        one=reference.name,
        other=result.name,
        maps=tuple(_of(name, unit, reference, result) for name, unit in _COMPARED.items()),
        only=(int(np.sum(has & ~other_has)), int(np.sum(other_has & ~has))),
        stated_K=(opened[0].error_K, opened[1].error_K),
        unshared_K=(reference.error_K, result.error_K),
        unshared_emissivity=(reference.emissivity_error, result.emissivity_error),
        shared=parts.shared,
        tested=parts.tested,
        code=parts.code,
        at_least=reference.at_least or result.at_least,
        given_K=within_K,
        injections_p=injections_p(
            reference.run, result.run, test.where["all"], of_emissivity=observable == "emissivity"
        ),
        regions=test.regions,
        modes=test.modes,
        averaged=averaged,
        view="" if view is None else view.text,
        keys=_keys(*unaligned),
        causes=_explained(change, test, unaligned, (reference, result), view),
        seen=(reference, result),
        change_K=change_K,
        change=change,
        error=test.error,
        residuals=test.residuals,
        observable=observable,
        filters=filters,
    )


def _explained(
    change: Floats,
    test: Tested,
    unaligned: tuple[Shown, Shown],
    seen: tuple[Shown, Shown],
    view: Alignment | None,
) -> tuple[Cause, ...]:
    """Causes of a change (H, W) that the errors do not explain; temperatures change T_app alone."""
    p_value = test.regions["all"].p_value
    if p_value is None or p_value >= test.level:
        return ()
    of_t_app = test.observable == "T_app"
    onto = partial(_onto, unaligned, view)
    return causes(change, test, trials(*unaligned, seen, onto) if of_t_app else ())


def _onto(pair: tuple[Shown, Shown], view: Alignment | None, trace: Shown) -> Floats:
    """T_app (H, W) of a trace, one of the `pair` evaluated otherwise, on the common pixels."""
    traced = 1 if pair[1].run is not None else 0
    moved = (pair[0], trace) if traced else (trace, pair[1])
    averaged = together(*moved, centred=view is None)[:2]
    kelvin = averaged[traced].maps.apparent_temperature_K.astype(np.float64)
    swapped = pair[1].noisy and not pair[0].noisy
    return kelvin if view is None or swapped is bool(traced) else view.moved(kelvin)


def _keys(baseline: Shown, compared: Shown) -> tuple[KeyDifference, ...]:
    """Keys that differ between the scenes, if both are known."""
    scenes = [
        shown.scene or (shown.traced and shown.traced.scene) for shown in (baseline, compared)
    ]
    return key_differences(scenes[0], scenes[1]) if scenes[0] and scenes[1] else ()


def _change(name: str, baseline: Shown, compared: Shown) -> Floats:
    """Change (H, W) of a map by its name."""
    images = (getattr(shown.maps, name).astype(np.float64) for shown in (compared, baseline))
    return np.asarray(np.subtract(*images))


def _of(name: str, unit: str, baseline: Shown, compared: Shown) -> MapDifference:
    change = _change(name, baseline, compared)
    finite = np.isfinite(change)
    if not finite.any():
        return MapDifference(name=name, unit=unit, pixels=0)
    worst = np.unravel_index(np.nanargmax(np.abs(change)), change.shape)
    x_m, z_m = positions_m(change.shape, pixel_m=compared.pixel_m, centre_m=compared.centre_m)
    return MapDifference(
        name=name,
        unit=unit,
        pixels=int(finite.sum()),
        mean=float(np.mean(change[finite])),
        rms=float(np.sqrt(np.mean(change[finite] ** 2))),
        worst=float(change[worst]),
        worst_mm=(float(1e3 * x_m[worst]), float(1e3 * z_m[worst])),
    )
