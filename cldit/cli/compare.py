"""`cldit compare`: differences of results, in kelvin."""

from pathlib import Path
from typing import Any

import click

from cldit.api.repeat import repeat
from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors, print_table
from cldit.cli.options import PATH, device_option, figures_option, within_option
from cldit.cli.program import Exit
from cldit.cli.results import print_files
from cldit.comparison.compare import Comparison, compare
from cldit.comparison.difference import Align, Difference, MapDifference
from cldit.io.images import words
from cldit.run.trusted import open_device


@click.command("compare")
@click.argument("baseline", metavar="ONE", type=PATH)
@click.argument("compared", metavar="[OTHERS]...", nargs=-1, type=PATH)
@click.option("--repeat", "again", is_flag=True, help="Compute the run ONE again; compare both.")
@click.option("--changed-inputs", is_flag=True, help="Repeat also with other or missing inputs.")
@click.option("--acquired", is_flag=True, help="Of runs, compare the recordings of their rigs.")
@click.option(
    "--align",
    type=click.Choice(["metadata", "images"]),
    default="metadata",
    help="Find the view from the images; default: by pixel size and injector tip.",
)
@click.option(
    "--line",
    "lines",
    multiple=True,
    metavar="NAME=RUN",
    help="Run with one quantity changed by its spread, an error that simulations share.",
)
@click.option(
    "--extinction",
    multiple=True,
    metavar="FILTER",
    help="Filter in which the vapour is transparent; its emissivity is compared.",
)
@click.option("--out", type=PATH, help="Folder of a page with tables; of the run of --repeat.")
@figures_option
@within_option
@device_option
@json_option
@plain_errors
def compare_command(
    baseline: Path,
    compared: tuple[Path, ...],
    again: bool,
    changed_inputs: bool,
    acquired: bool,
    align: Align,
    lines: tuple[str, ...],
    extinction: tuple[str, ...],
    out: Path | None,
    suffix: str | None,
    within_K: float | None,
    device: str | None,
) -> Outcome:
    """Compare ONE with OTHERS, with the errors of both: measured data, evaluations, runs.

    Of several filters, each is an acquisition with all of them, or FILTER=RESULT,FILTER=RESULT.
    With --repeat, compute the run ONE again from its record, its acquisition included, and compare
    both; inputs that are missing or changed are named. The exit status is 3 if the errors do not
    explain the difference.
    """
    if again:
        if compared or acquired or lines or extinction or suffix is not None:
            raise click.UsageError("--repeat: one run; allowed: --out, --within, --device")
        shared: dict[str, Any] = {"out": out, "within_K": within_K, "device": device}
        return _repeated(baseline, changed_inputs=changed_inputs, **shared)
    if not compared or changed_inputs or device is not None:
        raise click.UsageError("allowed: ONE OTHERS.., or ONE --repeat, with its options")
    if suffix is not None and out is None:
        raise click.UsageError("--format: of the figures in --out; give --out too")
    if malformed := [line for line in lines if not all(line.partition("="))]:
        raise click.BadParameter(f"{malformed[0]!r}; allowed: NAME=RUN", param_hint="--line")
    named = {name: run for name, _, run in (line.partition("=") for line in lines)}
    comparison = compare(
        _by_filter(baseline),
        *(_by_filter(path) for path in compared),
        acquired=acquired,
        within_K=within_K,
        align=align,
        lines=named,
        extinction=extinction,
    )
    outcome = _printed(comparison)
    if out is not None:
        from cldit.show.report.comparison_page import write_comparison  # needs matplotlib

        print_files(*write_comparison(comparison, out, suffix=suffix or ".png"))
    return outcome


def _by_filter(path: Path) -> Path | dict[str, Path]:
    """A path, or paths by filter if it is FILTER=RESULT,FILTER=RESULT and no file."""
    parts = [part.partition("=") for part in str(path).split(",")]
    if path.exists() or not all(all(part) for part in parts):
        return path
    return {name: Path(result) for name, _, result in parts}


@click.command(deprecated="use `cldit compare`, which always averages onto the same pixels")
@click.argument("baseline", metavar="ONE", type=PATH)
@click.argument("compared", metavar="OTHER", type=PATH)
@click.option("--acquired", is_flag=True, help="Of runs, compare the recordings of their rigs.")
@click.option("--resample", is_flag=True, help="Without effect.")
@within_option
@json_option
@plain_errors
def diff(
    baseline: Path, compared: Path, acquired: bool, resample: bool, within_K: float | None
) -> Outcome:
    """Compare ONE with OTHER, as `cldit compare`; will be removed in the next version."""
    return _printed(compare(baseline, compared, acquired=acquired, within_K=within_K))


def _printed(comparison: Comparison) -> Outcome:
    """Prints a comparison; the outcome is its data and exit status."""
    for difference in comparison.differences:
        print_difference(difference)
    if comparison.verdict:
        OUT.print(escaped(comparison.verdict), style="bold")
    return Outcome(comparison.to_dict(), Exit.DIFFERS if comparison.differs else Exit.DONE)


def print_difference(difference: Difference) -> None:
    """Prints a difference; the last line is its conclusion."""
    OUT.print(escaped(f"{difference.other} minus {difference.one}:"))
    if difference.averaged:
        OUT.print(escaped(f"  {difference.averaged}"), style="dim")
    if difference.view:
        OUT.print(escaped(f"  view by the images: {difference.view}"), style="dim")
    rows = [(words(quantity.name), *_cells(quantity)) for quantity in difference.maps]
    print_table("", "RMS", "mean", "worst", "at x, z / mm", "pixels", rows=rows)
    if any(difference.only):
        OUT.print(
            f"  T_app only in the first: {difference.only[0]} pixels, only in the second: "
            f"{difference.only[1]}"
        )
    stated = ["none" if error_K is None else f"{error_K:.2g} K" for error_K in difference.stated_K]
    OUT.print(f"  stated errors of T_app, RMS: {stated[0]} and {stated[1]}")
    stated = [
        "none" if error is None else f"{error:.2g}" for error in difference.unshared_emissivity
    ]
    OUT.print(f"  errors of emissivity that are not shared, RMS: {stated[0]} and {stated[1]}")
    if difference.shared:
        OUT.print(f"  shared errors, not counted: {', '.join(difference.shared)}")
    if difference.code:
        OUT.print(f"  computed by other code, whose errors count: {', '.join(difference.code)}")
    if difference.tested:
        OUT.print(
            f"  omitted by one alone, not counted as its error: {', '.join(difference.tested)}"
        )
    if difference.p_value is not None:
        regions = [(name, *region.cells) for name, region in difference.regions.items()]
        print_table(difference.observable, "RMS", "mean", "chi-square", "p", "pixels", rows=regions)
    for line in difference.verdict.lines:
        OUT.print(escaped(f"  {line}"), style="bold")


def _cells(difference: MapDifference) -> list[str]:
    if (
        difference.rms is None
        or difference.mean is None
        or difference.worst is None
        or difference.worst_mm is None
    ):
        return ["-", "-", "-", "-", "0"]
    unit = "" if difference.unit == "1" else f" {difference.unit}"
    return [
        f"{difference.rms:.3g}{unit}",
        f"{difference.mean:+.3g}{unit}",
        f"{difference.worst:+.3g}{unit}",
        f"{difference.worst_mm[0]:.2f}, {difference.worst_mm[1]:.2f}" if difference.worst else "",
        str(difference.pixels),
    ]


@click.command("repeat", deprecated="use `cldit compare RUN --repeat`")
@click.argument("folder", metavar="RUN", type=PATH)
@click.option("--out", type=PATH, help="Folder to keep the repetition in.")
@click.option("--changed-inputs", is_flag=True, help="Continue if inputs are missing or changed.")
@within_option
@device_option
@json_option
@plain_errors
def repeat_command(folder: Path, **options: Any) -> Outcome:
    """Compute RUN again from its record, and print the difference in kelvin."""
    return _repeated(folder, **options)


def _repeated(
    folder: Path,
    *,
    out: Path | None,
    changed_inputs: bool,
    within_K: float | None,
    device: str | None,
) -> Outcome:
    """Computes a run again and prints what differs."""
    with ProgressBar() as bar:
        repetition = repeat(
            folder,
            out=out,
            device=open_device(device),
            changed_inputs=changed_inputs,
            within_K=within_K,
            progress=bar.say,
        )
    for line in repetition.inputs:
        OUT.print(escaped(f"  {line}"))
    for name, (recorded, current) in repetition.changed.items():
        OUT.print(
            escaped(f"  {name}: {recorded or 'none'} then, {current or 'none'} now"), style="dim"
        )
    print_difference(repetition.trace)
    if repetition.recorded is not None:
        OUT.print("recording of the rig:")
        print_difference(repetition.recorded)
    return Outcome(repetition.to_dict(), Exit.DONE if repetition.within else Exit.DIFFERS)
