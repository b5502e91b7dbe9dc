"""`cldit evaluate`: recorded and measured pictures to maps."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.acquisition.progress import Progress
from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors
from cldit.dit.recorded import CurveSource
from cldit.experiment import evaluate_folder


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
@plain_errors
def evaluate(folder: Path, calibration: CurveSource, robust: bool, frame: int) -> None:
    """Evaluate an acquisition, a run, or measured data (a FOLDER with measured.yaml).

    The maps go into `maps` beside the pictures.
    """
    target = folder / "acquisition" if (folder / "acquisition").is_dir() else folder
    with ProgressBar() as bar:
        found = evaluate_folder(
            target,
            curve=calibration,
            robust=robust,
            frame=frame,
            progress=lambda done, total: bar.watch(Progress("shots", done, total, None)),
        )
    for reason, count in found.maps.count().items():
        OUT.print(f"{count:9d} pixels: {reason.text}")
    for line in found.remarks:
        OUT.print(escaped(line))
    OUT.print(f"{(target.parent if target.is_file() else target) / 'maps'}")
