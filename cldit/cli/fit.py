"""`cldit fit`: values of a scene that a measurement determines."""

from pathlib import Path

import click

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, escaped, plain_errors, print_table, say
from cldit.cli.options import PATH, SCENE, device_option
from cldit.cli.results import print_files, print_next
from cldit.run.trusted import open_device
from cldit.study.fit import Fit, fit


@click.command("fit")
@click.argument("measured", type=PATH)
@click.argument("scene", type=SCENE)
@click.option(
    "--vary",
    "vary",
    multiple=True,
    required=True,
    metavar="KEY=LOW:HIGH[:MEAN:DEVIATION]",
    help="Key with its bounds, and a prior if there is one; up to six.",
)
@click.option("--acquired", is_flag=True, help="MEASURED is a run: fit the recording of its rig.")
@click.option("--out", type=PATH, help="Folder; default: runs/SCENE-fit.")
@device_option
@json_option
@plain_errors
def fit_command(
    measured: Path,
    scene: str,
    vary: tuple[str, ...],
    acquired: bool,
    out: Path | None,
    device: str | None,
) -> Outcome:
    """Fit values of SCENE to the evaluated images of MEASURED, by least squares on radiance.

    Every evaluation is a run that is stored, so the same command continues after an interruption.
    """
    result = fit(
        measured, scene, vary, out, acquired=acquired, device=open_device(device), progress=say
    )
    _print(result)
    print_files(result.folder / "best.yaml", result.folder / "fit.json")
    print_next("cldit", "compare", measured, result.run.folder or result.folder)
    return Outcome(result.to_dict())


def _print(result: Fit) -> None:
    rows = []
    for fitted in result.parameters:
        ends = [
            f"{'beyond ' if beyond else ''}{end:.4g}"
            for end, beyond in zip(fitted.interval, fitted.open, strict=True)
        ]
        prior = fitted.parameter.prior
        values = (
            fitted.parameter.key,
            f"{fitted.value:.5g}",
            f"{fitted.error:.2g}",
            " .. ".join(ends),
            "" if prior is None else f"{prior[0]:g} ± {prior[1]:g}",
            "" if fitted.determined else "not determined by the data",
        )
        rows.append(values)
    print_table("", "value", "±", "68 %", "prior", "", rows=rows)
    names = [fitted.parameter.key for fitted in result.parameters]
    for row, name in enumerate(names):
        for column in range(row):
            share = result.correlation[row, column]
            OUT.print(escaped(f"  correlation of {name} and {names[column]}: {share:+.2f}"))
    if result.weak:
        OUT.print(escaped(f"  hardly determined, in units of the ranges: {result.weak}"))
    OUT.print(
        f"reduced chi-square {result.chi2_reduced:.2f} in {result.pixels} pixels, p = "
        f"{result.p_value:.2g}; {result.evaluations} evaluations",
        style="bold",
    )
    if not result.explained:
        OUT.print(
            "No values in these ranges explain the measurement: the errors above are too small.",
            style="yellow",
        )
