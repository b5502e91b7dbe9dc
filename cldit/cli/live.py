"""The last picture of an acquisition: in the terminal, and in a window where there is a screen.

The window belongs to a process of its own, which gets pictures through a pipe: a window must be
served by the main thread of its process, and that of the acquisition has better to do.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from typing import IO, Any

import matplotlib
import numpy as np
from numpy.typing import NDArray
from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.text import Text

from cldit.acquisition.progress import Progress
from cldit.acquisition.sequence import SavedShot
from cldit.cli.console import OUT

_COLUMNS = 72  # characters of the picture in the terminal
_MAP = "inferno"


def stretched(image: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Counts as 0..1, from the 1st to the 99th percentile; 0 where all are the same."""
    low, high = np.percentile(image, (1.0, 99.0))
    if high <= low:
        return np.zeros(image.shape)
    return np.asarray(np.clip((image - low) / (high - low), 0.0, 1.0))


def half_blocks(image: NDArray[np.uint16], columns: int = _COLUMNS) -> Text:
    """A picture (h, w) of characters, each of which shows two pixels, one above the other."""
    height, width = image.shape
    columns = max(min(columns, width), 1)
    rows = max(round(columns * height / width / 2.0), 1)
    y = np.minimum((np.arange(2 * rows) + 0.5) * height / (2 * rows), height - 1).astype(int)
    x = np.minimum((np.arange(columns) + 0.5) * width / columns, width - 1).astype(int)
    colours = matplotlib.colormaps[_MAP](stretched(image)[np.ix_(y, x)], bytes=True)[..., :3]
    text = Text(no_wrap=True)
    for row in range(rows):
        for upper, lower in zip(colours[2 * row], colours[2 * row + 1], strict=True):
            over, under = ("rgb({},{},{})".format(*colour) for colour in (upper, lower))
            text.append("▀", style=f"{over} on {under}")
        text.append("\n")
    return text


class LiveView:
    """Progress and the last picture while it is entered. `watch` is for the acquisition's
    progress, `show` for its preview; both may be called from different threads."""

    def __init__(self, *, window: bool = True) -> None:
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeRemainingColumn(),
            console=OUT,
        )
        self._task = self._bar.add_task("", total=1)
        self._picture = Text()
        self._lock = threading.Lock()
        self._live = Live(console=OUT, refresh_per_second=4, transient=True)
        self._wants_window = window
        self._window: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> LiveView:
        if self._wants_window:
            self._window = subprocess.Popen(
                [sys.executable, "-c", "from cldit.cli.live import window; window()"],
                stdin=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the acquisition
            )
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()
        self._close_window()

    def watch(self, progress: Progress) -> None:
        with self._lock:
            self._bar.update(
                self._task,
                description=progress.phase,
                completed=progress.done,
                total=progress.total,
            )
            self._live.update(Group(self._picture, self._bar))

    def show(self, saved: SavedShot) -> None:
        frame = saved.image.reshape(-1, *saved.image.shape[-2:])[0]
        low, high = int(frame.min()), int(frame.max())
        picture = half_blocks(frame, min(_COLUMNS, OUT.width))
        picture.append(
            f"{saved.shot.id}  {saved.shot.background_K:g} K {saved.shot.kind}  "
            f"{low}..{high} counts  {saved.meta['saturated_percent']:.2g} % saturated"
        )
        with self._lock:
            self._picture = picture
            self._live.update(Group(self._picture, self._bar))
        if self._window is not None and self._window.stdin is not None:
            try:
                np.save(self._window.stdin, frame)
                self._window.stdin.flush()
            except OSError:  # closed by its user, or there is no screen
                self._close_window()

    def _close_window(self) -> None:
        process, self._window = self._window, None
        if process is None or process.stdin is None:
            return
        try:
            process.stdin.close()
        except OSError:
            pass
        try:
            process.wait(3.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def window(stream: IO[bytes] | None = None, *, interactive: bool | None = None) -> Any:
    """Shows each picture that `stream` (stdin) brings, until it ends or the window is closed; the
    figure, or None at once where matplotlib has no window to show."""
    import matplotlib.pyplot as plt

    stream = sys.stdin.buffer if stream is None else stream
    figure, axes = plt.subplots(num="cldit acquire --live")
    if interactive is None:  # matplotlib falls back to a canvas without a window where it must
        interactive = getattr(figure.canvas, "required_interactive_framework", None) is not None
    if not interactive:
        plt.close(figure)
        return None
    shown = None
    while True:
        try:
            image = np.load(stream, allow_pickle=False)
        except (EOFError, ValueError, OSError):
            return figure
        if shown is None:
            shown = axes.imshow(stretched(image), cmap=_MAP, vmin=0.0, vmax=1.0)
            axes.set_axis_off()
        else:
            shown.set_data(stretched(image))
        axes.set_title(f"{image.min()}..{image.max()} counts")
        plt.pause(0.01)
        if not plt.fignum_exists(figure.number):
            return figure
