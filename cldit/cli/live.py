"""A recording while it goes on: in the terminal, in a window where there is a screen, as a page.

The window belongs to a process of its own, which gets pictures through a pipe: a window must be
served by the main thread of its process, and that of the acquisition has better to do. So has the
page, `cldit.cli.live_page`. The terminal is drawn in a thread: one that stands still (Ctrl-S) keeps
up its own picture only.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import IO

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar
from rich.text import Text

from cldit.acquisition.exposure import exposure
from cldit.acquisition.preview import Preview
from cldit.acquisition.progress import Progress, left_text
from cldit.acquisition.sequence import SavedShot
from cldit.cli.console import OUT, say
from cldit.cli.live_page import PageWriter
from cldit.cli.sparkline import sparkline

_COLUMNS = 72  # characters of the picture in the terminal
_PAUSE_s = 0.25  # between two pictures in the terminal, at least
_REST = 19.0  # times what a picture took: a twentieth of a core at most
_BINS = 48  # of the histogram in the terminal
_MAP = "inferno"
_SIZES = struct.Struct("=3I")  # rows, columns, bytes of the label: before these in the pipe
_LOOK_ms = 50  # how often the window looks for a new picture
_CLOSING_s = 3.0
# (Leaving at once: Python would wait for the thread that reads.)
_WINDOW = "import os; from cldit.cli.live import window; window(); os._exit(0)"

Labelled = tuple[str, NDArray[np.uint16]]


def stretched(image: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Counts (h, w) as 0..1, from the 1st to the 99th percentile; 0 where all are the same."""
    low, high = np.percentile(image, (1.0, 99.0))
    if high <= low:
        return np.zeros(image.shape)
    return np.asarray(np.clip((image - low) / (high - low), 0.0, 1.0))


def half_blocks(image: NDArray[np.uint16], columns: int = _COLUMNS) -> Text:
    """`image` (h, w) as text of `columns`; a character shows two pixels, one above the other."""
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
    """Progress and the last picture while it is entered. `watch` is for the acquisition's
    progress, `show` for its preview; both may be called from different threads.

    Args:
        window: whether one is opened, where there is a screen.
        folder: of the acquisition, for the page; None: no page.
    """

    def __init__(self, *, window: bool = True, folder: Path | None = None) -> None:
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            console=OUT,
        )
        self._task = self._bar.add_task("", total=1)
        self._picture = Text()
        self._newest: SavedShot | None = None  # that is not drawn yet
        self._progress: Progress | None = None
        self._distances_K: deque[float] = deque(maxlen=_COLUMNS)  # from the set point
        self._setpoint_K: float | None = None
        self._lock = threading.Lock()
        self._live = Live(console=OUT, auto_refresh=False, transient=True)
        self._terminal: Preview[None] = Preview(self._draw)
        self._closing = threading.Event()
        self.page = None if folder is None else PageWriter(folder)
        self._window: subprocess.Popen[bytes] | None = None
        self._feed: Preview[Labelled] | None = None
        self._wants_window = window

    def __enter__(self) -> LiveView:
        if self._wants_window:
            self._window = subprocess.Popen(
                [sys.executable, "-c", _WINDOW],
                stdin=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the acquisition
            )
            # A window may hang, with its screen: in a thread of its own it keeps up nobody.
            self._feed = Preview(self._send)
            self._feed.__enter__()
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
        self._close_window()
        if self.page is not None:
            self.page.__exit__()
            if self.page.problem:
                say(self.page.problem)

    def watch(self, progress: Progress) -> None:
        """Shows how far the acquisition is."""
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
        """Shows the last picture."""
        with self._lock:
            self._newest = saved
        self._terminal.offer(None)
        if self._feed is not None:
            self._feed.offer((_label(saved), _first(saved)))

    def _draw(self, _: None) -> None:
        """Draws what is new, and rests: what it takes of Python's lock, shots wait for."""
        begin_s = time.monotonic()
        with self._lock:
            newest, self._newest = self._newest, None
            progress, distances_K = self._progress, list(self._distances_K)
        if newest is not None:
            self._picture = self._drawn(newest)
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
        self._live.update(Group(self._picture, state, self._bar), refresh=True)
        self._closing.wait(max(_PAUSE_s, _REST * (time.monotonic() - begin_s)))

    def _drawn(self, saved: SavedShot) -> Text:
        picture = half_blocks(_first(saved), min(_COLUMNS, OUT.width))
        full = int(saved.meta["saturation_counts"])
        found = exposure(saved.image, saturation_counts=full, bins=_BINS)
        # Logarithmic: a few pixels at saturation are what one looks for.
        picture.append(f"{_label(saved)}\n0 {self._spark(np.log1p(found.pixels))} {full} counts\n")
        return picture

    def _spark(self, values: Iterable[float]) -> str:
        return sparkline(list(values), encoding=OUT.encoding, columns=min(_COLUMNS, OUT.width) - 9)

    @property
    def has_window(self) -> bool:
        """Whether a window still takes pictures; False from the first that it did not take."""
        return self._feed is not None and self._feed.error is None

    def _send(self, labelled: Labelled) -> None:
        assert self._window is not None and self._window.stdin is not None
        label, frame = labelled[0].encode(), labelled[1]
        self._window.stdin.write(_SIZES.pack(*frame.shape, len(label)) + label + frame.tobytes())
        self._window.stdin.flush()

    def _close_window(self) -> None:
        process, self._window = self._window, None
        feed, self._feed = self._feed, None
        if process is None or process.stdin is None or feed is None:
            return
        feed.__exit__()
        if feed.ended:  # else closing the pipe would wait for what is being written
            with suppress(OSError, subprocess.TimeoutExpired):
                process.stdin.close()
                process.wait(_CLOSING_s)
        process.kill()
        process.wait()
        with suppress(OSError):
            process.stdin.close()


def window(stream: IO[bytes] | None = None) -> None:
    """Shows the newest of the pictures that `stream` (stdin) brings, until it ends or the window
    is closed; returns at once where matplotlib has no window to show."""
    import matplotlib.pyplot as plt

    incoming = sys.stdin.buffer if stream is None else stream
    figure, axes = plt.subplots(num="cldit acquire --live", layout="constrained")
    # (Where matplotlib must, it falls back to a canvas without a window.)
    if getattr(figure.canvas, "required_interactive_framework", None) is None:
        plt.close(figure)
        return
    newest: deque[Labelled] = deque(maxlen=1)
    ended = threading.Event()

    def read() -> None:
        while len(head := incoming.read(_SIZES.size)) == _SIZES.size:
            rows, columns, letters = _SIZES.unpack(head)
            label = incoming.read(letters).decode()
            data = incoming.read(2 * rows * columns)
            if len(data) == 2 * rows * columns:
                newest.append((label, np.frombuffer(data, np.uint16).reshape(rows, columns)))
        ended.set()

    def look() -> None:
        if newest:
            draw(axes, *newest.pop())
            figure.canvas.draw_idle()
        elif ended.is_set():
            plt.close(figure)

    axes.set_axis_off()
    axes.set_title("waiting for the first picture")
    threading.Thread(target=read, daemon=True).start()
    timer = figure.canvas.new_timer(interval=_LOOK_ms)
    timer.add_callback(look)
    timer.start()
    plt.show()  # the window answers its user all the while


def draw(axes: Axes, label: str, image: NDArray[np.uint16]) -> None:
    """Draws a picture in place of the last one.

    Args:
        axes: where.
        label: above it.
        image: (h, w) counts.
    """
    if axes.images and axes.images[0].get_size() == image.shape:
        axes.images[0].set_data(stretched(image))
    else:
        axes.clear()
        axes.imshow(stretched(image), cmap=_MAP, vmin=0.0, vmax=1.0)
        axes.set_axis_off()
    axes.set_title(label, fontsize="medium")
