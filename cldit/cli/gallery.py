"""`cldit gallery`: scenes as a page of pictures."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors
from cldit.cli.run import picture_changes
from cldit.gpu.device import open_device
from cldit.scene import shipped_scenes
from cldit.show.report.gallery import write_gallery


@click.command("gallery")
@click.argument("scenes", nargs=-1)
@click.option(
    "--out",
    default="gallery",
    show_default=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the page.",
)
@click.option("--pixels", metavar="N|NxM", help="Columns and rows of the pictures; 128.")
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@plain_errors
def gallery_command(
    scenes: tuple[str, ...], out: Path, pixels: str | None, device: str | None
) -> None:
    """SCENES, or all that are shipped, as a page: picture, command, seconds, error.

    Each is simulated as `cldit run --quick --trace-only` does it.
    """
    more = "" if pixels is None else f" --pixels {pixels}"
    with ProgressBar() as bar:
        page = write_gallery(
            scenes or tuple(shipped_scenes()),
            out,
            options=f"--quick{more} --trace-only",
            changes=picture_changes(pixels, None, quick=True, accuracy_K=None),
            device=open_device(device),
            progress=bar.say,
        )
    OUT.print(escaped(str(page)))
