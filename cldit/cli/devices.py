"""`cldit devices`: OpenCL devices and drivers of instruments."""

from __future__ import annotations

from dataclasses import asdict

import click
from rich.text import Text

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, folded_table, plain_errors
from cldit.gpu.device import choose, list_devices
from cldit.rig.drivers import describe_drivers


@click.command()
@click.option("--device", help="Show the device of this choice.")
@json_option
@plain_errors
def devices(device: str | None) -> Outcome:
    """List OpenCL devices, which one is used and why, and the drivers of instruments."""
    found = list_devices()
    used, reason = choose(found, device)
    table = folded_table("", "device", "kind", "name", "memory", "float64", "platform")
    for number, info in enumerate(found):
        table.add_row(
            "*" if number == used else "",
            info.index,
            info.kind,
            info.name,
            f"{info.memory_bytes / 1e9:.1f} GB",
            "yes" if info.float64 else "no",
            info.platform,
        )
    OUT.print(table)
    OUT.print(f"* is used: {reason}")
    drivers = folded_table("driver", "kind", "instrument", "tested")
    described = describe_drivers()
    for name, about in described.items():
        missing = about.missing()
        lacks = f"needs {', '.join(missing)} ({about.install}); " if missing else ""
        tested = Text.assemble((lacks, "yellow"), about.tested)
        drivers.add_row(name, about.kind, about.instrument, tested)
    OUT.print()
    OUT.print(drivers)
    return Outcome(
        {
            "devices": [
                {**asdict(info), "used": number == used} for number, info in enumerate(found)
            ],
            "reason": reason,
            "drivers": {
                name: {**asdict(about), "missing": about.missing()}
                for name, about in described.items()
            },
        }
    )
