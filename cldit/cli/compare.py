"""`cldit compare` and `cldit repeat`: differences of results, in kelvin."""

from pathlib import Path

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
@click.argument("one", type=PATH)
@click.argument("others", nargs=-1, required=True, type=PATH)
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
@click.option("--out", type=PATH, help="Folder of a page, its figures and tables.")
@figures_option
@within_option
@json_option
@plain_errors
def compare_command(
    one: Path,
    others: tuple[Path, ...],
    acquired: bool,
    align: Align,
    lines: tuple[str, ...],
    out: Path | None,
    suffix: str | None,
    within_K: float | None,
) -> Outcome:
    """Compare ONE with OTHERS, with the errors of both: measured data, evaluations, runs.

    The exit status is 3 if the errors do not explain the difference.
    """
    if suffix is not None and out is None:
        raise click.UsageError("--format: of the figures in --out; give --out too")
    if wrong := [text for text in lines if not all(text.partition("="))]:
        raise click.BadParameter(f"{wrong[0]!r}; allowed: NAME=RUN", param_hint="--line")
    named = {name: run for name, _, run in (text.partition("=") for text in lines)}
    found = compare(one, *others, acquired=acquired, within_K=within_K, align=align, lines=named)
    outcome = _printed(found)
    if out is not None:
        from cldit.show.report.comparison_page import write_comparison  # needs matplotlib

        print_files(*write_comparison(found, out, suffix=suffix or ".png"))
    return outcome


@click.command(deprecated="use `cldit compare`, which always averages onto the same pixels")
@click.argument("one", type=PATH)
@click.argument("other", type=PATH)
@click.option("--acquired", is_flag=True, help="Of runs, compare the recordings of their rigs.")
@click.option("--resample", is_flag=True, help="Without effect.")
@within_option
@json_option
@plain_errors
def diff(one: Path, other: Path, acquired: bool, resample: bool, within_K: float | None) -> Outcome:
    """Compare ONE with OTHER, as `cldit compare`; will be removed in the next version."""
    return _printed(compare(one, other, acquired=acquired, within_K=within_K))


def _printed(found: Comparison) -> Outcome:
    """Prints a comparison; the outcome is its data and exit status."""
    for each in found.differences:
        print_difference(each)
    if found.verdict:
        OUT.print(escaped(found.verdict), style="bold")
    return Outcome(found.to_dict(), Exit.DIFFERS if found.differs else Exit.DONE)


def print_difference(found: Difference) -> None:
    """Prints a difference; the last line is its conclusion."""
    OUT.print(escaped(f"{found.other} minus {found.one}:"))
    if found.averaged:
        OUT.print(escaped(f"  {found.averaged}"), style="dim")
    if found.view:
        OUT.print(escaped(f"  view by the images: {found.view}"), style="dim")
    rows = [(words(one.name), *_cells(one)) for one in found.maps]
    print_table("", "RMS", "mean", "worst", "at x, z / mm", "pixels", rows=rows)
    if any(found.only):
        OUT.print(
            f"  T_app only in the first: {found.only[0]} pixels, only in the second: "
            f"{found.only[1]}"
        )
    stated = ["none" if each is None else f"{each:.2g} K" for each in found.stated_K]
    OUT.print(f"  stated errors of T_app, RMS: {stated[0]} and {stated[1]}")
    stated = ["none" if each is None else f"{each:.2g}" for each in found.unshared_emissivity]
    OUT.print(f"  errors of emissivity that are not shared, RMS: {stated[0]} and {stated[1]}")
    if found.shared:
        OUT.print(f"  shared errors, not counted: {', '.join(found.shared)}")
    if found.code:
        OUT.print(f"  computed by other code, whose errors count: {', '.join(found.code)}")
    if found.tested:
        OUT.print(f"  omitted by one alone, not counted as its error: {', '.join(found.tested)}")
    if found.p_value is not None:
        regions = [(name, *region.cells) for name, region in found.regions.items()]
        print_table("T_app", "RMS", "mean", "chi-square", "p", "pixels", rows=regions)
    for line in found.verdict.lines:
        OUT.print(escaped(f"  {line}"), style="bold")


def _cells(one: MapDifference) -> list[str]:
    if one.rms is None or one.mean is None or one.worst is None or one.worst_mm is None:
        return ["-", "-", "-", "-", "0"]
    unit = "" if one.unit == "1" else f" {one.unit}"
    return [
        f"{one.rms:.3g}{unit}",
        f"{one.mean:+.3g}{unit}",
        f"{one.worst:+.3g}{unit}",
        f"{one.worst_mm[0]:.2f}, {one.worst_mm[1]:.2f}" if one.worst else "",
        str(one.pixels),
    ]


@click.command("repeat")
@click.argument("folder", metavar="RUN", type=PATH)
@click.option("--out", type=PATH, help="Folder to keep the repetition in.")
@click.option("--changed-inputs", is_flag=True, help="Continue if inputs are missing or changed.")
@within_option
@device_option
@json_option
@plain_errors
def repeat_command(
    folder: Path,
    out: Path | None,
    changed_inputs: bool,
    within_K: float | None,
    device: str | None,
) -> Outcome:
    """Compute RUN again from its record, and print the difference in kelvin.

    Inputs that are missing or changed are named. The exit status is 3 if the difference exceeds
    what the stated errors explain.
    """
    with ProgressBar() as bar:
        found = repeat(
            folder,
            out=out,
            device=open_device(device),
            changed_inputs=changed_inputs,
            within_K=within_K,
            progress=bar.say,
        )
    for line in found.inputs:
        OUT.print(escaped(f"  {line}"))
    for name, (then, now) in found.changed.items():
        OUT.print(escaped(f"  {name}: {then or 'none'} then, {now or 'none'} now"), style="dim")
    print_difference(found.trace)
    if found.recorded is not None:
        OUT.print("recording of the rig:")
        print_difference(found.recorded)
    return Outcome(found.to_dict(), Exit.DONE if found.within else Exit.DIFFERS)
