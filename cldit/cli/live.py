"""`cldit acquire --live`: a recording in progress, in the terminal and as a page.

The page is written by a process of its own that only reads the recording's folder. The recording
gives it nothing but a pipe that ends with it, even when it is killed: no shot waits for the page,
its disk or its reader. The terminal is drawn in a thread: if it stops (Ctrl-S), only its own
display waits.
"""

import math
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar
from rich.text import Text

from cldit.acquisition.disk import check_room, needed_bytes
from cldit.acquisition.preview import Preview
from cldit.acquisition.progress import Progress, left_text
from cldit.acquisition.quality import exposure
from cldit.acquisition.sequence import SavedShot
from cldit.acquisition.storage import JOURNAL, load_shot, shot_path
from cldit.acquisition.watch import Seen, Watch
from cldit.cli.console import OUT, say
from cldit.errors import ClditError
from cldit.io.files import write_bytes
from cldit.show.report.live import COLOURS, LastShot, live_page, stretched

PAGE = "live.html"
_COLUMNS = 72  # characters of the image in the terminal
_DRAW_PAUSE_s = 0.25  # between two images in the terminal, at least
_DRAW_REST = 19.0  # times the drawing time: at most a twentieth of a core
_BINS = 48  # of the histogram in the terminal
_BLOCKS = " ▁▂▃▄▅▆▇█"
_ASCII = " .:-=+*#@"  # for terminals without blocks
_ROUNDING = 1e-9
_PAUSE_s = 1.0  # between two pages, at least
_REST = 9.0  # times the writing time of a page: at most a tenth of a core
_BEAT_s = 5.0  # longest time without a page: its age is shown
_NICENESS = 5  # the recording has priority
_SPARE_bytes = 50_000_000  # of the disk, beside what the recording still needs
_CLOSING_s = 10.0
_SERVE = "from cldit.cli.live import serve; serve()"


def half_blocks(image: NDArray[np.uint16], columns: int = _COLUMNS) -> Text:
    """Text of an image (h, w) in `columns`; a character shows two pixels, one above the other."""
    height, width = image.shape
    columns = max(min(columns, width), 1)
    rows = max(round(columns * height / width / 2.0), 1)
    y = np.minimum((np.arange(2 * rows) + 0.5) * height / (2 * rows), height - 1).astype(int)
    x = np.minimum((np.arange(columns) + 0.5) * width / columns, width - 1).astype(int)
    shares, _, _ = stretched(image)
    colours = matplotlib.colormaps[COLOURS](shares[np.ix_(y, x)], bytes=True)
    text = Text(no_wrap=True)
    for row in range(rows):
        for upper, lower in zip(colours[2 * row], colours[2 * row + 1], strict=True):
            over, under = ("rgb({},{},{})".format(*colour[:3]) for colour in (upper, lower))
            text.append("▀", style=f"{over} on {under}")
        text.append("\n")
    return text


def sparkline(values: Sequence[float], *, encoding: str, columns: int) -> str:
    """Line of characters for `values` of 0 and more; a value above 0 is never blank.

    Of more values than `columns`, the largest in each column is shown.
    """
    if not len(values):
        return ""
    levels = _BLOCKS if encoding.lower().startswith("utf") else _ASCII
    columns = max(min(columns, len(values)), 1)
    edges = [number * len(values) // columns for number in range(columns + 1)]
    shown = [max(values[a:b]) for a, b in pairwise(edges)]
    most = max(shown) or 1.0
    steps = len(levels) - 1
    return "".join(levels[math.ceil(steps * value / most - _ROUNDING)] for value in shown)


def _first(saved: SavedShot) -> NDArray[np.uint16]:
    frame: NDArray[np.uint16] = saved.image.reshape(-1, *saved.image.shape[-2:])[0]
    return frame


def _label(saved: SavedShot) -> str:
    frame = _first(saved)
    return (
        f"{saved.shot.id}  {saved.shot.background_K:g} K {saved.shot.kind}  "
        f"{frame.min()}..{frame.max()} counts  {saved.meta['saturated_percent']:.2g} % saturated"
    )


class LiveView:
    """Display of progress and the last image while it is entered.

    `watch` is for the acquisition's progress, `show` for its preview; both may be called from
    different threads. folder: of the acquisition, for the page; None: no page.
    """

    def __init__(self, *, folder: Path | None = None) -> None:
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            console=OUT,
        )
        self._task = self._bar.add_task("", total=1)
        self._image = Text()
        self._newest: SavedShot | None = None  # if it is not drawn yet
        self._progress: Progress | None = None
        self._distances_K: deque[float] = deque(maxlen=_COLUMNS)  # from the set point
        self._setpoint_K: float | None = None
        self._lock = threading.Lock()
        self._live = Live(console=OUT, auto_refresh=False, transient=True)
        self._terminal: Preview[None] = Preview(self._draw)
        self._closing = threading.Event()
        self.page = None if folder is None else PageWriter(folder)

    def __enter__(self) -> "LiveView":
        if self.page is not None:
            self.page.__enter__()
            say(f"page: {self.page.path}")
        self._terminal.__enter__()
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._terminal.__exit__()
        self._live.stop()
        if self.page is not None:
            self.page.__exit__()
            if self.page.problem:
                say(self.page.problem)

    def watch(self, progress: Progress) -> None:
        """Shows the progress of the acquisition."""
        with self._lock:
            self._progress = progress
            approach = progress.approach
            if approach is not None:
                if approach.setpoint_K != self._setpoint_K:
                    self._distances_K.clear()
                    self._setpoint_K = approach.setpoint_K
                self._distances_K.append(abs(approach.reading_K - approach.setpoint_K))
        self._terminal.offer(None)

    def show(self, saved: SavedShot) -> None:
        """Shows the last image."""
        with self._lock:
            self._newest = saved
        self._terminal.offer(None)

    def _draw(self, _: None) -> None:
        """Draws what is new, then rests: shots wait while drawing holds Python's lock."""
        begin_s = time.monotonic()
        with self._lock:
            newest, self._newest = self._newest, None
            progress, distances_K = self._progress, list(self._distances_K)
        if newest is not None:
            self._image = self._drawn(newest)
        state = Text(no_wrap=True)
        if progress is not None:
            self._bar.update(
                self._task,
                description=progress.phase,
                completed=progress.done,
                total=progress.total,
            )
            state.append(left_text(progress.done, progress.total, progress.eta_s) + "\n")
            if progress.approach is not None:
                state.append(f"{progress.approach}\ndistance {self._spark(distances_K)}\n")
        self._live.update(Group(self._image, state, self._bar), refresh=True)
        self._closing.wait(max(_DRAW_PAUSE_s, _DRAW_REST * (time.monotonic() - begin_s)))

    def _drawn(self, saved: SavedShot) -> Text:
        image = half_blocks(_first(saved), min(_COLUMNS, OUT.width))
        full = int(saved.meta["saturation_counts"])
        found = exposure(saved.image, saturation_counts=full, bins=_BINS)
        # Logarithmic, to show even a few saturated pixels.
        image.append(f"{_label(saved)}\n0 {self._spark(np.log1p(found.pixels))} {full} counts\n")
        return image

    def _spark(self, values: Iterable[float]) -> str:
        return sparkline(list(values), encoding=OUT.encoding, columns=min(_COLUMNS, OUT.width) - 9)


class PageWriter:
    """Process that writes `live.html` into the folder of an acquisition while it is entered."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / PAGE
        self.process: subprocess.Popen[bytes] | None = None
        self.problem = ""

    def __enter__(self) -> "PageWriter":
        journal = self.path.with_name(JOURNAL)
        known_bytes = journal.stat().st_size if journal.is_file() else 0
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-c", _SERVE, str(self.path.parent), str(known_bytes)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the acquisition
            )
        except OSError as error:
            self.problem = f"{self.path}: not written ({error})"
        return self

    def __exit__(self, *_: object) -> None:
        process = self.process
        if process is None or process.stdin is None:
            return
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


def serve() -> None:
    """Runs the process; its arguments are the folder and the present length of the journal."""
    folder, known_bytes = Path(sys.argv[1]), int(sys.argv[2])
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    ended = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.buffer.read()  # nothing is sent: it returns when the recording is gone
        ended.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    write_pages(folder, ended, known_bytes=known_bytes)


def write_pages(folder: Path, ended: threading.Event, *, known_bytes: int = 0) -> None:
    """Writes the page, at most once a second, until `ended` is set when the recording ends.

    Problems of reading and writing are reported on the next page, and tried again.
    """
    watch = Watch(folder, known_bytes=known_bytes)
    wanted, unwritten, written_s, pause_s = True, "", 0.0, 0.0
    shot: LastShot | None = None
    while True:
        over = ended.wait(pause_s)
        begin_s = time.monotonic()
        problems = [unwritten] if unwritten else []
        try:
            wanted = watch.look() or wanted
        except ClditError as error:
            problems.append(str(error))
        seen = watch.seen(ended=over)
        if (wanted or over or begin_s - written_s >= _BEAT_s) and folder.is_dir():
            try:
                shot = _newest(folder, seen, shot)
            except ClditError as error:
                problems.append(str(error))
            page = live_page(
                seen, shot, over=over, problem="; ".join(problems), epoch_s=time.time()
            )
            try:
                _write(folder, page.encode(), seen)
                wanted, unwritten, written_s = False, "", begin_s
            except ClditError as error:
                wanted, unwritten = True, str(error)
        if over:
            return
        pause_s = max(_PAUSE_s, _REST * (time.monotonic() - begin_s))


def _newest(folder: Path, seen: Seen, before: LastShot | None) -> LastShot | None:
    if seen.last is None or seen.plan is None:
        return None
    name = seen.last["shot"]
    if before is not None and before.meta["shot"] == name:
        return before
    return LastShot(*load_shot(folder, name, plan_hash=seen.plan.hash()))


def _write(folder: Path, page: bytes, seen: Seen) -> None:
    """Raises DiskFull where the rest of the disk is needed for the shots."""
    last = None if seen.last is None else shot_path(folder, seen.last["shot"])
    size = last.stat().st_size if last is not None and last.is_file() else 0
    left = needed_bytes(seen.total - seen.done, picture_bytes=size)
    check_room(folder, left + len(page) + _SPARE_bytes)
    write_bytes(folder / PAGE, page, sync=False)
