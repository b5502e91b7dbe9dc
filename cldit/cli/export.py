"""`cldit export`: raw images of an acquisition, or the octree of a run, for other programs."""

from pathlib import Path

import click

from cldit.acquisition.export import FORMATS, ExportError, export
from cldit.acquisition.record import acquisition_in, open_acquisition
from cldit.cli.console import OUT, ProgressBar, plain_errors
from cldit.cli.options import PATH

_OCTREE = "vtu"


@click.command("export")
@click.argument("folder", type=PATH)
@click.option("--to", "form", type=click.Choice([*FORMATS, _OCTREE]), required=True)
@click.option("--out", type=PATH, help="The file; default: in FOLDER.")
@click.option("--node", type=int, help="Octree: number of a wavelength; default: the brightest.")
@click.option("--own-frame", is_flag=True, help="Octree: cldit's coordinates, not the CFD case's.")
@click.option("--device", help="Octree: OpenCL device, as for `cldit run`.")
@plain_errors
def export_command(
    folder: Path, form: str, out: Path | None, node: int | None, own_frame: bool, device: str | None
) -> None:
    """Write an acquisition FOLDER's raw images, or a run's octree, for other programs."""
    if form == _OCTREE:
        # load OpenCL, which is not needed to export images
        from cldit.io.caches import default_cache
        from cldit.run.folder import open_run
        from cldit.run.octree_export import export_octree
        from cldit.run.trusted import open_device

        with ProgressBar() as bar:
            written = export_octree(
                open_run(folder),
                out,
                device=open_device(device),
                cache=default_cache(),
                node=node,
                own_frame=own_frame,
                say=bar.say,
            )
        for path in written:
            OUT.print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
        return
    if node is not None or own_frame or device is not None:
        raise ExportError(f"--node, --own-frame and --device are for {_OCTREE}")
    acquisition = open_acquisition(acquisition_in(folder))
    path = export(acquisition, form, out)
    if acquisition.missing:
        OUT.print(f"[yellow]{len(acquisition.missing)} shots are still missing[/]")
    OUT.print(f"{path}: {len(acquisition.shots)} shots, {path.stat().st_size / 1e6:.1f} MB")
