"""Stiff and extreme cases, each with the error that it reaches and the bound that holds for it.

`cldit bench stability` writes the table as a page.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from cldit.bench.report import Table
from cldit.bench.stability_case import Bench, Case, Outcome
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


def page(outcomes: list[Outcome], device: Device, *, command: str) -> str:
    """The tables as Markdown.

    Args:
        outcomes: of all cases.
        device: traced on.
        command: makes the page again.
    """
    blocks = [
        "# Stability: stiff and extreme cases",
        "Every case but the slabs, which are the last table and are held against discrete\n"
        "ordinates (PythonicDISORT), has an answer that is known without another solver: a\n"
        "cavity at one temperature is flat, an absorbing medium follows Beer-Lambert, an\n"
        "isothermal spray that does not scatter has its own temperature. But for the slabs, the\n"
        "error is the largest over all pixels, in weights (0 to 1) where no unit stands beside\n"
        "it; for `path` and `branching`, which have noise, that of the mean. Nothing is\n"
        "normalised to reach it.",
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
    return "\n\n".join(blocks) + "\n"
