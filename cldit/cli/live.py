"""`cldit acquire --live`: a recording in progress, as a page.

The page is written by a process of its own that only reads the recording's folder. The recording
gives it nothing but a pipe that ends with it, even when it is killed: no shot waits for the page,
its disk or its reader.
"""

import os
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from cldit.acquisition.disk import check_room, needed_bytes
from cldit.acquisition.storage import JOURNAL, load_shot, shot_path
from cldit.acquisition.watch import Seen, Watch
from cldit.cli.console import say
from cldit.errors import ClditError
from cldit.io.files import write_bytes
from cldit.show.report.live import LastShot, live_page

PAGE = "live.html"
_PAUSE_s = 1.0  # between two pages, at least
_REST = 9.0  # times the writing time of a page: at most a tenth of a core
_BEAT_s = 5.0  # longest time without a page: its age is shown
_NICENESS = 5  # a third of a normal process's share of a core: the recording has priority
_SPARE_bytes = 50_000_000  # of the disk, beside what the recording still needs
_CLOSING_s = 10.0  # for the last page; a process that takes longer is killed
_SERVE = "from cldit.cli.live import serve; serve()"


class PageWriter:
    """Process that writes `live.html` into the folder of an acquisition while it is entered."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / PAGE
        self.process: subprocess.Popen[bytes] | None = None
        self.problem = ""

    def __enter__(self) -> "PageWriter":
        journal = self.path.with_name(JOURNAL)
        journal_bytes = journal.stat().st_size if journal.is_file() else 0
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-c", _SERVE, str(self.path.parent), str(journal_bytes)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the acquisition
            )
            say(f"page: {self.path}")
        except OSError as error:
            self.problem = f"{self.path}: not written ({error})"
        return self

    def __exit__(self, *_: object) -> None:
        code, process = 0, self.process
        if process is not None and process.stdin is not None:
            with suppress(OSError):
                process.stdin.close()
            try:
                code = process.wait(_CLOSING_s)
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
        if code:
            self.problem = (
                f"{self.path}: its process ended early ({code}), so it may show an old state; "
                "the recording does not depend on it"
            )
        if self.problem:
            say(self.problem)


def serve() -> None:
    """Runs the process; its arguments are the folder and the present length of the journal."""
    folder, journal_bytes = Path(sys.argv[1]), int(sys.argv[2])
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    ended = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.buffer.read()  # nothing is sent: it returns when the recording is gone
        ended.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    write_pages(folder, ended, known_bytes=journal_bytes)


def write_pages(folder: Path, ended: threading.Event, *, known_bytes: int = 0) -> None:
    """Writes the page, at most once a second, until `ended` is set when the recording ends.

    Problems of reading and writing are reported on the next page, and tried again.
    """
    watch = Watch(folder, known_bytes=known_bytes)
    due, unwritten, written_s, pause_s = True, "", 0.0, 0.0
    shot: LastShot | None = None
    while True:
        over = ended.wait(pause_s)
        begin_s = time.monotonic()
        problems = [unwritten] if unwritten else []
        try:
            due = watch.look() or due
        except ClditError as error:
            problems.append(str(error))
        state = watch.seen(ended=over)
        if (due or over or begin_s - written_s >= _BEAT_s) and folder.is_dir():
            try:
                shot = _newest(folder, state, shot)
            except ClditError as error:
                problems.append(str(error))
            page = live_page(
                state, shot, over=over, problem="; ".join(problems), epoch_s=time.time()
            )
            try:
                _write(folder, page.encode(), state)
                due, unwritten, written_s = False, "", begin_s
            except ClditError as error:
                due, unwritten = True, str(error)
        if over:
            return
        pause_s = max(_PAUSE_s, _REST * (time.monotonic() - begin_s))


def _newest(folder: Path, state: Seen, previous: LastShot | None) -> LastShot | None:
    if state.last is None or state.plan is None:
        return None
    name = state.last["shot"]
    if previous is not None and previous.meta["shot"] == name:
        return previous
    return LastShot(*load_shot(folder, name, plan_hash=state.plan.hash()))


def _write(folder: Path, page: bytes, state: Seen) -> None:
    """Raises DiskFull where the rest of the disk is needed for the shots."""
    path = None if state.last is None else shot_path(folder, state.last["shot"])
    size = path.stat().st_size if path is not None and path.is_file() else 0
    remaining_bytes = needed_bytes(state.total - state.done, picture_bytes=size)
    check_room(folder, remaining_bytes + len(page) + _SPARE_bytes)
    write_bytes(folder / PAGE, page, sync=False)
