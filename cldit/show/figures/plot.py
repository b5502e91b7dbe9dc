"""Figures and HTML of a run, an evaluation or a spray, for notebooks and scripts."""

import warnings
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cldit.acquisition.record import open_acquisition
from cldit.dit.maps import UNITS, Maps, Reason
from cldit.dit.profile import Profile, profile_of
from cldit.errors import EvaluationError, RunFolderError
from cldit.io.plain_data import parse_json
from cldit.run import Run
from cldit.show import page
from cldit.show.figures.colours import COUNTS, Scale
from cldit.show.figures.curves import (
    budget_figure,
    profile_figure,
    spectrum_figure,
)
from cldit.show.figures.maps import (
    error_maps_panels,
    errors_panels,
    frame_of,
    map_figure,
    map_legend,
    map_panels,
    reasons_in,
    spray_figure,
    spray_window,
    weights_panels,
)
from cldit.show.figures.onto import draw_map, draw_profile
from cldit.show.figures.panels import ImageFrame, Panel
from cldit.show.figures.readable import human_figures
from cldit.show.figures.style import SCREEN_DPI, png_of
from cldit.show.report.spray_report import views_figure
from cldit.spray.result import Spray

if TYPE_CHECKING:
    import xarray


def plot(
    of: "Run | Spray | Profile | xarray.Dataset",
    what: str = "maps",
    *,
    ax: Axes | None = None,
    **options: Any,
) -> Figure:
    """Draws a figure, which a notebook shows and `savefig` writes.

    Args:
        of: a run, a data set of `cldit.evaluate` or of one scene of a sweep, a spray, or a profile.
        what: of a run `maps`, `acquired`, `summary`, `errors`, `weights`, `budget`, `spectrum` or
            `profile`; of an evaluation `maps`, `errors`, `budget` or `profile`; of a spray `maps`,
            its masses from the side and from below; of a profile `profile`.
        ax: axes of another figure, which get T_app alone, or with `emissivity=True` the emissivity:
            of `maps` and `acquired` with vmin, vmax, cmap and window, of `profile`.
        options: of `maps` and `acquired` vmin, vmax, cmap (of T_app), scale, window and paper, as
            for `cldit.show.figures.maps.map_figure`; of `profile` start_m and angle_deg, as for
            `cldit.dit.profile.profile_of`.

    Returns:
        A matplotlib figure of print size; that of `ax`, if it is given.

    Raises:
        EvaluationError: there is no such figure of it.
    """
    if "range_K" in options:
        warnings.warn("plot: range_K is vmin and vmax now", DeprecationWarning, stacklevel=2)
        options["vmin"], options["vmax"] = options.pop("range_K")
    kinds = _OF_RUN if isinstance(of, Run) else _OF_EVALUATION
    if isinstance(of, Spray):
        kinds = {"maps": partial(views_figure, title="spray")}
    if isinstance(of, Profile):
        kinds = {"profile": partial(profile_figure, title="profile")}
    if what not in kinds:
        raise EvaluationError(f"plot: {what!r}; allowed: {', '.join(kinds)}")
    return kinds[what](of, **options) if ax is None else _onto(ax, of, what, **options)


def _onto(ax: Axes, of: Any, kind: str, **options: Any) -> Figure:
    """Draws one quantity into given axes; the figure that they belong to."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    quantity = {name: options.pop(name) for name in ("emissivity",) if name in options}
    if kind == "profile":
        profile = of if isinstance(of, Profile) else _profile_of(of, **options)
        draw_profile(ax, profile, **quantity)
        return figure
    if isinstance(of, Spray) or kind not in ("maps", "acquired"):
        raise EvaluationError(
            f"plot: ax with {kind!r}; allowed: maps, acquired or profile, of a run or an evaluation"
        )
    maps, frame, _ = _seen(of, kind)
    draw_map(ax, maps, frame, **quantity, **options)
    return figure


def _seen(of: "Run | xarray.Dataset", kind: str = "maps") -> tuple[Maps, ImageFrame, str]:
    """Maps (H, W) of a data set, or of a run as traced or as acquired; their frame and a title."""
    if not isinstance(of, Run):
        return *maps_of(of), str(of.attrs.get("title", "cldit")).removeprefix("cldit: ")
    if kind == "maps":
        return of.maps, frame_of(of.scene), of.scene.name
    if of.measured is None:
        raise RunFolderError(f"{of.scene.name}: has no acquisition; run it without --trace-only")
    return of.measured, frame_of(of.scene, sensor=True), f"{of.scene.name}: acquired"


def _maps(of: "Run | xarray.Dataset", kind: str = "maps", **options: Any) -> Figure:
    maps, frame, title = _seen(of, kind)
    return map_figure(maps, frame, **{"title": title, **options})


def _summary(run: Run) -> Figure:
    """One camera frame, and from all of them T_app, emissivity and the error of T_app."""
    maps, frame, _ = _seen(run, "acquired")
    if run.folder is None:
        raise RunFolderError(f"{run.scene.name}: is not stored; give `out` to simulate")
    stored = open_acquisition(run.folder / "acquisition")
    shots = [shot for shot in stored.shots if shot.kind == "injection"]
    shot = sorted(shots, key=lambda item: item.background_setpoint_K)[len(shots) // 2]
    background = f"background {shot.background_setpoint_K:g} K"
    scale = Scale.of([maps])
    raw = Panel(stored.load(shot), f"camera frame, {background}", "signal / counts", colours=COUNTS)
    panels = [raw, *map_panels(maps, scale), errors_panels(maps)[0]]
    reasons = reasons_in(maps, frame, spray_window(maps, frame))
    legend = map_legend(reasons, scale, paper=False)
    title = f"{run.scene.name}: simulated recording"
    return spray_figure(panels, maps, frame, title=title, legend=legend)


def _errors(of: "Run | xarray.Dataset") -> Figure:
    maps, frame, title = _seen(of)
    stated = isinstance(of, Run) and of.error_maps
    panels = error_maps_panels(stated) if stated else errors_panels(maps)
    return spray_figure(panels, maps, frame, title=f"{title}: standard errors")


def _weights(run: Run) -> Figure:
    title = f"{run.scene.name}: weights of the trace"
    return spray_figure(weights_panels(run.weights), run.maps, frame_of(run.scene), title=title)


def _budget(of: "Run | xarray.Dataset") -> Figure:
    if isinstance(of, Run):
        title, subject = of.scene.name, "error of T_app, RMS"
        hint = "states no error; set transport.audit: true in its scene"
        kelvin = {cause.name: cause.error_K for cause in of.errors.causes} if of.errors else {}
        total_K = of.errors.total_K if of.errors else None
    else:
        title, subject = _seen(of)[2], "budget of T_app, median pixel"
        hint = "has no budget (setup.uncertainty states it)"
        budget = parse_json(str(of.attrs.get("evaluation", "{}"))).get("budget") or {}
        kelvin = {name: part["apparent_temperature_K"] for name, part in budget.items()}
        total_K = kelvin.pop("total", None)
    if not kelvin:
        raise EvaluationError(f"{title}: {hint}")
    return budget_figure(kelvin, title=f"{title}: {subject}", total_K=total_K)


def _spectrum(run: Run) -> Figure:
    return spectrum_figure(run, title=f"{run.scene.name}: the filter")


def _profile(of: "Run | xarray.Dataset", **options: Any) -> Figure:
    return profile_figure(_profile_of(of, **options), title=f"{_seen(of)[2]}: along a plume")


def _profile_of(of: "Run | xarray.Dataset", **options: Any) -> Profile:
    if isinstance(of, Run):
        return of.profile(**options)
    maps, frame = maps_of(of)
    geometry = {"pixel_m": frame.pixel_m, "centre_m": frame.centre_m}
    return profile_of(maps, **{**geometry, **options})


_OF_EVALUATION: Mapping[str, Callable[..., Figure]] = {
    "maps": _maps,
    "errors": _errors,
    "budget": _budget,
    "profile": _profile,
}
_OF_RUN: Mapping[str, Callable[..., Figure]] = {
    "maps": _maps,
    "acquired": partial(_maps, kind="acquired"),
    "summary": _summary,
    "errors": _errors,
    "weights": _weights,
    "budget": _budget,
    "spectrum": _spectrum,
    "profile": _profile,
}


def maps_of(data: "xarray.Dataset") -> tuple[Maps, ImageFrame]:
    """Maps (H, W) and their frame, from a data set of `cldit.evaluate`, `Run.to_xarray`, or of one
    scene of a sweep, which has neither reasons nor a goodness of fit.

    Raises:
        EvaluationError: the data set has no maps, or those of several scenes.
    """
    if missing := [name for name in ("apparent_temperature_K", "emissivity") if name not in data]:
        raise EvaluationError(f"plot: the data set has no {', '.join(missing)}")
    warm = data["apparent_temperature_K"]
    if axes := [str(name) for name in warm.dims if name not in ("x", "z")]:
        raise EvaluationError(
            f"plot: the maps have the axes {', '.join(axes)}; allowed: one scene, by data.sel(..)"
        )
    finite = np.isfinite(warm.values)
    absent: dict[str, Any] = {
        "reason": np.where(finite, Reason.OK, Reason.EMISSIVITY_TOO_LOW).astype(np.uint8)
    }
    nothing = np.full(finite.shape, np.nan, np.float32)
    maps = Maps(
        **{name: data[name].values if name in data else absent.get(name, nothing) for name in UNITS}
    )
    x, z = (1e-3 * np.asarray(data[name].values, float) for name in ("x", "z"))
    pixel_m = (_step(x), _step(z))
    return maps, ImageFrame(pixel_m, (float(x.mean()), float(z.mean())))


def _step(places_m: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(abs(places_m[-1] - places_m[0]) / max(len(places_m) - 1, 1)) or 1e-3


def html_of(result: Run | Spray | Profile) -> str:
    """HTML that a notebook shows of a result: figures and a table."""
    if isinstance(result, Profile):
        figure = plot(result, "profile")
        return _html("profile", [_image(figure, "T_app and emissivity along a line")], {})
    if isinstance(result, Spray):
        figures = [_image(plot(result), "mass per area of droplets and vapour")]
        return _html("spray", figures, human_figures(result.notes))
    figures = [_image(plot(result), "apparent temperature and emissivity")]
    if result.measured is not None:
        figures.append(_image(plot(result, "acquired"), "acquired by the rig"))
    rows = {reason.text: f"{count} pixels" for reason, count in result.maps.count().items()}
    if result.errors is not None:
        rows["error of T_app, RMS"] = result.errors.text
        rows |= {f"of it by {cause.name}": cause.text for cause in result.errors.causes}
    rows["device"] = result.info.device
    rows["time"] = f"{sum(stage.seconds for stage in result.info.stages):.3g} s"
    if result.folder is not None:
        rows["folder"] = str(result.folder)
    return _html(result.scene.name, figures, rows)


def _html(title: str, figures: Sequence[str], rows: Mapping[str, str]) -> str:
    return f"<h4>{escape(title)}</h4>{''.join(figures)}{page.html_of([page.Table.pairs(rows)])}"


def _image(figure: Figure, about: str) -> str:
    data = b64encode(png_of(figure, dpi=SCREEN_DPI)).decode("ascii")
    return f'<img alt="{escape(about)}" style="max-width:100%" src="data:image/png;base64,{data}">'
