"""`cldit.compare`: one result against others, refused where a comparison would have no meaning."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cldit.comparison.chi_square import probability, sidak
from cldit.comparison.difference import Align, Difference, difference
from cldit.comparison.pixels import together
from cldit.comparison.shown import Observable, OneFilter, Openable, Shown, open_filters, open_shown
from cldit.dit.budget import Part
from cldit.dit.maps import Reason
from cldit.errors import EvaluationError
from cldit.io.presented import xarray_module
from cldit.optics.response import edges_um, scene_filter
from cldit.run import reevaluated
from cldit.run.labelled import labelled_maps

if TYPE_CHECKING:
    import xarray

_SAME_FILTER_UM = 0.02  # at either edge: twice the usual uncertainty of a filter


@dataclass(frozen=True, kw_only=True)
class FilterDifferences:
    """Differences of one result from another in each of several filters, by name.

    Each filter has a test of its own, and the smallest p decides, for so many tests (Sidak 1967).
    Errors that filters share, such as those of the black body or of the amount of spray, make it
    alarm less often than stated and never more often (Royen 2014: symmetric convex regions of
    normal variables are positively correlated).
    """

    other: str
    by_filter: Mapping[str, Difference]

    @property
    def within(self) -> bool:
        """True if the errors explain the differences in all filters."""
        return all(pair.within for pair in self.by_filter.values())

    @property
    def power(self) -> bool:
        """False if the stated errors exceed all that differs, in every filter."""
        return any(pair.verdict.power for pair in self.by_filter.values())

    @property
    def p_value(self) -> float | None:
        """Probability of a larger difference in any filter by the errors alone; None: unknown."""
        tested = [pair.p_value for pair in self.by_filter.values() if pair.p_value is not None]
        return sidak(tested) if len(tested) == len(self.by_filter) else None

    @property
    def text(self) -> str:
        """Verdict of all filters, with those that have the effect; empty for a single filter."""
        if len(self.by_filter) < 2:
            return ""
        where = [name for name, pair in self.by_filter.items() if not pair.within]
        start = f"differs in {', '.join(where)}" if where else "no difference is seen"
        start = start if where or self.power else "no power"
        chance = "" if self.p_value is None else f" ({probability(self.p_value)})"
        return f"{self.other}: {start}{chance}, by {len(self.by_filter)} filters"


@dataclass(frozen=True)
class Comparison:
    """One result against others, in the order in which they were given."""

    results: tuple[FilterDifferences, ...]

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Differences of all filters of all results."""
        return tuple(pair for result in self.results for pair in result.by_filter.values())

    @property
    def differs(self) -> bool:
        """True if the errors do not explain one of the differences."""
        return not all(result.within for result in self.results)

    @property
    def verdict(self) -> str:
        """Verdict by several filters, and simulations that are ruled out; empty for one of each."""
        lines = [result.text for result in self.results if result.text]
        if len(self.results) > 1:
            explained = [result for result in self.results if result.within]
            groups = {
                "ruled out": [result for result in self.results if not result.within],
                "not ruled out": [result for result in explained if result.power],
                "no power": [result for result in explained if not result.power],
            }
            lines.append(
                "; ".join(
                    f"{name}: {', '.join(result.other for result in results)}"
                    for name, results in groups.items()
                    if results
                )
            )
        return "\n".join(lines)

    def to_xarray(self) -> xarray.Dataset:
        """Change of T_app and standardised residuals (other, z, x) over z and x in mm.

        Raises:
            ClditError: xarray is not installed.
        """
        xr = xarray_module()
        parts = []
        for pair in self.differences:
            _, seen = pair.seen
            data = labelled_maps(
                seen.maps,
                title=pair.one,
                pixel_m=seen.pixel_m,
                centre_m=seen.centre_m,
                extra_variables={
                    "change_K": (pair.change_K, "K", "T_app less that of the first"),
                    "residuals": (pair.residuals, "1", "change in standard errors"),
                },
            )
            parts.append(data[["change_K", "residuals"]].expand_dims(other=[pair.other]))
        dataset: xarray.Dataset = xr.concat(parts, dim="other")
        return dataset

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: that of the difference, or of a list of several."""
        if len(self.differences) == 1:
            return self.differences[0].to_dict()
        pairs = [
            {**pair.to_dict(), "filter": name}
            for result in self.results
            for name, pair in result.by_filter.items()
        ]
        p_values = {result.other: result.p_value for result in self.results}
        return {"comparisons": pairs, "verdict": self.verdict, "p_values": p_values}


def compare(
    one: Openable,
    *compared: Openable,
    acquired: bool = False,
    within_K: float | None = None,
    align: Align = "metadata",
    lines: Mapping[str, OneFilter] | None = None,
    extinction: Collection[str] = (),
) -> Comparison:
    """Compares a result, measured or simulated, with others in the same view.

    Args:
        one: a run, or the folder of a run, of an evaluated acquisition or of measured data; of
            several filters, such results by the filters' names, or an acquisition with a wheel.
        compared: likewise, of the same filters.
        acquired: of runs, compare the recordings of their rigs, not the traces.
        within_K: RMS allowed in T_app; None: explained by the errors of both.
        align: scale, rotation, shift and mirror from the `metadata` or from the `images`.
        lines: runs by name, each the first run of these with one quantity changed by its
            spread (k, vapour, sizes, gas grid): an error that all simulations share.
        extinction: filters in whose band the vapour is transparent: their emissivity is tested,
            the extinction, since T_app is there that of the light that droplets scatter.

    Returns:
        Differences from each of the others by filter, with regions, causes and the test.

    Raises:
        RunFolderError: there are no maps.
        EvaluationError: no other result, no T_app, other filters, or no spray that both see.
    """
    if not compared:
        raise EvaluationError("one result alone; allowed: two or more")
    opened = [open_filters(openable, acquired=acquired) for openable in (one, *compared)]
    names = [
        _name(openable, shown) for openable, shown in zip((one, *compared), opened, strict=True)
    ]
    filters = _filters_of(names, opened)
    _check_options(filters, extinction, lines)
    variants = {name: open_shown(openable) for name, openable in (lines or {}).items()}
    several = len(filters) > 1
    differences: list[dict[str, Difference]] = [{} for _ in compared]
    for name in filters:
        shown = [result[name] if several else next(iter(result.values())) for result in opened]
        of: Observable = "emissivity" if name in extinction else "T_app"
        _check([*shown, *variants.values()], with_t_app=of == "T_app")
        subtract = partial(
            difference, within_K=within_K, align=align, observable=of, filters=len(filters)
        )
        pairs = _of_filter(shown[0], shown[1:], variants, subtract)
        for by_filter, pair in zip(differences, pairs, strict=True):
            by_filter[name] = pair
    return Comparison(
        tuple(
            FilterDifferences(other=other, by_filter=pairs)
            for other, pairs in zip(names[1:], differences, strict=True)
        )
    )


def _of_filter(
    reference: Shown,
    compared: Sequence[Shown],
    variants: Mapping[str, Shown],
    subtract: Callable[[Shown, Shown], Difference],
) -> Iterator[Difference]:
    """Differences of results from the first one; EvaluationError if no pixel is visible in both."""
    base = next((result for result in compared if result.run is not None), None)
    for result in compared:
        pair = subtract(reference, with_lines(result, onto=reference, base=base, variants=variants))
        if not pair.regions["all"].pixels and not pair.same:
            sides = f"{pair.one} and {pair.other}"
            raise EvaluationError(f"{sides}: no pixel is visible in both; is it the same view?")
        yield pair


def _name(openable: Openable, shown: Mapping[str, Shown]) -> str:
    """Name of a result; of several filters that of its folder, or those of all."""
    if isinstance(openable, str | Path):
        return str(openable)
    return ", ".join(dict.fromkeys(result.name for result in shown.values()))


def _filters_of(names: Sequence[str], opened: Sequence[Mapping[str, Shown]]) -> list[str]:
    """Filters that all results have; single ones may have any name, since their edges are compared.

    Raises EvaluationError if they differ.
    """
    named = next((list(shown) for shown in opened if "" not in shown), [""])
    for shown in opened:
        if set(shown) != set(named) and not len(shown) == len(named) == 1:
            texts = [
                f"{name} has {', '.join(filter(None, shown)) or 'one without a name'}"
                for name, shown in zip(names, opened, strict=True)
            ]
            raise EvaluationError(
                f"filters: {'; '.join(texts)}; allowed: the same for all, where FILTER=RESULT "
                "names that of a run and takes one of several"
            )
    return named


def _check_options(
    filters: Sequence[str], extinction: Collection[str], lines: Mapping[str, OneFilter] | None
) -> None:
    if unknown := set(extinction) - set(filters):
        named = ", ".join(name for name in filters if name) or "none, as NAME=RESULT names one"
        raise EvaluationError(f"extinction: {', '.join(sorted(unknown))}; allowed: {named}")
    if lines and len(filters) > 1:
        raise EvaluationError(f"lines: {len(filters)} filters; allowed: results of one filter")


def _check(shown: Sequence[Shown], *, with_t_app: bool) -> None:
    for result in shown:
        if with_t_app and not np.isfinite(result.maps.apparent_temperature_K).any():
            counts = result.maps.count()
            frequent = max(counts, key=lambda reason: counts[reason], default=Reason.OK)
            raise EvaluationError(f"{result.name}: no pixel has a T_app: {frequent.text}")
    filters = [(result.name, _filter_um(result)) for result in shown]
    stated = [(name, edges) for name, edges in filters if edges is not None]
    for name, edges in stated[1:]:
        if not np.allclose(edges, stated[0][1], rtol=0.0, atol=_SAME_FILTER_UM):
            texts = [f"{low:g} to {high:g} um" for low, high in (stated[0][1], edges)]
            raise EvaluationError(
                f"{stated[0][0]} has the filter {texts[0]}, {name} has {texts[1]}; "
                "allowed: the same"
            )


def _filter_um(shown: Shown) -> tuple[float, float] | None:
    if shown.filter_um is not None:
        return shown.filter_um
    return None if shown.scene is None else edges_um(scene_filter(shown.scene))


def with_lines(
    shown: Shown, *, onto: Shown, base: Shown | None, variants: Mapping[str, Shown]
) -> Shown:
    """A simulation with the change of its T_app by each of the `variants`, and by its walls.

    variants: the simulation `base` with one quantity changed by its spread each. onto: the result
    with which it is compared, whose setup states the spread of the walls. Recordings, and runs
    beside runs, have no such lines but the variants'.
    """
    if shown.run is None:
        return shown
    parts = [_part(name, base or shown, variant, onto) for name, variant in variants.items()]
    parts += _walls(shown, onto)
    return replace(shown, systematic=(*shown.systematic, *parts))


def _part(name: str, base: Shown, variant: Shown, onto: Shown) -> Part:
    if base.run is None or variant.run is None:
        raise EvaluationError(f"line {name}: {variant.name} is no run; allowed: a run")
    unchanged, changed = (together(onto, result)[1].maps for result in (base, variant))
    if unchanged.emissivity.shape != changed.emissivity.shape:
        raise EvaluationError(f"line {name}: {variant.name} has other pixels than {base.name}")
    change_K = changed.apparent_temperature_K.astype(float) - unchanged.apparent_temperature_K
    return Part(
        name=name,
        kelvin=np.nan_to_num(change_K),
        emissivity=np.nan_to_num(changed.emissivity.astype(float) - unchanged.emissivity),
    )


def _walls(shown: Shown, onto: Shown) -> Iterator[Part]:
    """Change by walls that are warmer by their spread, as the measurement states it."""
    spread_K = onto.walls_spread_K
    if shown.run is None or not spread_K:
        return
    scene = shown.run.scene
    warmer = scene.with_(**{"walls.temperature_K": scene.walls.temperature_K + spread_K})
    run = reevaluated(shown.run, warmer)
    yield _part(f"walls by {spread_K:g} K", shown, replace(shown, maps=run.maps, run=run), onto)
