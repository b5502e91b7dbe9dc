"""`cldit evaluate`: recorded and measured pictures to maps."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from cldit.acquisition.progress import Progress
from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors
from cldit.dit.recorded import CurveSource
from cldit.dit.witness.finding import ACCEPTABLE
from cldit.experiment import acquisition_in, evaluate_folder, evaluate_scattering
from cldit.run import open_run


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--calibration",
    type=click.Choice(["planck", "fitted"]),
    default="planck",
    show_default=True,
    help="Curve from Planck, filter and detector, or fitted to the references.",
)
@click.option("--robust", is_flag=True, help="Weigh shots that are far off the others less.")
@click.option("--frame", type=click.IntRange(0), default=0, help="Which picture of each shot.")
@click.option(
    "--accept",
    type=click.Choice(ACCEPTABLE),
    multiple=True,
    help="Evaluate whatever this witness finds; may be given several times.",
)
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    help="Folder of a run that models the spray: also the temperature of what emits.",
)
@plain_errors
def evaluate(
    folder: Path,
    calibration: CurveSource,
    robust: bool,
    frame: int,
    accept: tuple[str, ...],
    model: Path | None,
) -> None:
    """Evaluate an acquisition, a run, or measured data (a FOLDER with measured.yaml).

    The maps go into `maps` beside the pictures.
    """
    target = acquisition_in(folder)
    with ProgressBar() as bar:
        found = evaluate_folder(
            target,
            curve=calibration,
            robust=robust,
            frame=frame,
            accept=accept,
            say=lambda line: OUT.print(escaped(line)),
            progress=lambda done, total: bar.watch(Progress("shots", done, total, None)),
        )
    for reason, count in found.maps.count().items():
        OUT.print(f"{count:9d} pixels: {reason.text}")
    for line in found.lines:
        OUT.print(escaped(line))
    if model is not None:
        medium = evaluate_scattering(target, open_run(model), found)
        told = np.isfinite(medium.temperature_K)
        changed = medium.temperature_K - found.maps.apparent_temperature_K
        OUT.print(
            f"{int(told.sum()):9d} pixels: temperature of what emits, without scattered walls; "
            f"{float(np.mean(changed[told])) if told.any() else 0.0:+.2g} K against T_app"
        )
    OUT.print(f"{(target.parent if target.is_file() else target) / 'maps'}")
