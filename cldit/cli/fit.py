"""`cldit fit`: values of a scene that a measurement determines."""

from pathlib import Path

import click

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, escaped, plain_errors, print_table, say
from cldit.cli.options import PATH, SCENE, device_option
from cldit.cli.results import print_files, print_next
from cldit.run.trusted import open_device
from cldit.scene import load_scene
from cldit.study.fit import Fit, Parameter, fit


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
    loaded = load_scene(scene)
    folder = out or Path("runs") / f"{loaded.name}-fit"
    found = fit(
        measured,
        loaded,
        [Parameter.parse(text, loaded) for text in vary],
        folder,
        acquired=acquired,
        device=open_device(device),
        progress=say,
    )
    _print(found)
    print_files(folder / "best.yaml", folder / "fit.json")
    print_next("cldit", "compare", measured, found.run.folder or folder)
    return Outcome(found.to_dict())


def _print(found: Fit) -> None:
    rows = []
    for one in found.parameters:
        ends = [
            f"{'beyond ' if beyond else ''}{end:.4g}"
            for end, beyond in zip(one.interval, one.open, strict=True)
        ]
        prior = one.parameter.prior
        values = (
            one.parameter.key,
            f"{one.value:.5g}",
            f"{one.error:.2g}",
            " .. ".join(ends),
            "" if prior is None else f"{prior[0]:g} ± {prior[1]:g}",
            "" if one.determined else "not determined by the data",
        )
        rows.append(values)
    print_table("", "value", "±", "68 %", "prior", "", rows=rows)
    names = [one.parameter.key for one in found.parameters]
    for row, name in enumerate(names):
        for column in range(row):
            share = found.correlation[row, column]
            OUT.print(escaped(f"  correlation of {name} and {names[column]}: {share:+.2f}"))
    if found.weak:
        OUT.print(escaped(f"  hardly determined, in units of the ranges: {found.weak}"))
    OUT.print(
        f"reduced chi-square {found.chi2_reduced:.2f} in {found.pixels} pixels, p = "
        f"{found.p_value:.2g}; {found.evaluations} evaluations",
        style="bold",
    )
