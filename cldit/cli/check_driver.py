"""`cldit check-driver`: the contract that every driver must fulfil."""

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from cldit.cli.console import OUT, escaped, plain_errors, print_table
from cldit.cli.options import PATH
from cldit.errors import SceneError
from cldit.rig.drivers import describe_drivers, load_driver
from cldit.rig.link import Linked
from cldit.rig.load import open_instrument, read_instruments
from cldit.rig.protocols import KINDS
from cldit.rig.safety import make_safe
from cldit.testing.expect import Allowed
from cldit.testing.run import OF_KIND, Result, Verdict, on_emulators, on_instrument

_STYLE = {Verdict.PASSED: "green", Verdict.FAILED: "bold red", Verdict.SKIPPED: "yellow"}


@click.command("check-driver")
@click.argument("name")
@click.argument("rig", type=PATH, required=False)
@click.option(
    "--instrument", is_flag=True, help="Check the instrument in RIG, slowly and safely; asks first."
)
@click.option(
    "--ambient",
    "ambient_K",
    default=295.0,
    help="Kelvin; no set point above it is written to an instrument.",
)
@click.option("--heat-to", "heat_to_K", type=float, help="Kelvin; allows set points up to this.")
@click.option("--yes", is_flag=True, help="Do not ask before an instrument is used.")
@plain_errors
def check_driver(
    name: str,
    rig: Path | None,
    instrument: bool,
    ambient_K: float,
    heat_to_K: float | None,
    yes: bool,
) -> None:
    """Check the driver NAME with its emulators, or with the instrument in RIG.

    Its settings are those in RIG, a rig file or one with this instrument alone. The exit status is
    1 if a check fails.
    """
    load_driver(name)
    kind = describe_drivers()[name].kind
    if kind not in OF_KIND:
        raise SceneError(f"{name} is a {kind}; allowed: drivers of a {', '.join(OF_KIND)}")
    part, settings = _of_rig(name, rig)
    if not instrument:
        with_rig = f" with the settings of {rig}" if part else ""
        OUT.print(f"{name}, with its emulators{with_rig}:")
        _end(_show(on_emulators(name, kind, settings)))
    if part is None:
        raise SceneError("--instrument: requires a RIG file with the driver and its address")
    warmest_K = ambient_K if heat_to_K is None else heat_to_K
    _state(name, kind, str(rig), warmest_K)
    if not yes and not click.confirm("Continue?"):
        sys.exit(1)
    assert rig is not None
    device, keeper = open_instrument(rig, part), open_instrument(rig, part)
    if isinstance(keeper, Linked):
        keeper.reserve()  # also while a check has closed the device
    try:
        good = _show(on_instrument(device, kind, Allowed(warmest_K, inject=False)))
    finally:
        safety = make_safe({part: device}, ())
        for did in safety.did.values():
            OUT.print(f"made safe: {escaped(did)}")
        for problem in safety.unsafe:
            OUT.print(f"[bold red]NOT SAFE:[/] {escaped(problem)}")
        device.close()
        keeper.close()
    _end(good and not safety.unsafe)


def _of_rig(name: str, rig: Path | None) -> tuple[str | None, dict[str, Any]]:
    """Device of the rig that has this driver, and its settings. Raises SceneError."""
    if rig is None:
        return None, {}
    file = read_instruments(rig)
    drivers = {part: choice for part in KINDS if (choice := getattr(file, part)) is not None}
    for part, choice in drivers.items():
        if choice.driver == name:
            return part, choice.settings
    raise SceneError(
        f"{rig}: no device has the driver {name}; it has "
        + (", ".join(f"{part}: {choice.driver}" for part, choice in drivers.items()) or "none")
    )


def _state(name: str, kind: str, rig: str, warmest_K: float) -> None:
    """Prints the actions of the check on the instrument."""
    OUT.print(f"{name}, with the instrument in {escaped(rig)}. This check")
    for check in OF_KIND[kind]:
        OUT.print(f"  - {check.does};")
    OUT.print("  - makes the instrument safe at the end, however it ends.")
    if kind == "background":
        OUT.print(f"It writes no set point above {warmest_K:.1f} K (--ambient, --heat-to).")
    if kind == "trigger":
        OUT.print("It never requests an injection. Shut off the fuel all the same.")


def _show(results: Iterable[Result]) -> bool:
    """Prints a table of the results; True if no check failed."""
    tally = dict.fromkeys(Verdict, 0)
    rows, failed = [], []
    with OUT.status("checking") as status:
        for result in results:
            tally[result.verdict] += 1
            message = escaped(result.text)
            if result.verdict is Verdict.FAILED:
                failed.append(f"[bold red]{result.where}, {result.name}:[/] {message}")
                message = ""
            verdict = f"[{_STYLE[result.verdict]}]{result.verdict}[/]"
            rows.append((result.where, result.name, verdict, f"{result.seconds:.1f}", message))
            status.update(f"{result.where}: {result.name} {result.verdict}")
    print_table("where", "check", "result", "seconds", "", rows=rows)
    for line in failed:
        OUT.print(line)
    OUT.print(", ".join(f"{number} {verdict}" for verdict, number in tally.items()))
    return tally[Verdict.FAILED] == 0 and tally[Verdict.PASSED] > 0


def _end(good: bool) -> None:
    sys.exit(0 if good else 1)
