"""Runs a plan on a rig and leaves the rig safe; `cldit.acquisition.sequence` describes the
sequence.
"""

from collections.abc import Callable, Generator
from contextlib import ExitStack
from pathlib import Path

from cldit.acquisition.guard import Guard, alarm
from cldit.acquisition.interrupts import Interrupts
from cldit.acquisition.plan import Plan
from cldit.acquisition.preview import Preview
from cldit.acquisition.progress import Progress
from cldit.acquisition.sequence import Record, Sequence
from cldit.acquisition.shot import SavedShot
from cldit.acquisition.storage import RUNNING
from cldit.io.exclusive import exclusive
from cldit.rig.clock import StopCheck
from cldit.rig.errors import RigError
from cldit.rig.load import Rig


def acquire(
    rig: Rig,
    plan: Plan,
    folder: Path,
    *,
    progress: Callable[[Progress], None] | None = None,
    should_stop: StopCheck | None = None,
    preview: Callable[[SavedShot], None] | None = None,
) -> Record:
    """Takes every shot of `plan` that is not in `folder` yet.

    The same call resumes after any ending, a kill included. Ctrl-C once finishes the shot and
    returns an incomplete record; twice aborts the shot. The rig is left safe, connected.

    `progress` is called after every step. `should_stop` is polled; True ends the acquisition after
    the present shot. `preview` is called in its own thread with the newest image; images that
    arrive while it is busy are skipped, and saving never waits for it. Raises as `iterate`.
    """
    shots = iterate(rig, plan, folder, progress=progress, should_stop=should_stop)
    with ExitStack() as stack:
        show = None if preview is None else stack.enter_context(Preview(preview)).offer
        while True:
            try:
                saved = next(shots)
            except StopIteration as end:
                record: Record = end.value
                return record
            if show is not None:
                show(saved)


def iterate(
    rig: Rig,
    plan: Plan,
    folder: Path,
    *,
    progress: Callable[[Progress], None] | None = None,
    should_stop: StopCheck | None = None,
) -> Generator[SavedShot, None, Record]:
    """Does the same as `acquire`, and yields each shot after it is saved.

    Closing the generator early ends the acquisition safely. The record is the generator's return
    value. Raises RunFolderError if the folder is in use, belongs to another plan, or is damaged;
    DiskFull, which names the space needed; RigError; Aborted on the second Ctrl-C.
    """
    with (
        exclusive(folder, RUNNING),
        Guard(rig, folder) as guard,
        Interrupts(should_stop) as interrupts,
    ):
        try:
            record = yield from Sequence(rig, plan, folder, interrupts, progress).run()
        except (Exception, GeneratorExit) as error:
            _end_safe(guard, error)
            raise
        except BaseException as error:  # whoever ends the process must still be able to
            problems = guard.make_safe()
            if problems:
                alarm(problems)
                error.add_note("\n".join(problems))
            raise
        _end_safe(guard)
        return record


def _end_safe(guard: Guard, cause: BaseException | None = None) -> None:
    """Raises RigError that names what is still on, behind the error that ended the acquisition."""
    problems = guard.make_safe()
    if problems:
        cause_text = f"{cause}\nand " if isinstance(cause, Exception) else ""
        raise RigError(f"{cause_text}the rig was not made safe:\n" + "\n".join(problems)) from cause
