"""The page that shows a recording while it goes on: `live.html` in its folder.

It is written anew every few seconds, so it is drawn as SVG text and one small PNG: a hundredth of
what a figure of matplotlib takes.
"""

from __future__ import annotations

import io
import time
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from cldit.acquisition.exposure import exposure
from cldit.acquisition.progress import Approach, left_text
from cldit.acquisition.watch import Reading, Seen
from cldit.show.figures.svg import Plot, curve
from cldit.show.report.html import render

_MAP = "inferno"
_SATURATED = (0, 200, 255)  # a colour that the map has not
_MOST_PIXELS = 1024  # of a side; a larger picture is shown at every second pixel, or third
_BINS = 96
_POINTS = 1500  # of a curve
_LATE_s = 20  # after so long without a new page, the page itself says so
_REFRESH_s = 2


@dataclass(frozen=True)
class LastShot:
    """The newest shot: counts (h, w) or (n, h, w), and its metadata."""

    image: NDArray[np.uint16]
    meta: dict[str, Any]


def live_page(
    seen: Seen, shot: LastShot | None, *, over: bool, problem: str = "", epoch_s: float
) -> str:
    """The page as text; it addresses nothing outside itself.

    Args:
        seen: where the recording is.
        shot: the newest picture, where there is one.
        over: whether this is the last page, which does not load itself again.
        problem: what the watcher could not read or write, a line.
        epoch_s: time at which the page is made, seconds since 1970.
    """
    plan = seen.plan
    now = [reading for reading in seen.readings if reading.setpoint_K == _setpoint_K(seen)]
    return render(
        "live.html",
        seen=seen,
        over=over,
        problem=problem,
        refresh_s=_REFRESH_s,
        late_s=_LATE_s,
        written_ms=round(1e3 * epoch_s),
        written=time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(epoch_s)),
        left=left_text(seen.done, seen.total, seen.left_s) if plan else "",
        backgrounds=len(plan.backgrounds_K) if plan else 0,
        approach=_approach(seen),
        whole=_way(seen.readings) if plan else None,
        close=_close(now, tolerance_K=plan.stability.tolerance_K) if plan else None,
        shot=None if shot is None else _shot(seen, shot),
    )


def _setpoint_K(seen: Seen) -> float | None:
    return seen.readings[-1].setpoint_K if seen.readings else None


def _approach(seen: Seen) -> str:
    if seen.plan is None or not seen.readings:
        return ""
    last = seen.readings[-1]
    return str(
        Approach(
            reading_K=last.reading_K,
            setpoint_K=last.setpoint_K,
            tolerance_K=seen.plan.stability.tolerance_K,
        )
    )


def _thinned(readings: Sequence[Reading]) -> list[Reading]:
    """At most `_POINTS` of them, the last among these."""
    step = -(-len(readings) // _POINTS)
    return list(readings[::-1][:: max(step, 1)][::-1])


def _way(readings: Sequence[Reading]) -> Plot | None:
    """Temperature and set point over the whole session."""
    shown = _thinned(readings)
    if not shown:
        return None
    minutes = [reading.time_s / 60.0 for reading in shown]
    return curve(
        minutes,
        [reading.reading_K for reading in shown],
        target=[reading.setpoint_K for reading in shown],
    )


def _close(readings: Sequence[Reading], *, tolerance_K: float) -> Plot | None:
    """How far from the present set point, cut at ten tolerances, with the band of tolerance."""
    shown = _thinned(readings)
    if not shown:
        return None
    return curve(
        [reading.time_s / 60.0 for reading in shown],
        [reading.reading_K - reading.setpoint_K for reading in shown],
        target=[0.0] * len(shown),
        band=(-tolerance_K, tolerance_K),
        most=10.0 * tolerance_K,
    )


@lru_cache(maxsize=1)
def _palette() -> bytes:
    """256 colours: the map in 255 steps, and what is saturated."""
    colours = matplotlib.colormaps[_MAP](np.linspace(0.0, 1.0, 255), bytes=True)[:, :3]
    return np.vstack([colours, np.array([_SATURATED], np.uint8)]).astype(np.uint8).tobytes()


@lru_cache(maxsize=1)
def _ramp() -> str:
    """The colour scale, 255 pixels wide, as PNG."""
    return _png(np.arange(255, dtype=np.uint8)[None, :])


def _png(indices: NDArray[np.uint8]) -> str:
    image = Image.fromarray(indices, mode="P")
    image.putpalette(_palette())
    stream = io.BytesIO()
    image.save(stream, format="PNG", compress_level=1)
    return b64encode(stream.getvalue()).decode("ascii")


def _shot(seen: Seen, shot: LastShot) -> dict[str, Any]:
    """What the template says of a shot: its first picture, the histogram of all."""
    frames = shot.image.reshape(-1, *shot.image.shape[-2:])
    frame = frames[0]
    full = int(shot.meta["saturation_counts"])
    step = -(-max(frame.shape) // _MOST_PIXELS)
    small = frame[::step, ::step]
    low, high = (float(each) for each in np.percentile(small, (1.0, 99.0)))
    scaled = (small - low) / (high - low) if high > low else np.zeros(small.shape)
    indices = np.asarray(np.clip(254.0 * scaled, 0.0, 254.0), np.uint8)
    # A saturated pixel is never left out, also where the picture is made smaller.
    rows, columns = np.nonzero(frame >= full)
    indices[rows // step, columns // step] = 255
    found = exposure(shot.image, saturation_counts=full, bins=_BINS)
    most = np.log1p(max(int(found.pixels.max()), 1))
    return {
        "png": _png(indices),
        "ramp": _ramp(),
        "low": f"{low:.0f}",
        "high": f"{high:.0f}",
        "id": shot.meta["shot"],
        "time": shot.meta["time"],
        "what": ""
        if seen.last is None
        else f"{shot.meta['background_setpoint_K']:g} K, {shot.meta['kind']}",
        "frames": len(frames),
        "shape": frame.shape,
        "bars": [round(float(np.log1p(count) / most), 4) for count in found.pixels],
        "exposure": found,
    }
