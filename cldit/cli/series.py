"""What `cldit run --times` prints at its end."""

from __future__ import annotations

from rich.table import Table

from cldit.api.series import Series
from cldit.cli.as_json import Outcome
from cldit.cli.console import ERR, OUT, escaped
from cldit.cli.exit_codes import Exit
from cldit.show.figures.film import mp4_possible

_SHOWN = (
    ("liquid_mass_kg", "liquid, mg", 1e6),
    ("vapour_mass_kg", "vapour, mg", 1e6),
    ("liquid_penetration_95_m", "liquid (95 %) to, mm", 1e3),
    ("vapour_penetration_m", "vapour to, mm", 1e3),
)


def series_outcome(series: Series) -> Outcome:
    """Prints a line a time and the files; the status says whether a time of the `series` is bad,
    which is named."""
    table = Table("time", *(text for _, text, _ in _SHOWN), "T_app, K", "", box=None)
    for each in series.times:
        row = [_number(each.spray.get(name), factor) for name, _, factor in _SHOWN]
        warm = None if each.dit is None else each.dit.apparent_temperature_K
        note = "" if each.state == "done" else each.state
        table.add_row(series.plan.text(each.time), *row, _number(warm, 1.0), note)
    OUT.print(table)
    for path in series.files:
        OUT.print(str(path))
    if series.files and not mp4_possible():
        OUT.print(escaped('(film.mp4 too with pip install "cldit[film]")'), style="dim")
    for each in series.failed:
        text = f"{series.plan.text(each.time)}: {each.problem}"
        ERR.print(f"[bold red]error:[/] {escaped(text)}")
    times = [
        {
            "time": series.plan.text(each.time),
            "state": each.state,
            "folder": each.folder,
            "problem": each.problem,
            "spray": each.spray,
        }
        for each in series.times
    ]
    code = Exit.FAILED if series.failed else Exit.DONE
    return Outcome({"times": times, "files": series.files}, code)


def _number(value: float | None, factor: float) -> str:
    return "" if value is None or value != value else f"{factor * value:.4g}"
