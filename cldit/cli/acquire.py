"""`cldit acquire`: a sequence with the instruments of a rig."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Self

import click

from cldit.acquisition.dry_runs import SECONDS_PER_KELVIN, DryRun, dry_run
from cldit.acquisition.plan import load_plan
from cldit.acquisition.preview import Preview
from cldit.acquisition.progress import Progress
from cldit.acquisition.runner import acquire
from cldit.cli.console import OUT, ProgressBar, plain_errors
from cldit.cli.options import PATH
from cldit.cli.results import print_next
from cldit.rig.errors import Aborted, RigError
from cldit.rig.load import open_rig


@click.command("acquire")
@click.argument("rig", type=PATH)
@click.argument("plan", type=PATH)
@click.option("--out", type=PATH, required=True, help="Folder of the shots.")
@click.option("--dry-run", "dry", is_flag=True, help="Check and estimate; nothing moves or fires.")
@click.option("--live", is_flag=True, help="Show the recording on a page, live.html.")
@plain_errors
def acquire_command(rig: Path, plan: Path, out: Path, dry: bool, live: bool) -> None:
    """Record the sequence in PLAN with the instruments in RIG; resumes where it stopped."""
    sequence = load_plan(plan)
    if dry:
        dry_rig = open_rig(rig)
        try:
            _print_estimate(dry_run(dry_rig, sequence, out))
        finally:
            dry_rig.close()  # not made safe: that would move the black body
        print_next("cldit", "acquire", rig, plan, "--out", out)
        return
    page: AbstractContextManager[object] = nullcontext()
    if live:
        from cldit.cli.live import PageWriter  # loads matplotlib

        page = PageWriter(out)
    with RecordingBar() as bar, open_rig(rig) as opened, page:
        record = acquire(opened, sequence, out, progress=bar.watch)
    OUT.print(
        f"{record.saved} of {record.total} shots in {out}; {record.rejected} rejected, "
        f"{record.lost_injections} injections without a saved image"
    )
    if not record.complete:
        raise Aborted("not complete; run the same command again to continue")
    print_next("cldit", "evaluate", out)


class RecordingBar:
    """Progress bar drawn in a thread of its own.

    A stopped terminal (Ctrl-S) delays only the bar, which then shows the newest state.
    """

    def __init__(self) -> None:
        self._bar = ProgressBar()
        self._drawn: Preview[Progress] = Preview(self._bar.watch)

    def __enter__(self) -> Self:
        self._drawn.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._drawn.__exit__()
        if self._drawn.ended:  # else the terminal is still stopped, and the bar has its lock
            self._bar.__exit__()

    def watch(self, progress: Progress) -> None:
        """Shows the progress without waiting for the terminal."""
        self._drawn.offer(progress)


def _print_estimate(estimate: DryRun) -> None:
    OUT.print(
        f"{estimate.shots} shots at {len(estimate.backgrounds_K)} backgrounds: "
        f"{estimate.time_s / 60.0:.0f} min, of which {estimate.background_s / 60.0:.0f} min wait "
        f"for backgrounds at {SECONDS_PER_KELVIN:g} s/K; {estimate.disk_bytes / 1e6:.0f} MB of "
        f"{estimate.free_bytes / 1e6:.0f} MB free"
    )
    if estimate.problems:
        raise RigError("the plan cannot run:\n" + "\n".join(estimate.problems))
    if estimate.unstated:
        OUT.print(
            f"camera: {', '.join(estimate.unstated)}: the calibration is valid for one value; "
            "state it in the rig file, as camera.settings.features"
        )
    OUT.print("dry run passed")
