"""Stiff and extreme cases of the transport, each with its error and the bound that holds for it.

    python -m tests.bench stability

writes docs/benchmarks/stability.md in half an hour, with 5 GB of memory for 1e7 cells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from cldit.bench.report import Part
from cldit.errors import ClditError, TransportError
from cldit.gpu.device import Device
from cldit.show.page import Table
from tests.bench.page import Given, write_measured
from tests.bench.slabs import SlabOutcome, bench_slabs, need_discrete_ordinates, slab_table, slabs
from tests.verify.blocks import Blocks
from tests.verify.extreme_media import (
    ExtremeOutcome,
    bench_extremes,
    extremes,
    extremes_table,
)
from tests.verify.known_cases import Case, cases


@dataclass(frozen=True)
class Outcome:
    """error: NaN if the case ended with the message instead."""

    case: Case
    error: float
    message: str = ""

    @property
    def holds(self) -> bool:
        """True if the error is within the bound."""
        return self.error <= self.case.bound


def bench_stability(
    device: Device, chosen: list[Case], *, say: Callable[[str], None] | None = None
) -> list[Outcome]:
    """Runs the cases; `say` takes a line for each."""
    outcomes = []
    with TemporaryDirectory(prefix="cldit-stability-") as place:
        blocks = Blocks(device, Path(place), Path(place) / "cache")
        for case in chosen:
            try:
                outcome = Outcome(case, case.measure(blocks))
            except ClditError as error:
                outcome = Outcome(case, float("nan"), str(error))
            if say is not None:
                say(f"{case.group}: {case.name}: {_reached(outcome)}")
            outcomes.append(outcome)
    return outcomes


def _reached(outcome: Outcome) -> str:
    if outcome.message:
        return f"refused: {outcome.message}"
    unit = "" if outcome.case.unit == "1" else f" {outcome.case.unit}"
    return f"{outcome.error:.1e}{unit}" if outcome.error else f"0{unit}"


def known_table(outcomes: list[Outcome]) -> Table:
    """Row for the worst case of each group and bound, and for each case beyond its bound."""
    groups: dict[tuple[str, float], list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault((outcome.case.group, outcome.case.bound), []).append(outcome)
    rows = []
    for (group, bound), found in groups.items():
        held = [outcome for outcome in found if outcome.holds]
        shown = [outcome for outcome in found if not outcome.holds]
        if held:
            shown.insert(0, max(held, key=lambda outcome: outcome.error))
        for outcome in shown:
            limit = f"{bound:g}" if outcome.holds else f"{bound:g}: **missed**"
            rows.append((group, str(len(found)), outcome.case.name, _reached(outcome), limit))
    return Table(("group", "cases", "worst", "error", "bound"), rows)


_TEXT = (
    "**Known answers** (first table): a cavity at one temperature is flat, an absorbing medium "
    "follows Beer-Lambert, and an isothermal spray that does not scatter has its own temperature. "
    "The error is the largest over all pixels, in weights from 0 to 1 unless a unit is given; for "
    "`path` and `branching` it is that of the mean.",
    "**Extreme media** (second table): RMS error of T_app at 1 K. The truth of voxels is `path` "
    "with nine rays per pixel, that of parcels the continuous spray from which they are drawn; ± "
    "is its standard error. Bold: less than half of the error is stated.",
    "**Slabs** (third table): stated/true error of T_app in K at 400 K between walls at 300 K, "
    "along the normal, against discrete ordinates (PythonicDISORT, 48 streams). Slabs have four "
    "layers of cells, unless one is given. ≥: an error source is unknown. ?: nothing is stated. "
    "-: emissivity below 0.05, no T_app.",
)


def stability_part(
    outcomes: list[Outcome], media: list[ExtremeOutcome], layers: list[SlabOutcome]
) -> Part:
    """Page of all cases."""
    apart = [abs(a - b) for o in layers if o.stated for a, b in zip(o.reached, o.true, strict=True)]
    return Part(
        name="stability",
        title="Stability: stiff and extreme cases of the transport",
        tables=(known_table(outcomes), extremes_table(media), slab_table(layers)),
        data={
            "known": [[o.case.group, o.case.name, _reached(o), o.case.bound] for o in outcomes],
            "slabs": [[*vars(o.slab).values(), *o.reached, *o.true] for o in layers],
        },
        text=(
            *_TEXT,
            "Emission, reflection and transmission differ from discrete ordinates by at most "
            f"{max(apart, default=0.0):.4f}.",
        ),
    )


def stability(given: Given) -> Part:
    """Runs all cases."""
    outcomes = bench_stability(given.device, cases(), say=given.say)
    with TemporaryDirectory(prefix="cldit-stability-") as place:
        blocks = Blocks(given.device, Path(place), Path(place) / "cache")
        media = bench_extremes(blocks, extremes(), say=given.say)
        layers = bench_slabs(blocks, slabs(), say=given.say)
    missed = [outcome.case.name for outcome in outcomes if not outcome.holds]
    missed += [outcome.name for outcome in media if not outcome.holds]
    missed += [str(outcome.slab) for outcome in layers if not outcome.holds]
    for name in missed:
        given.say(f"missed: {name}")
    part = stability_part(outcomes, media, layers)
    if missed:
        given.save(part)
        raise TransportError(f"{len(missed)} cases miss their bound: {'; '.join(missed)}")
    return part


def main() -> None:
    """Writes the page."""
    need_discrete_ordinates()
    write_measured(stability)
