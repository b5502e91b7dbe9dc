"""`cldit diff` and `cldit repeat`: difference of results, and of a run computed again."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, escaped, folded_table, plain_errors, say
from cldit.cli.options import device_option, within_option
from cldit.cli.program import Exit
from cldit.gpu.device import open_device
from cldit.show.comparison.difference import Difference, MapDifference, compare
from cldit.show.comparison.repeat import repeat


@click.command()
@click.argument("one", type=click.Path(path_type=Path))
@click.argument("other", type=click.Path(path_type=Path))
@click.option("--acquired", is_flag=True, help="Of runs, compare the recordings of their rigs.")
@click.option("--resample", is_flag=True, help="Average a trace onto the other's pixels.")
@within_option
@json_option
@plain_errors
def diff(one: Path, other: Path, acquired: bool, resample: bool, within_K: float | None) -> Outcome:
    """Compare ONE and OTHER, in kelvin: runs, acquisitions, or measured data.

    The exit status is 3 if the difference exceeds what the stated errors explain.
    """
    found = compare(one, other, acquired=acquired, resample=resample, within_K=within_K)
    print_difference(found)
    return Outcome(found.to_dict(), Exit.DONE if found.within else Exit.DIFFERS)


def print_difference(found: Difference) -> None:
    """Prints a difference; the last line is its conclusion."""
    OUT.print(escaped(f"{found.other} minus {found.one}:"))
    if found.averaged:
        OUT.print(escaped(f"  {found.averaged}"), style="dim")
    table = folded_table("", "RMS", "mean", "worst", "at x, z / mm", "pixels")
    for one in found.maps:
        table.add_row(one.name.removesuffix("_K").replace("_", " "), *_cells(one))
    OUT.print(table)
    if any(found.only):
        OUT.print(
            f"  T_app only in the first: {found.only[0]} pixels, only in the second: "
            f"{found.only[1]}"
        )
    stated = ["none" if each is None else f"{each:.2g} K" for each in found.stated_K]
    OUT.print(f"  stated errors of T_app, RMS: {stated[0]} and {stated[1]}")
    if found.shared:
        OUT.print(f"  shared errors, not counted: {', '.join(found.shared)}")
    if found.tested:
        OUT.print(f"  omitted by one alone, not counted as its error: {', '.join(found.tested)}")
    if found.beyond is not None:
        OUT.print(
            f"  {100 * found.beyond:.3g} % of the pixels differ by more than twice the errors "
            f"stated there; reduced chi-square {found.chi2:.2g}"
        )
    for key in found.keys:
        OUT.print(escaped(f"  {key.text}"), style="dim")
    OUT.print(f"  {found.verdict}", style="bold")


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
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder to keep the repetition in.")
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
    found = repeat(
        folder,
        out=out,
        device=open_device(device),
        changed_inputs=changed_inputs,
        within_K=within_K,
        progress=say,
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
