"""`cldit export`: raw images of an acquisition, or the octree of a run, for other programs."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cldit.acquisition.export import FORMATS
from cldit.api.exporting import OCTREE, export
from cldit.cli.console import OUT, ProgressBar, plain_errors
from cldit.cli.options import PATH, replaced_by

if TYPE_CHECKING:
    from cldit.gpu.device import Device


@click.command("export")
@click.argument("folder", type=PATH)
@click.option("--to", "form", type=click.Choice([*FORMATS, OCTREE]), required=True)
@click.option("--out", type=PATH, help="The file; default: in FOLDER.")
@click.option("--node", type=int, help="Octree: number of a wavelength; default: the brightest.")
@click.option("--own-frame", is_flag=True, help="Octree: cldit's coordinates, not the CFD case's.")
@click.option("--device", hidden=True, callback=replaced_by("device= of cldit.export"))
@plain_errors
def export_command(
    folder: Path, form: str, out: Path | None, node: int | None, own_frame: bool, device: str | None
) -> None:
    """Write an acquisition FOLDER's raw images, or a run's octree, for other programs."""
    with ProgressBar() as bar:
        written = export(
            folder,
            form,
            out,
            node=node,
            own_frame=own_frame,
            device=None if device is None else _device(device),
            progress=bar.say,
        )
    for path in written:
        OUT.print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


def _device(name: str) -> "Device":
    from cldit.run.trusted import open_device  # loads OpenCL, which images do not need

    return open_device(name)
