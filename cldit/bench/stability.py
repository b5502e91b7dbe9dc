"""Stiff and extreme cases, each with the error that it reaches and the bound that holds for it.

`cldit bench stability` writes the table as a page.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from cldit.bench.report import Table
from cldit.bench.stability_case import Bench, Case, Outcome
from cldit.bench.stability_extremes import ExtremeOutcome, extremes_table
from cldit.bench.stability_slabs import SlabOutcome, slab_table
from cldit.errors import ClditError
from cldit.gpu.device import Device


def bench_stability(
    device: Device,
    chosen: list[Case],
    *,
    say: Callable[[str], None] | None = None,
) -> list[Outcome]:
    """Runs the cases; a case that ends with an error has no error figure, but its message.

    Args:
        device: to trace on.
        chosen: the cases.
        say: takes lines of progress.

    Returns:
        An outcome for each case.
    """
    outcomes = []
    with TemporaryDirectory(prefix="cldit-stability-") as place:
        bench = Bench(device, Path(place))
        for case in chosen:
            try:
                outcome = Outcome(case, case.measure(bench))
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


def page(
    outcomes: list[Outcome],
    extremes: list[ExtremeOutcome],
    slabs: list[SlabOutcome],
    device: Device,
    *,
    command: str,
) -> str:
    """The tables as Markdown.

    Args:
        outcomes, extremes, slabs: of all cases.
        device: traced on.
        command: makes the page again.
    """
    blocks = [
        "# Stability: stiff and extreme cases",
        "The first tables have answers that are known without another solver: a cavity at one\n"
        "temperature is flat, an absorbing medium follows Beer-Lambert, an isothermal spray that\n"
        "does not scatter has its own temperature. Their error is the largest over all pixels,\n"
        "in weights (0 to 1) where no unit stands beside it; for `path` and `branching`, which\n"
        "have noise, that of the mean. Nothing is normalised to reach it.",
        "The last two tables hold the error of T_app that a run states against the true one:\n"
        "of extreme media, and of slabs against discrete ordinates (PythonicDISORT).",
        f"```sh\n{command}\n```",
        f"Made on {device.info.name} ({device.info.version}).",
    ]
    groups = dict.fromkeys(outcome.case.group for outcome in outcomes)
    for group in groups:
        rows = [
            [
                outcome.case.name,
                _reached(outcome),
                f"{outcome.case.bound:g}"
                if outcome.holds
                else f"{outcome.case.bound:g}: **missed**",
            ]
            for outcome in outcomes
            if outcome.case.group == group
        ]
        blocks += [
            f"## {group.capitalize()}",
            Table.of(("case", "error", "bound"), rows).markdown(),
        ]
    blocks += [
        "## Extreme media: stated and true error",
        "RMS of T_app over the pixels that have one; `transport.accuracy_K` is left at 1 K. The\n"
        "truth of voxels is `path` with nine rays a pixel, that of parcels the spray that they\n"
        "are drawn from. ± is the standard error of the truth, where it counts. A row in bold\n"
        "states less than half of its error. Seconds are of the whole run, with the measuring of\n"
        "its error, on a machine that may have had other work.",
        extremes_table(extremes),
        "## Slabs against discrete ordinates",
        "Emission, reflection and transmission along the normal of a slab at 400 K between walls\n"
        "at 300 K, with those of discrete ordinates of 48 streams in brackets; errors as above.\n"
        "Where `at least` stands, a cause is unknown: light that is scattered very often is not\n"
        "audited, and three pixels do not tell what pixels leave out. `unknown` beside `no\n"
        "T_app`: the emissivity is below 0.05 in all pixels, so that no T_app counts.",
        slab_table(slabs),
    ]
    return "\n\n".join(blocks) + "\n"
