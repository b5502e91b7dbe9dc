"""`cldit.compare`: one result against others, refused where a comparison would have no meaning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cldit.comparison.difference import Align, Difference, difference
from cldit.comparison.pixels import together
from cldit.comparison.shown import Openable, Shown, open_shown
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


@dataclass(frozen=True)
class Comparison:
    """One result against others: differences in the order in which they were given."""

    differences: tuple[Difference, ...]

    @property
    def differs(self) -> bool:
        """True if the errors do not explain one of the differences."""
        return not all(pair.within for pair in self.differences)

    @property
    def verdict(self) -> str:
        """Simulations that the errors rule out, on one line; empty for one."""
        if len(self.differences) < 2:
            return ""
        explained = [pair for pair in self.differences if pair.within]
        groups = {
            "ruled out": [pair for pair in self.differences if not pair.within],
            "not ruled out": [pair for pair in explained if pair.verdict.power],
            "no power": [pair for pair in explained if not pair.verdict.power],
        }
        return "; ".join(
            f"{name}: {', '.join(pair.other for pair in pairs)}"
            for name, pairs in groups.items()
            if pairs
        )

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
        pairs = [pair.to_dict() for pair in self.differences]
        return {"comparisons": pairs, "verdict": self.verdict}


def compare(
    one: Openable,
    *compared: Openable,
    acquired: bool = False,
    within_K: float | None = None,
    align: Align = "metadata",
    lines: Mapping[str, Openable] | None = None,
) -> Comparison:
    """Compares a result, measured or simulated, with others in the same view.

    Args:
        one: a run, or the folder of a run, of an evaluated acquisition or of measured data.
        compared: likewise.
        acquired: of runs, compare the recordings of their rigs, not the traces.
        within_K: RMS allowed in T_app; None: explained by the errors of both.
        align: scale, rotation, shift and mirror from the `metadata` or from the `images`.
        lines: runs by name, each the first run of these with one quantity changed by its
            spread (k, vapour, sizes, gas grid): an error that all simulations share.

    Returns:
        Differences from each of the others, with regions, causes and the test.

    Raises:
        RunFolderError: there are no maps.
        EvaluationError: no other result, no T_app, other filters, or no spray that both see.
    """
    if not compared:
        raise EvaluationError("one result alone; allowed: two or more")
    reference = open_shown(one, acquired=acquired)
    shown = [open_shown(openable, acquired=acquired) for openable in compared]
    variants = {name: open_shown(openable) for name, openable in (lines or {}).items()}
    _check([reference, *shown, *variants.values()])
    base = next((result for result in shown if result.run is not None), None)
    shown = [with_lines(result, onto=reference, base=base, variants=variants) for result in shown]
    differences = [
        difference(reference, result, within_K=within_K, align=align) for result in shown
    ]
    for pair in differences:
        if not pair.regions["all"].pixels and not pair.same:
            raise EvaluationError(
                f"{pair.one} and {pair.other}: no pixel is visible in both; is it the same view?"
            )
    return Comparison(tuple(differences))


def _check(shown: Sequence[Shown]) -> None:
    for result in shown:
        if not np.isfinite(result.maps.apparent_temperature_K).any():
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
