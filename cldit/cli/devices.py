"""`cldit devices`: OpenCL devices and drivers of instruments."""

from collections.abc import Iterable
from dataclasses import asdict

import click
from rich.text import Text

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, plain_errors, print_table
from cldit.gpu.device import choose, list_devices
from cldit.rig.drivers import DriverAbout, describe_drivers


@click.command()
@click.option("--device", help="Show the device of this choice.")
@json_option
@plain_errors
def devices(device: str | None) -> Outcome:
    """List OpenCL devices, which one is used and why, and the drivers of instruments."""
    found = list_devices()
    used, reason = choose(found, device)
    rows = [
        (
            "*" if number == used else "",
            info.index,
            info.kind,
            info.name,
            f"{info.memory_bytes / 1e9:.1f} GB",
            "yes" if info.float64 else "no",
            info.platform,
        )
        for number, info in enumerate(found)
    ]
    print_table("", "device", "kind", "name", "memory", "float64", "platform", rows=rows)
    OUT.print(f"* is used: {reason}\n")
    described = {name: (about, about.missing()) for name, about in describe_drivers().items()}
    drivers = [
        (name, about.kind, about.instrument, _tested(about, missing))
        for name, (about, missing) in described.items()
    ]
    print_table("driver", "kind", "instrument", "tested", rows=drivers)
    return Outcome(
        {
            "devices": [{**asdict(info), "used": at == used} for at, info in enumerate(found)],
            "reason": reason,
            "drivers": {
                name: {**asdict(about), "missing": missing}
                for name, (about, missing) in described.items()
            },
        }
    )


def _tested(about: DriverAbout, missing: Iterable[str]) -> Text:
    lacks = f"needs {', '.join(missing)} ({about.install}); " if missing else ""
    return Text.assemble((lacks, "yellow"), about.tested)
