"""`cldit acquire` and `show`: the rig and its pictures."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.acquisition.dry_run import SECONDS_PER_KELVIN, DryRun, dry_run
from cldit.acquisition.export import FORMATS, export
from cldit.acquisition.plan import load_plan
from cldit.acquisition.record import open_acquisition
from cldit.acquisition.runner import acquire
from cldit.cli.console import OUT, ProgressBar, plain_errors
from cldit.cli.live import LiveView
from cldit.errors import RunFolderError
from cldit.report.run_report import show_folder
from cldit.rig.errors import RigError
from cldit.rig.load import open_rig


@click.command("acquire")
@click.argument("rig", type=click.Path(path_type=Path))
@click.argument("plan", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the shots.")
@click.option("--dry-run", "dry", is_flag=True, help="Check and estimate; nothing moves or fires.")
@click.option("--live", is_flag=True, help="Show the last picture, here and in a window.")
@plain_errors
def acquire_command(rig: Path, plan: Path, out: Path, dry: bool, live: bool) -> None:
    """Record the sequence in PLAN with the instruments in RIG; resumes where it stopped."""
    sequence = load_plan(plan)
    if dry:
        asked = open_rig(rig)
        try:
            _estimate(dry_run(asked, sequence, out))
        finally:
            asked.close()  # not made safe: that would move the black body
        return
    with open_rig(rig) as opened:
        if live:
            with LiveView() as view:
                record = acquire(opened, sequence, out, progress=view.watch, preview=view.show)
        else:
            with ProgressBar() as bar:
                record = acquire(opened, sequence, out, progress=bar.watch)
    OUT.print(
        f"{record.saved} of {record.total} shots in {out}; {record.rejected} rejected, "
        f"{record.lost_injections} injections without a kept picture"
    )
    if not record.complete:
        raise RunFolderError("not complete; run the same command again to go on")


def _estimate(found: DryRun) -> None:
    OUT.print(
        f"{found.shots} shots at {len(found.backgrounds_K)} backgrounds: "
        f"{found.time_s / 60.0:.0f} min, of which {found.background_s / 60.0:.0f} min wait for "
        f"backgrounds at {SECONDS_PER_KELVIN:g} s/K; {found.disk_bytes / 1e6:.0f} MB of "
        f"{found.free_bytes / 1e6:.0f} MB free"
    )
    if found.problems:
        raise RigError("the plan cannot run:\n" + "\n".join(found.problems))
    OUT.print("nothing speaks against it")


@click.command("export")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--to", "form", type=click.Choice(list(FORMATS)), required=True)
@click.option("--out", type=click.Path(path_type=Path), help="The file; in FOLDER if left out.")
@plain_errors
def export_command(folder: Path, form: str, out: Path | None) -> None:
    """Write the raw pictures of an acquisition FOLDER (or that of a run) into one file."""
    acquisition = open_acquisition(_acquisition_in(folder))
    path = export(acquisition, form, out)
    if acquisition.missing:
        OUT.print(f"[yellow]{len(acquisition.missing)} shots are still to be taken[/]")
    OUT.print(f"{path}: {len(acquisition.shots)} shots, {path.stat().st_size / 1e6:.1f} MB")


def _acquisition_in(folder: Path) -> Path:
    return folder / "acquisition" if (folder / "acquisition").is_dir() else folder


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--open", "opened", is_flag=True, help="Open the picture in the system's viewer.")
@plain_errors
def show(folder: Path, opened: bool) -> None:
    """The maps of a run or acquisition FOLDER, as a picture."""
    picture = show_folder(folder)
    OUT.print(str(picture))
    if opened:
        click.launch(str(picture))
