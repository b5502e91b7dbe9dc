"""`cldit diff`: what differs between two runs, or a run and a measurement."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, escaped, folded_table, plain_errors
from cldit.cli.exit_codes import Exit
from cldit.cli.units import KELVIN
from cldit.show.comparison.difference import Difference, compare


@click.command()
@click.argument("one", type=click.Path(path_type=Path))
@click.argument("other", type=click.Path(path_type=Path))
@click.option("--acquired", is_flag=True, help="Of runs, what their rig recorded.")
@click.option("--resample", is_flag=True, help="Average a trace onto the other's pixels.")
@click.option(
    "--within",
    "within_K",
    type=KELVIN,
    help="RMS allowed in T_app, K; what both stated errors explain.",
)
@json_option
@plain_errors
def diff(one: Path, other: Path, acquired: bool, resample: bool, within_K: float | None) -> Outcome:
    """What differs from ONE to OTHER, in kelvin: runs, acquisitions, or measured data.

    The exit status is 3 where the difference is more than the stated errors explain.
    """
    found = compare(one, other, acquired=acquired, resample=resample, within_K=within_K)
    print_difference(found)
    return Outcome(found.to_dict(), Exit.DONE if found.within else Exit.DIFFERS)


def print_difference(found: Difference) -> None:
    """Prints a difference for people."""
    OUT.print(escaped(f"{found.other} less {found.one}:"))
    if found.averaged:
        OUT.print(escaped(f"  {found.averaged}"), style="dim")
    table = folded_table("", "RMS", "mean", "worst", "at x, z / mm", "pixels")
    for one in found.maps:
        unit = "" if one.unit == "1" else f" {one.unit}"
        name = one.name.removesuffix("_K").replace("_", " ")
        if one.rms is None or one.mean is None or one.worst is None or one.worst_mm is None:
            table.add_row(name, "-", "-", "-", "-", "0")
            continue
        table.add_row(
            name,
            f"{one.rms:.3g}{unit}",
            f"{one.mean:+.3g}{unit}",
            f"{one.worst:+.3g}{unit}",
            f"{one.worst_mm[0]:.2f}, {one.worst_mm[1]:.2f}" if one.worst else "",
            str(one.pixels),
        )
    OUT.print(table)
    if any(found.only):
        OUT.print(f"  T_app in the first alone: {found.only[0]} pixels, in the second alone: "
                  f"{found.only[1]}")  # fmt: skip
    stated = ["none" if each is None else f"{each:.2g} K" for each in found.stated_K]
    OUT.print(f"  stated errors of T_app, RMS: {stated[0]} and {stated[1]}")
    if found.beyond is not None:
        OUT.print(
            f"  {100 * found.beyond:.3g} % of the pixels differ by more than twice the errors "
            "stated there"
        )
    for key in found.keys:
        OUT.print(escaped(f"  {key.text}"), style="dim")
    OUT.print(f"  {found.verdict}", style="bold")
