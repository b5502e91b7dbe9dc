"""Page `live.html` of a recording in progress.

It is written again every few seconds, so curves are SVG text and the image is one small PNG; a
figure of matplotlib would take a hundred times as long.
"""

import io
import time
from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from typing import Any

import matplotlib
import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from PIL import Image

from cldit.acquisition.progress import Approach, left_text
from cldit.acquisition.quality import exposure
from cldit.acquisition.watch import Reading, Seen
from cldit.show.page import Block, Html, Page, Section, html_of

COLOURS = "inferno"
_SATURATED = (0, 200, 255)  # a colour that the map does not have
_MOST_PIXELS = 1024  # of a side; of larger images, every second or third pixel is shown
_BINS = 96
_POINTS = 1500  # of a curve
_WIDTH, _HEIGHT = 560.0, 200.0  # of the plane within the axes of a curve, in SVG units
_BARS_HIGH = 140
_LATE_s = 20  # age from which the page itself says that it is old
_REFRESH_s = 2
_STYLE = """<style>
body{font-size:15px;line-height:1.45;max-width:78rem}h1{font-size:1.4rem;margin:.8rem 0 .2rem}
h2{font-size:1.05rem;margin:1rem 0 .3rem}p{margin:.2rem 0}
.grid{display:grid;gap:0 2rem;grid-template-columns:repeat(auto-fit,minmax(22rem,1fr))}
.bar{background:#ddd;height:1.1rem;margin:.4rem 0}
.bar span{display:block;background:#3a6ea5;height:100%}
.alarm{background:#b00020;color:#fff;padding:.5rem .8rem;white-space:pre-wrap}
.note{background:#fff3cd;padding:.5rem .8rem}.small{color:#444;font-size:.88rem}
img{width:100%;image-rendering:pixelated}
.scale img{height:.8rem}.ends{display:flex;justify-content:space-between}
svg{width:100%;height:auto;display:block;font-size:15px}
.saturated{background:#00c8ff;padding:0 .4rem}
</style>"""
_AGE = """<p class="note" id="late" hidden></p>
<script>
(function () {
  var age = Math.round((Date.now() - %d) / 1000), late = document.getElementById('late');
  if (age < %d) return;
  late.textContent = 'This page is ' + age + ' s old: the process that writes it has ended or ' +
    'waits. The recording does not depend on it.';
  late.hidden = false;
})();
</script>"""


@dataclass(frozen=True)
class LastShot:
    """The newest shot: counts (h, w) or (n, h, w), and its metadata."""

    image: NDArray[np.uint16]
    meta: dict[str, Any]


def stretched(image: NDArray[np.uint16]) -> tuple[NDArray[np.float64], float, float]:
    """Counts (h, w) as 0 to 1 between percentiles 1 and 99, which follow; 0 if all are equal."""
    low, high = (float(each) for each in np.percentile(image, (1.0, 99.0)))
    if high <= low:
        return np.zeros(image.shape), low, high
    return np.clip((image - low) / (high - low), 0.0, 1.0), low, high


def live_page(
    seen: Seen, shot: LastShot | None, *, over: bool, problem: str = "", epoch_s: float
) -> str:
    """The page as HTML.

    Args:
        over: True for the last page, which does not reload itself.
        problem: a line about what could not be read or written.
        epoch_s: time at which the page is made, seconds since 1970.
    """
    refresh = "" if over else f'<meta http-equiv="refresh" content="{_REFRESH_s}">\n'
    written = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(epoch_s))
    content: list[Block] = [_marked("alarm", f"MAY BE UNSAFE: {alarm}") for alarm in seen.alarms]
    if seen.state in ("stopped", "broken off"):
        content.append(
            _marked("note", "The recording is not complete. Run the same command to continue it.")
        )
    if problem:
        content.append(_marked("note", f"Some of this page could not be read: {problem}"))
    if not over:
        content.append(Html(_AGE % (round(1e3 * epoch_s), _LATE_s)))
    sections = [
        Section("Last shot", _shot(seen, shot) if shot else ["No shot yet."]),
        Section("Black body", _black_body(seen) or ["No reading yet."]),
        Section("Histogram", _histogram(shot) if shot else ["No shot yet."]),
    ]
    content += [
        _left(seen),
        _bar(seen),
        seen.doing,
        _marked("small", f"{seen.rejected} rejected, {seen.lost} lost. Page of {written}."),
        Html(f'<div class="grid">\n{html_of(sections)}\n</div>'),
    ]
    page = Page(
        f"{seen.done}/{seen.total} {seen.state}",
        content,
        heading=seen.state,
        head=refresh + _STYLE,
    )
    return page.html()


def _marked(name: str, text: str) -> Html:
    return Html(f'<p class="{name}">{escape(text)}</p>')


def _left(seen: Seen) -> str:
    if seen.plan is None:
        return "The recording has not begun."
    count = len(seen.plan.backgrounds_K)
    return (
        f"{left_text(seen.done, seen.total, seen.left_s)}, {count} "
        f"background{'s' if count != 1 else ''} in total."
    )


def _bar(seen: Seen) -> Html:
    share = 100 * seen.done / seen.total if seen.total else 0
    return Html(
        '<div class="bar" role="progressbar" aria-label="shots saved" aria-valuemin="0" '
        f'aria-valuemax="{seen.total}" aria-valuenow="{seen.done}">'
        f'<span style="width:{share:.2f}%"></span></div>'
    )


def _shot(seen: Seen, shot: LastShot) -> list[Block]:
    """First image of the shot, its colour scale, and what it is."""
    frames = shot.image.reshape(-1, *shot.image.shape[-2:])
    frame = frames[0]
    step = -(-max(frame.shape) // _MOST_PIXELS)
    small = frame[::step, ::step]
    shares, low, high = stretched(small)
    indices = (254.0 * shares).astype(np.uint8)
    # Saturated pixels are never omitted, even where the image is reduced.
    rows, columns = np.nonzero(frame >= int(shot.meta["saturation_counts"]))
    indices[rows // step, columns // step] = 255
    about = f"{shot.meta['background_setpoint_K']:g} K, {shot.meta['kind']}" if seen.last else ""
    size = f"{frame.shape[1]} x {frame.shape[0]} pixels"
    many = f", the first of {len(frames)} images" if len(frames) > 1 else ""
    moment = shot.meta["time"][:19].replace("T", " ")
    return [
        Html(
            f"{_image('last shot, in counts', _png(indices))}\n"
            f'<div class="scale">{_image("colour scale", _ramp())}\n'
            f'<div class="ends"><span>{low:.0f} counts</span><span><span class="saturated"></span>'
            f"&nbsp;saturated</span>\n<span>{high:.0f} counts</span></div></div>"
        ),
        f"{shot.meta['shot']}: {about}, {size}{many}.",
        _marked("small", f"{moment} UTC by the rig's clock; colours from percentile 1 to 99."),
    ]


def _black_body(seen: Seen) -> list[Block]:
    """Temperature over the session, and the distance from the present set point."""
    if seen.plan is None or not seen.readings:
        return []
    last, tolerance_K = seen.readings[-1], seen.plan.stability.tolerance_K
    approach = Approach(
        reading_K=last.reading_K, setpoint_K=last.setpoint_K, tolerance_K=tolerance_K
    )
    whole = _thinned(seen.readings)
    close = _thinned([each for each in seen.readings if each.setpoint_K == last.setpoint_K])
    return [
        str(approach),
        _curve(
            whole,
            [reading.reading_K for reading in whole],
            target=[reading.setpoint_K for reading in whole],
            name="temperature",
            about="temperature and set point over time",
        ),
        _marked("small", "Solid: temperature. Dashed: set point."),
        _curve(
            close,
            [reading.reading_K - reading.setpoint_K for reading in close],
            target=[0.0] * len(close),
            tolerance=tolerance_K,
            name="distance",
            about="distance from the set point over time, with the tolerance",
        ),
        _marked(
            "small",
            "Distance from the present set point, cut at ten tolerances; green: within the "
            "tolerance.",
        ),
    ]


def _histogram(shot: LastShot) -> list[Block]:
    full = int(shot.meta["saturation_counts"])
    found = exposure(shot.image, saturation_counts=full, bins=_BINS)
    most = np.log1p(max(int(found.pixels.max()), 1))
    wide = 576 / len(found.pixels)
    bars = []
    for number, count in enumerate(found.pixels):
        high = _BARS_HIGH * round(float(np.log1p(count) / most), 4)
        colour = "#b00020" if number == len(found.pixels) - 1 else "#3a6ea5"
        bars.append(
            f'<rect x="{number * wide:g}" y="{_BARS_HIGH - high:g}" width="{wide - 1:g}" '
            f'height="{high:g}" fill="{colour}"/>'
        )
    return [
        Html(
            '<svg viewBox="0 -4 576 172" role="img" '
            'aria-label="histogram of counts, logarithmic">\n' + "\n".join(bars) + "\n"
            f'<path d="M0 {_BARS_HIGH}H576" stroke="#444"/>\n<text x="0" y="160">0</text>\n'
            f'<text x="576" y="160" text-anchor="end">{full} counts: saturation</text>\n</svg>'
        ),
        f"{found.saturated_percent:.2g} % of the pixels are saturated; lowest {found.lowest}, "
        f"median {found.median:.0f}, highest {found.highest} counts.",
        _marked("small", "Heights are logarithmic. The last bar, in red, ends at saturation."),
    ]


def _image(about: str, png: str) -> str:
    return f'<img alt="{about}" src="data:image/png;base64,{png}">'


@lru_cache(maxsize=1)
def _palette() -> bytes:
    """256 colours: the map in 255 steps, and that of saturated pixels."""
    colours = matplotlib.colormaps[COLOURS](np.linspace(0.0, 1.0, 255), bytes=True)[:, :3]
    return np.vstack([colours, np.array([_SATURATED], np.uint8)]).astype(np.uint8).tobytes()


@lru_cache(maxsize=1)
def _ramp() -> str:
    """PNG of the colour scale, 255 pixels wide."""
    return _png(np.arange(255, dtype=np.uint8)[None, :])


def _png(indices: NDArray[np.uint8]) -> str:
    image = Image.fromarray(indices, mode="P")
    image.putpalette(_palette())
    stream = io.BytesIO()
    image.save(stream, format="PNG", compress_level=1)
    return b64encode(stream.getvalue()).decode("ascii")


def _thinned(readings: Sequence[Reading]) -> list[Reading]:
    """Readings thinned to at most `_POINTS`, with the last one."""
    step = -(-len(readings) // _POINTS)
    return list(readings[::-1][:: max(step, 1)][::-1])


def _curve(
    readings: Sequence[Reading],
    y: Sequence[float],
    *,
    target: Sequence[float],
    name: str,
    about: str,
    tolerance: float | None = None,
) -> Html:
    """SVG of `y` over the minutes of the session, with its target in steps.

    tolerance: half of the band around 0 that is marked; y is cut at ten times as much, so that a
    far beginning does not flatten the end.
    """
    x = [reading.time_s / 60.0 for reading in readings]
    shown, goal = np.asarray(y, np.float64), np.asarray(target, np.float64)
    ends = np.zeros(0)
    if tolerance is not None:
        shown = np.clip(shown, -10.0 * tolerance, 10.0 * tolerance)
        ends = np.array([-tolerance, tolerance])
    ends = np.concatenate([shown, goal, ends])
    low, high = float(ends.min()), float(ends.max())
    margin = 0.06 * (high - low) or 1.0
    low, high = low - margin, high + margin
    first, span = min(x), (max(x) - min(x)) or 1.0

    def across(value: float) -> float:
        return round(_WIDTH * (value - first) / span, 1)

    def down(value: float) -> float:
        return round(_HEIGHT * (high - value) / (high - low), 1)

    points = [(across(a), down(b)) for a, b in zip(x, shown.tolist(), strict=True)]
    steps = [(across(a), down(b)) for a, b in zip(x, goal.tolist(), strict=True)]
    line = "M" + " L".join(f"{a:g} {b:g}" for a, b in points)
    stairs = f"M{steps[0][0]:g} {steps[0][1]:g}" + "".join(f" V{b:g} H{a:g}" for a, b in steps)
    parts = [f'<svg viewBox="-72 -10 {_WIDTH + 92:g} {_HEIGHT + 60:g}" role="img" '
             f'aria-label="{about}">']  # fmt: skip
    if tolerance is not None:
        top, bottom = down(tolerance), down(-tolerance)
        parts.append(f'<rect x="0" y="{top}" width="{_WIDTH:g}" height="{bottom - top:g}" '
                     'fill="#cfe8cf"/>')  # fmt: skip
    for at, text in _ticks(low, high, down):
        parts.append(f'<path d="M0 {at}H{_WIDTH:g}" stroke="#e3e3e3"/>')
        parts.append(f'<text x="-6" y="{at + 4:g}" text-anchor="end">{text}</text>')
    for at, text in _ticks(first, first + span, across):
        parts.append(f'<path d="M{at} {_HEIGHT:g}v4" stroke="#444"/>')
        parts.append(f'<text x="{at}" y="{_HEIGHT + 18:g}" text-anchor="middle">{text}</text>')
    middle, foot = f'x="{_WIDTH / 2:g}" y="{_HEIGHT + 42:g}"', f"{_HEIGHT / 2:g}"
    parts += [
        f'<path d="M0 0V{_HEIGHT:g}H{_WIDTH:g}" stroke="#444" fill="none"/>',
        f'<path d="{stairs}" stroke="#b35900" stroke-dasharray="6 4" fill="none"/>',
        f'<path d="{line}" stroke="#1f4e8c" stroke-width="1.8" fill="none"/>',
        f'<circle cx="{points[-1][0]}" cy="{points[-1][1]}" r="3.5" fill="#1f4e8c"/>',
        f'<text {middle} text-anchor="middle">minutes since this session began</text>',
        f'<text x="-56" y="{foot}" text-anchor="middle" transform="rotate(-90 -56 {foot})">'
        f"{name} [K]</text>\n</svg>",
    ]
    return Html("\n".join(parts))


def _ticks(begin: float, end: float, place: Callable[[float], float]) -> list[tuple[float, str]]:
    inside = [v for v in MaxNLocator(6).tick_values(begin, end) if begin <= v <= end]
    return [(place(v), f"{v + 0.0:.10g}") for v in inside]
