"""The live window on a real screen: an X server in memory (Xvfb) and a Tk window.

What is seen is read from the server's frame buffer. Whatever becomes of the window or its screen,
every shot is saved; of a window that hangs, only its own pictures are lost.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.acquisition import Plan, SavedShot, acquire, open_acquisition
from cldit.acquisition.plan import Shot
from cldit.cli.live import LiveView
from cldit.rig.load import open_rig

_PATIENCE_s = 60.0  # on a busy machine; nothing waits so long where all is well


@dataclass(frozen=True)
class Screen:
    name: str
    server: subprocess.Popen[bytes]
    buffer: Path

    def pixels(self) -> NDArray[np.uint8]:
        """(h, w, rgb) of what is on it: the server keeps an X window dump up to date."""
        raw = np.fromfile(self.buffer, np.uint8)
        words = raw[:100].view(">u4")
        header, width, height, stride, colours = (int(words[i]) for i in (0, 4, 5, 12, 19))
        rows = raw[header + 12 * colours :][: height * stride].reshape(height, stride)
        return rows[:, : 4 * width].reshape(height, width, 4)[..., 2::-1]

    def bright(self) -> tuple[float, float] | None:
        """Mean column and row of yellow pixels, which are a picture's brightest."""
        red, green, blue = np.moveaxis(self.pixels().astype(int), -1, 0)
        rows, columns = np.nonzero((red > 200) & (green > 120) & (blue < green - 60))
        return (columns.mean(), rows.mean()) if rows.size > 50 else None


@pytest.fixture
def screen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Screen]:
    program = shutil.which("Xvfb")
    if program is None:
        pytest.skip("Xvfb is missing; install xvfb")
    pytest.importorskip("tkinter", reason="tkinter is missing; install python3-tk")
    says, told = os.pipe()
    with subprocess.Popen(
        [program, "-displayfd", str(told), "-screen", "0", "800x700x24", "-nolisten", "tcp",
         "-fbdir", str(tmp_path)],
        pass_fds=[told], stderr=subprocess.DEVNULL,
    ) as server:  # fmt: skip
        os.close(told)
        with os.fdopen(says) as answer:
            name = f":{answer.readline().strip()}"
        monkeypatch.setenv("DISPLAY", name)
        monkeypatch.setenv("MPLBACKEND", "TkAgg")
        yield Screen(name, server, tmp_path / "Xvfb_screen0")
        server.send_signal(signal.SIGCONT)
        server.terminate()


def ramp() -> NDArray[np.uint16]:
    """Bright at the lower right."""
    y, x = np.mgrid[:512, :640]
    return np.asarray(1000 + 10 * (x + y), np.uint16)


def picture(image: NDArray[np.uint16]) -> SavedShot:
    shot = Shot("b00_ref_00", 0, 440.0, "reference", 0)
    return SavedShot(shot, image, {"saturated_percent": 0.0, "saturation_counts": 16383})


def wait_for(what: Callable[[], Any]) -> Any:
    end = time.monotonic() + _PATIENCE_s
    while not (got := what()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return got


def test_window_shows_the_newest_picture(screen: Screen) -> None:
    """Upright: row 0 is at the top. It goes when the acquisition does."""
    with LiveView() as view:
        view.show(picture(ramp()))
        wait_for(lambda: (at := screen.bright()) and at[0] > 350 and at[1] > 300)
        view.show(picture(ramp()[::-1]))
        wait_for(lambda: (at := screen.bright()) and at[0] > 350 and at[1] < 200)
        view.show(picture(ramp()[:, ::-1]))
        wait_for(lambda: (at := screen.bright()) and at[0] < 250 and at[1] > 300)
        assert view.has_window
    wait_for(lambda: screen.bright() is None)


class _ClientMessage(ctypes.Structure):
    """XClientMessageEvent, as long as an XEvent."""

    _fields_ = [
        ("kind", ctypes.c_int), ("serial", ctypes.c_ulong), ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p), ("window", ctypes.c_ulong), ("message", ctypes.c_ulong),
        ("format", ctypes.c_int), ("data", ctypes.c_long * 5), ("rest", ctypes.c_long * 12),
    ]  # fmt: skip


def user_closes(view: LiveView, screen: Screen) -> None:
    """As the close button does through a window manager: every window is asked to go."""
    x11 = ctypes.CDLL("libX11.so.6")  # which Tk needs too
    for function in (x11.XOpenDisplay, x11.XDefaultRootWindow, x11.XInternAtom):
        function.restype = ctypes.c_void_p
    display = ctypes.c_void_p(x11.XOpenDisplay(screen.name.encode()))
    atom = [
        x11.XInternAtom(display, name, False) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW")
    ]
    root = ctypes.c_ulong(x11.XDefaultRootWindow(display))
    unused, children, count = ctypes.c_ulong(), ctypes.POINTER(ctypes.c_ulong)(), ctypes.c_uint()
    x11.XQueryTree(
        display, root, *(ctypes.byref(item) for item in (unused, unused, children, count))
    )
    for child in children[: count.value]:
        event = _ClientMessage(33, window=child, message=atom[0], format=32, data=(atom[1], 0))
        x11.XSendEvent(display, ctypes.c_ulong(child), False, ctypes.c_long(0), ctypes.byref(event))
    x11.XCloseDisplay(display)


def screen_goes(view: LiveView, screen: Screen) -> None:
    screen.server.kill()


def screen_hangs(view: LiveView, screen: Screen) -> None:
    """As over a network that stands still: the window's process waits for its screen."""
    screen.server.send_signal(signal.SIGSTOP)


def window_hangs(view: LiveView, screen: Screen) -> None:
    assert view._window is not None
    view._window.send_signal(signal.SIGSTOP)


@pytest.mark.parametrize("fault", [user_closes, screen_goes, screen_hangs, window_hangs])
def test_nothing_of_it_touches_the_acquisition(
    fault: Callable[[LiveView, Screen], None],
    screen: Screen,
    tiny_rig: dict[str, Any],
    tiny_plan: Plan,
    tmp_path: Path,
) -> None:
    """While a run goes on: all is saved, and the terminal goes on with its own picture."""
    big = ramp()  # as a real camera's, and more than the pipe takes (64 KiB)
    shown: list[str] = []

    with LiveView() as view:
        view.show(picture(big))
        wait_for(screen.bright)

        def show(saved: SavedShot) -> None:
            if not shown:
                fault(view, screen)
            shown.append(saved.shot.id)
            view.show(SavedShot(saved.shot, big, saved.meta))

        record = acquire(open_rig(tiny_rig), tiny_plan, tmp_path / "a", preview=show)
        assert record.complete and len(open_acquisition(tmp_path / "a").shots) == 10
        wait_for(lambda: shown[-1] in view._picture.plain)
        feed = view._feed
        assert feed is not None
        if fault in (user_closes, screen_goes):
            end = time.monotonic() + _PATIENCE_s
            while view.has_window:  # the window's process has ended, which the pipe tells
                assert time.monotonic() < end
                view.show(picture(big))
                time.sleep(0.05)
        else:
            for _ in range(5):  # none of these waits for the window
                view.show(picture(big))
        if fault is window_hangs:
            assert feed.dropped > 0
        begin = time.monotonic()
    # 2 s for what is on its way into the pipe and 3 s for the process; a busy machine takes more.
    assert time.monotonic() - begin < 20.0
