"""Pictures of runs, evaluations and sprays, as figures; what a notebook shows of them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.patches import Rectangle

import cldit
from cldit.accuracy.errors import Cause, Errors
from cldit.errors import ClditError, EvaluationError
from cldit.gpu.device import open_device
from cldit.prepare.spray_factory import make_spray
from cldit.run import Run, open_run
from cldit.scene.spray import ConeSpray
from cldit.show.figures.maps import frame_of, spray_window
from cldit.spray.result import Spray

WRITTEN = Path(__file__).parents[3] / "data" / "run-0.1.0"


@pytest.fixture(scope="module")
def run() -> Run:
    return open_run(WRITTEN)


@pytest.fixture(scope="module")
def spray() -> Spray:
    return make_spray(ConeSpray(), open_device())


@pytest.mark.parametrize(
    ("what", "labels"),
    [
        ("maps", {"x / mm", "z / mm"}),
        ("acquired", {"x / mm", "z / mm"}),
        ("errors", {"x / mm", "z / mm"}),
        ("weights", {"x / mm", "z / mm"}),
        ("spectrum", {"wavelength / µm"}),
        ("profile", {"distance from the start / mm", "apparent temperature / K", "emissivity"}),
    ],
)
def test_pictures_of_a_run(run: Run, what: str, labels: set[str]) -> None:
    figure = run.plot(what)
    found = {text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())}
    assert labels <= found
    assert run.scene.name in " ".join([figure.get_suptitle(), figure.axes[0].get_title()])


def test_maps_are_those_of_the_run(run: Run) -> None:
    figure = run.plot("errors")
    [axes] = [each for each in figure.axes if each.images and len(each.texts) == 2]
    shown = axes.images[-1].get_array()
    assert shown is not None
    values = np.ma.filled(shown, np.nan)
    frame = frame_of(run.scene)
    part = frame.slices(run.maps.reason.shape, spray_window(run.maps, frame))
    np.testing.assert_allclose(values, run.maps.emissivity_standard_error[part])


@pytest.mark.parametrize("emissivity", [False, True])
def test_one_quantity_goes_into_other_axes(run: Run, emissivity: bool) -> None:
    figure, (left, right) = pyplot.subplots(1, 2)
    try:
        assert run.plot(ax=left, emissivity=emissivity) is figure
        profile = run.profile()
        assert profile.plot(ax=right, emissivity=emissivity) is figure
        label = "emissivity" if emissivity else "apparent temperature / K"
        assert right.get_ylabel() == label and label in {one.get_ylabel() for one in figure.axes}
        values = run.maps.emissivity if emissivity else run.maps.apparent_temperature_K
        image = left.images[0]
        np.testing.assert_allclose(np.ma.filled(image.get_array(), np.nan), values)
        assert tuple(image.get_extent()) == frame_of(run.scene).extent_mm(values.shape)
        shown = profile.emissivity if emissivity else profile.apparent_temperature_K
        np.testing.assert_allclose(right.lines[0].get_ydata(), shown)
        np.testing.assert_allclose(right.lines[0].get_xdata(), 1e3 * profile.distance_m)
        with pytest.raises(EvaluationError, match="ax with 'budget'; allowed: maps, acquired"):
            run.plot("budget", ax=left)
    finally:
        pyplot.close(figure)


def test_a_profile_shows_itself(run: Run) -> None:
    profile = run.profile()
    assert {"emissivity", "apparent temperature / K"} <= {
        each.get_ylabel() for each in profile.plot().axes
    }
    assert "data:image/png" in profile._repr_html_() and "points over" in repr(profile)


def test_budget_has_a_bar_a_cause() -> None:
    from cldit.show.figures.curves import budget_figure

    errors = Errors((Cause("trace", 0.5, ""), Cause("cells", 1.5, ""), Cause("parcels", None, "")))
    kelvin = {cause.name: cause.error_K for cause in errors.causes}
    axes = budget_figure(kelvin, title="a", total_K=errors.total_K).axes[0]
    bars = [bar for bar in axes.patches if isinstance(bar, Rectangle)]
    assert [bar.get_width() for bar in bars] == [0.5, 1.5, 0.0]
    assert [text.get_text() for text in axes.texts] == ["0.5 K", "1.5 K", "unknown"]


def test_what_is_not_there_is_named(run: Run) -> None:
    with pytest.raises(
        EvaluationError, match="plot: 'map'; allowed: maps, acquired, summary, errors"
    ):
        run.plot("map")
    if run.errors is None:
        with pytest.raises(ClditError, match="states no error"):
            run.plot("budget")


def test_a_labelled_run_has_the_same_pictures(run: Run) -> None:
    pytest.importorskip("xarray", reason="the extra studies is not installed")
    data = run.to_xarray()
    ours, theirs = cldit.plot(run, "profile"), cldit.plot(data, "profile")
    for one, other in zip(ours.axes, theirs.axes, strict=True):
        a, b = (np.asarray(each.lines[0].get_ydata(), np.float64) for each in (one, other))
        np.testing.assert_allclose(a, b)
    assert cldit.plot(data).axes[0].get_xlabel() == "x / mm"
    with pytest.raises(EvaluationError, match="has no budget"):
        cldit.plot(data, "budget")
    sweep = data[["apparent_temperature_K", "emissivity"]].expand_dims({"walls.temperature_K": [4]})
    seen = cldit.plot(sweep.isel({"walls.temperature_K": 0}))
    assert len(seen.axes) == len(cldit.plot(data).axes)
    with pytest.raises(EvaluationError, match=r"axes walls\.temperature_K; allowed: one"):
        cldit.plot(sweep)


def test_short_in_a_notebook(run: Run, spray: Spray) -> None:
    """All of a run on one line; 12,600 characters before."""
    assert re.fullmatch(r"<Run 'old': <Maps: 12 x 10 pixels, .* K>.*>", repr(run))
    for thing in (run, run.maps, run.weights, spray):
        assert len(repr(thing)) < 250 and "array(" not in repr(thing)
    assert re.search(r"parcels of .* mg; \d+ cells with .* mg of vapour", repr(spray))


def test_html_has_pictures_and_figures_and_no_address(run: Run, spray: Spray) -> None:
    html = run._repr_html_()
    assert html.count("data:image/png;base64,") == 2  # the trace and what the rig acquired
    assert "evaluated" in html and "old" in html and "http" not in html
    assert spray._repr_html_().count("<img") == 1
    figure = run.plot()
    png = figure._repr_png_()  # type: ignore[attr-defined]
    assert png[:8] == b"\x89PNG\r\n\x1a\n"


def test_colours_are_chosen_as_in_matplotlib(run: Run) -> None:
    """vmin, vmax and cmap, in a figure of its own and in other axes; an end may be left out."""
    (left, *_) = run.plot(vmin=300.0, vmax=600.0, cmap="cividis").axes
    assert left.images[-1].get_clim() == (300.0, 600.0)
    assert left.images[-1].get_cmap().name == "cividis"
    figure, axes = pyplot.subplots()
    try:
        run.plot(ax=axes, vmin=310.0, cmap="magma")
        low, high = axes.images[0].get_clim()
        assert low == 310.0 and high > 310.0 and axes.images[0].get_cmap().name == "magma"
        with pytest.raises(EvaluationError, match="vmin 600 K, vmax 300 K; allowed: vmin below"):
            run.plot(vmin=600.0, vmax=300.0)
        with pytest.warns(DeprecationWarning, match="range_K is vmin and vmax"):
            run.plot(range_K=(300.0, 600.0))
    finally:
        pyplot.close(figure)
