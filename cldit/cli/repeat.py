"""`cldit repeat`: a run computed anew from its record."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, escaped, plain_errors, say
from cldit.cli.diff import print_difference
from cldit.cli.exit_codes import Exit
from cldit.cli.units import KELVIN, device_option
from cldit.gpu.device import open_device
from cldit.show.comparison.repeat import repeat


@click.command("repeat")
@click.argument("folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Keep it in this folder.")
@click.option("--changed-inputs", is_flag=True, help="Go on where inputs are missing or changed.")
@click.option(
    "--within",
    "within_K",
    type=KELVIN,
    help="RMS allowed in T_app, K; what both stated errors explain.",
)
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
    """Compute RUN anew from its record, and say what differs, in kelvin.

    Inputs that are missing or changed are named. The exit status is 3 where the difference is more
    than the stated errors explain.
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
        OUT.print("what the rig recorded:")
        print_difference(found.recorded)
    return Outcome(found.to_dict(), Exit.DONE if found.within else Exit.DIFFERS)
