"""What a notebook shows of a run or a spray: a picture, and the figures beside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape

from cldit.run import Run
from cldit.show.figures.figures import human_figures
from cldit.show.figures.plot import plot
from cldit.show.figures.sheet import png_of
from cldit.spray.result import Spray


def html_of(result: Run | Spray) -> str:
    """HTML of a result: its figures and a table."""
    return run_html(result) if isinstance(result, Run) else spray_html(result)


def run_html(run: Run) -> str:
    """The maps of a run, its pixels, and the budget of its error, as HTML."""
    pictures = _picture(png_of(plot(run)), "apparent temperature and emissivity")
    if run.measured is not None:
        pictures += _picture(png_of(plot(run, "acquired")), "what the rig acquired")
    rows = {reason.text: f"{count} pixels" for reason, count in run.maps.count().items()}
    if run.errors is not None:
        rows["error of T_app, RMS"] = run.errors.text
        rows |= {f"of it by {cause.name}": cause.text for cause in run.errors.causes}
    rows["device"] = run.info.device
    rows["time"] = f"{sum(stage.seconds for stage in run.info.stages):.3g} s"
    if run.folder is not None:
        rows["folder"] = str(run.folder)
    return f"<h4>{escape(run.scene.name)}</h4>{pictures}{_table(rows)}"


def spray_html(spray: Spray) -> str:
    """A spray's masses from the side and from below, and its figures, as HTML."""
    picture = _picture(png_of(plot(spray)), "mass per area of droplets and vapour")
    return f"<h4>spray</h4>{picture}{_table(human_figures(spray.notes))}"


def _picture(png: bytes, about: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="{escape(about)}" style="max-width:48%" src="data:image/png;base64,{data}">'


def _table(rows: Mapping[str, str]) -> str:
    cells = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(text)}</td></tr>" for name, text in rows.items()
    )
    return f"<table>{cells}</table>"
