"""`cldit devices`: OpenCL devices and drivers of instruments."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import click
from rich.text import Text

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, ProgressBar, plain_errors, print_table
from cldit.errors import DeviceError
from cldit.gpu.checks import Check, failed_devices, store_check, stored_check, tested
from cldit.gpu.device import DeviceInfo, choose, list_devices, open_device
from cldit.rig.drivers import DriverAbout, describe_drivers


@click.command()
@click.option("--device", help="Show the device of this choice; check it alone.")
@click.option("--check", is_flag=True, help="Check the results of every kernel; exit 1 if wrong.")
@json_option
@plain_errors
def devices(device: str | None, check: bool) -> Outcome:
    """List OpenCL devices, which one is used and why, and the drivers of instruments."""
    infos = list_devices()
    if check:
        _check([infos[choose(infos, device)[0]]] if device else infos)
    failed = failed_devices()
    used, reason = choose(infos, device, failed)
    checks = {info.index: stored_check(info) for info in infos}
    rows = [
        (
            "*" if number == used else "",
            info.index,
            info.kind,
            info.name,
            f"{info.memory_bytes / 1e9:.1f} GB",
            "yes" if info.float64 else "no",
            _checked(info, checks[info.index]),
            info.platform,
        )
        for number, info in enumerate(infos)
    ]
    print_table("", "device", "kind", "name", "memory", "float64", "check", "platform", rows=rows)
    OUT.print(f"* is used: {reason}\n")
    described = {name: (about, about.missing()) for name, about in describe_drivers().items()}
    drivers = [
        (name, about.kind, about.instrument, _tested(about, missing))
        for name, (about, missing) in described.items()
    ]
    print_table("driver", "kind", "instrument", "tested", rows=drivers)
    return Outcome(
        {
            "devices": [
                {**asdict(info), "used": at == used, "check": _plain(checks[info.index])}
                for at, info in enumerate(infos)
            ],
            "reason": reason,
            "drivers": {
                name: {**asdict(about), "missing": missing}
                for name, (about, missing) in described.items()
            },
        }
    )


def _check(infos: Sequence[DeviceInfo]) -> None:
    """Checks devices; raises DeviceError with all faults of those that fail."""
    from cldit.prepare.stages import StageLine
    from cldit.run.device_check import check_device

    faults = []
    for info in infos:
        with open_device(info.index) as opened, ProgressBar() as bar:
            check = check_device(opened, report=lambda name: bar.say(StageLine(name)))
        store_check(info, check)
        bar.say(f"{info.index} {info.name}: {check.text} in {check.seconds:.0f} s")
        faults += [f"{info.index} {info.name}: {fault}" for fault in check.faults]
    if faults:
        raise DeviceError("\n".join(faults))


def _plain(check: Check | None) -> dict[str, Any] | None:
    return None if check is None else asdict(check)


def _checked(info: DeviceInfo, check: Check | None) -> Text:
    if check is None:
        return Text("not needed (PoCL)" if tested(info) else "before its first use")
    return Text("failed", "red") if check.faults else Text("passed")


def _tested(about: DriverAbout, missing: Iterable[str]) -> Text:
    requirement = f"needs {', '.join(missing)} ({about.install}); " if missing else ""
    return Text.assemble((requirement, "yellow"), about.tested)
