"""Page `live.html` of a recording in progress: what it does, what is left, and one figure."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawn
from numpy.typing import NDArray

from cldit.acquisition.progress import Approach, left_text
from cldit.acquisition.quality import Exposure, exposure
from cldit.acquisition.watch import Reading, Seen
from cldit.show.figures.colours import COUNTS, robust_limits
from cldit.show.figures.style import SCREEN_DPI, WIDTH_IN, figure_of, finish, png_of, styled
from cldit.show.page import Block, Figure, Html, Page

_SATURATED = "#00c8ff"  # a colour that the map does not have
_BINS = 96
_POINTS = round(WIDTH_IN * SCREEN_DPI)  # of a curve: the figure has no more columns
_LATE_s = 20  # age from which the page itself says that it is old
_REFRESH_s = 2
_STYLE = """<style>
h1{margin:.8rem 0 .2rem}p{margin:.2rem 0}
.bar{background:#ddd;height:1.1rem;margin:.4rem 0}
.bar span{display:block;background:#3a6ea5;height:100%}
.alarm{background:#b00020;color:#fff;padding:.5rem .8rem;white-space:pre-wrap}
.note{background:#fff3cd;padding:.5rem .8rem}
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

    @property
    def frames(self) -> NDArray[np.uint16]:
        """Counts (n, h, w) of all images."""
        return self.image.reshape(-1, *self.image.shape[-2:])

    @property
    def saturation_counts(self) -> int:
        """Counts from which a pixel is saturated."""
        return int(self.meta["saturation_counts"])


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
    content += [
        _left(seen),
        _bar(seen),
        seen.doing,
        *(_shot_lines(shot) if shot else ["No shot yet."]),
        *(_black_body_lines(seen) or ["No reading of the black body yet."]),
        f"{seen.rejected} rejected, {seen.lost} lost. Page of {written}.",
    ]
    if shot is not None or seen.readings:
        png = png_of(live_figure(seen, shot), dpi=SCREEN_DPI)
        content.append(Figure(png, "Last shot, its histogram, and the black body over time."))
    title = f"{seen.done}/{seen.total} {seen.state}"
    return Page(title, content, heading=seen.state, head=refresh + _STYLE).html()


def _marked(name: str, message: str) -> Html:
    return Html(f'<p class="{name}">{escape(message)}</p>')


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


def _shot_lines(shot: LastShot) -> list[str]:
    """Sentences on the last shot and its exposure."""
    count, rows, columns = shot.frames.shape
    images_note = f", the first of {count} images" if count > 1 else ""
    levels = _exposure(shot)
    return [
        f"{shot.meta['shot']}: {shot.meta['background_setpoint_K']:g} K, {shot.meta['kind']}, "
        f"{columns} x {rows} pixels{images_note}, {shot.meta['time'][:19].replace('T', ' ')} UTC.",
        f"{levels.saturated_percent:.2g} % of the pixels are saturated; lowest {levels.lowest}, "
        f"median {levels.median:.0f}, highest {levels.highest} counts.",
    ]


def _exposure(shot: LastShot) -> Exposure:
    return exposure(shot.image, saturation_counts=shot.saturation_counts, bins=_BINS)


def _black_body_lines(seen: Seen) -> list[str]:
    if seen.plan is None or not seen.readings:
        return []
    latest = seen.readings[-1]
    tolerance_K = seen.plan.stability.tolerance_K
    kelvin = {"reading_K": latest.reading_K, "setpoint_K": latest.setpoint_K}
    return [str(Approach(**kelvin, tolerance_K=tolerance_K))]


@styled
def live_figure(seen: Seen, shot: LastShot | None) -> Drawn:
    """Figure of the last shot, its histogram, and the black body; axes without data are empty."""
    figure = figure_of(WIDTH_IN, 5.2)
    (image, counts), (trend, close) = figure.subplots(2, 2)
    if shot is not None:
        _draw_shot(image, shot)
        _draw_histogram(counts, shot)
    if seen.plan is not None and seen.readings:
        _draw_readings(trend, close, seen.readings, seen.plan.stability.tolerance_K)
    for axes in (image, counts, trend, close):
        if not axes.has_data():
            axes.set_axis_off()
    return figure


def _draw_shot(axes: Axes, shot: LastShot) -> None:
    frame = shot.frames[0]
    step = -(-2 * max(frame.shape) // _POINTS)  # an image has half of the figure's width
    small = frame[::step, ::step].astype(np.float64)
    limits = robust_limits(small, cut=1.0)
    # Saturated pixels are never omitted, even where the image is reduced.
    rows, columns = np.nonzero(frame >= shot.saturation_counts)
    saturated = np.full(small.shape, np.nan)
    saturated[rows // step, columns // step] = 1.0
    drawn = axes.imshow(small, COUNTS, vmin=limits[0], vmax=limits[1], interpolation="nearest")
    axes.imshow(saturated, matplotlib.colors.ListedColormap([_SATURATED]), interpolation="nearest")
    axes.set(title=f"{shot.meta['shot']}; saturated: light blue", xticks=[], yticks=[])
    axes.figure.colorbar(drawn, ax=axes, label="counts", extend="both")


def _draw_histogram(axes: Axes, shot: LastShot) -> None:
    levels = _exposure(shot)
    edges = np.linspace(0.0, levels.saturation_counts, _BINS + 1)
    axes.stairs(levels.pixels, edges, fill=True, color="C0")
    axes.stairs(levels.pixels[-1:], edges[-2:], fill=True, color="#b00020")
    axes.set(title="histogram; saturated: red", xlabel="counts", ylabel="pixels")
    axes.set(yscale="symlog", xlim=(0.0, levels.saturation_counts))


def _draw_readings(
    trend: Axes, close: Axes, readings: Sequence[Reading], tolerance_K: float
) -> None:
    """Temperature over the session, and the distance from the present set point."""
    latest = readings[-1]
    present = _thinned([reading for reading in readings if reading.setpoint_K == latest.setpoint_K])
    session = _thinned(readings)
    minutes = [reading.time_s / 60.0 for reading in session]
    trend.plot(minutes, [reading.reading_K for reading in session], color="C0", label="black body")
    setpoints = [reading.setpoint_K for reading in session]
    trend.step(minutes, setpoints, where="post", color="C1", ls="--", label="set point")
    away_K = np.array([reading.reading_K - reading.setpoint_K for reading in present])
    most_K = 10.0 * tolerance_K  # farther away, the approach hides how it settles
    close.axhspan(-tolerance_K, tolerance_K, color="#cfe8cf", lw=0, label="tolerance")
    times_min = [reading.time_s / 60.0 for reading in present]
    close.plot(times_min, np.clip(away_K, -most_K, most_K), color="C0")
    for axes, label in ((trend, "temperature / K"), (close, "distance from the set point / K")):
        finish(axes, "minutes since this session began", label, legend=True)


def _thinned(readings: Sequence[Reading]) -> list[Reading]:
    """Readings thinned to at most `_POINTS`, with the last one."""
    step = -(-len(readings) // _POINTS)
    return list(readings[::-1][:: max(step, 1)][::-1])
