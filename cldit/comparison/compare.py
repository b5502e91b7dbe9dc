"""`cldit.compare`: one result against others, refused where a comparison would have no meaning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cldit.comparison.difference import Align, Difference, difference
from cldit.comparison.lines import with_lines
from cldit.comparison.shown import Openable, Shown, open_shown
from cldit.dit.maps import Reason
from cldit.errors import EvaluationError
from cldit.io.presented import xarray_module
from cldit.optics.response import edges_um, scene_filter
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
        return not all(one.within for one in self.differences)

    @property
    def verdict(self) -> str:
        """Simulations that the errors rule out, on one line; empty for one."""
        if len(self.differences) < 2:
            return ""
        left = [one for one in self.differences if one.within]
        groups = {
            "ruled out": [one for one in self.differences if not one.within],
            "not ruled out": [one for one in left if one.verdict.power],
            "no power": [one for one in left if not one.verdict.power],
        }
        return "; ".join(
            f"{name}: {', '.join(one.other for one in each)}"
            for name, each in groups.items()
            if each
        )

    def to_xarray(self) -> xarray.Dataset:
        """Change of T_app and standardised residuals (other, z, x) over z and x in mm.

        Raises:
            ClditError: xarray is not installed.
        """
        xr = xarray_module()
        parts = []
        for each in self.differences:
            _, seen = each.seen
            data = labelled_maps(
                seen.maps,
                title=each.one,
                pixel_m=seen.pixel_m,
                centre_m=seen.centre_m,
                extra_variables={
                    "change_K": (each.change_K, "K", "T_app less that of the first"),
                    "residuals": (each.residuals, "1", "change in standard errors"),
                },
            )
            parts.append(data[["change_K", "residuals"]].expand_dims(other=[each.other]))
        found: xarray.Dataset = xr.concat(parts, dim="other")
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: that of the difference, or of a list of several."""
        if len(self.differences) == 1:
            return self.differences[0].to_dict()
        each = [one.to_dict() for one in self.differences]
        return {"comparisons": each, "verdict": self.verdict}


def compare(
    one: Openable,
    *others: Openable,
    acquired: bool = False,
    within_K: float | None = None,
    align: Align = "metadata",
    lines: Mapping[str, Openable] | None = None,
) -> Comparison:
    """Compares a result, measured or simulated, with others in the same view.

    Args:
        one, others: runs, or folders of runs, of evaluated acquisitions or of measured data.
        acquired: of runs, compare the recordings of their rigs, not the traces.
        within_K: RMS allowed in T_app; None: explained by the errors of both.
        align: scale, rotation, shift and mirror from the `metadata` or from the `images`.
        lines: runs by name, each the first run of the others with one quantity changed by its
            spread (k, vapour, sizes, gas grid): an error that all simulations share.

    Returns:
        Differences from each of the others, with regions, causes and the test.

    Raises:
        RunFolderError: there are no maps.
        EvaluationError: no other result, no T_app, other filters, or no spray that both see.
    """
    if not others:
        raise EvaluationError("one result alone; allowed: two or more")
    first = open_shown(one, acquired=acquired)
    shown = [open_shown(each, acquired=acquired) for each in others]
    variants = {name: open_shown(each) for name, each in (lines or {}).items()}
    _check([first, *shown, *variants.values()])
    base = next((each for each in shown if each.run is not None), None)
    shown = [with_lines(each, onto=first, base=base, variants=variants) for each in shown]
    found = [
        difference(first, each, resample=True, within_K=within_K, align=align) for each in shown
    ]
    for each in found:
        if not each.regions["all"].pixels and not each.same:
            raise EvaluationError(
                f"{each.one} and {each.other}: no pixel is visible in both; is it the same view?"
            )
    return Comparison(tuple(found))


def _check(shown: Sequence[Shown]) -> None:
    for one in shown:
        if not np.isfinite(one.maps.apparent_temperature_K).any():
            counts = one.maps.count()
            why = max(counts, key=lambda reason: counts[reason], default=Reason.OK)
            raise EvaluationError(f"{one.name}: no pixel has a T_app: {why.text}")
    filters = [(one.name, _filter_um(one)) for one in shown]
    known = [(name, edges) for name, edges in filters if edges is not None]
    for name, edges in known[1:]:
        if not np.allclose(edges, known[0][1], rtol=0.0, atol=_SAME_FILTER_UM):
            texts = [f"{low:g} to {high:g} um" for low, high in (known[0][1], edges)]
            raise EvaluationError(
                f"{known[0][0]} has the filter {texts[0]}, {name} has {texts[1]}; allowed: the same"
            )


def _filter_um(shown: Shown) -> tuple[float, float] | None:
    if shown.filter_um is not None:
        return shown.filter_um
    return None if shown.scene is None else edges_um(scene_filter(shown.scene))
