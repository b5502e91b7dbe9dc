"""`cldit show` and `cldit view`: figures of folders and of parts of scenes, and pages."""

import webbrowser
from pathlib import Path

import click

from cldit.api.viewing import view
from cldit.cli.console import OUT, escaped, plain_errors
from cldit.cli.options import PATH, SCENE, device_option, figures_option, replaced_by
from cldit.show.report.folders import show_folder
from cldit.show.view.folders import unfinished


@click.command()
@click.argument("folder", metavar="FOLDER|SCENE", type=SCENE)
@click.option("--part", type=click.Choice(["spray", "optics"]), help="Of a SCENE, this alone.")
@click.option("--out", type=PATH, help="With --part: folder of the spray, or figure of the optics.")
@figures_option
@device_option
@click.option("--open", "opened", is_flag=True, hidden=True, callback=replaced_by("cldit view"))
@plain_errors
def show(
    folder: str,
    part: str | None,
    out: Path | None,
    suffix: str | None,
    device: str | None,
    opened: bool,
) -> None:
    """Draw the figures of a run or acquisition FOLDER; of a series, its film.

    With --part, compute and draw the spray or the optics of a SCENE without tracing it.
    """
    if part is not None:
        _show_part(part, folder, out, suffix, device)
        return
    if out is not None or device is not None:
        raise click.UsageError("--out, --device: allowed with --part spray or --part optics")
    figure = show_folder(Path(folder), suffix=suffix or ".png")
    OUT.print(escaped(str(figure)))
    if opened:
        click.launch(str(figure))


def _show_part(
    part: str, scene: str, out: Path | None, suffix: str | None, device: str | None
) -> None:
    if part == "spray":
        from cldit.cli.sprays import show_spray  # loads the computed spray

        show_spray(scene, out, suffix, device)
    else:
        from cldit.cli.optics import show_optics

        show_optics(scene, out, suffix)


def _old_name(part: str) -> click.Command:
    """Command of earlier versions, `cldit spray` or `cldit optics`."""

    @click.command(part, deprecated=f"use `cldit show SCENE --part {part}`")
    @click.argument("scene", type=SCENE)
    @click.option("--out", type=PATH)
    @figures_option
    @device_option
    @plain_errors
    def command(scene: str, out: Path | None, suffix: str | None, device: str | None) -> None:
        _show_part(part, scene, out, suffix, device)

    return command


spray_command, optics_command = _old_name("spray"), _old_name("optics")


@click.command("view")
@click.argument("folders", nargs=-1, required=True, type=PATH)
@click.option(
    "--save",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the page to this file, and do not open it.",
)
@click.option("--no-open", is_flag=True, help="Write the page and print its path only.")
@plain_errors
def view_command(folders: tuple[Path, ...], save: Path | None, no_open: bool) -> None:
    """Show runs, series and recordings in FOLDERS on one page: sliders, profiles, differences.

    The page needs no server and no network. It is written into the first folder, or into cldit's
    cache if that is not possible.
    """
    path = view(*folders, save=save)
    for folder in folders:
        for incomplete in unfinished(folder):
            OUT.print(escaped(f"{incomplete}: is not finished; omitted"))
    size = "" if save is None else f" ({save.stat().st_size / 1e6:.1f} MB)"
    OUT.print(escaped(f"{path}{size}"))
    if save is None and not no_open and not webbrowser.open(path.resolve().as_uri()):
        OUT.print("no browser was found; open the file in one")
