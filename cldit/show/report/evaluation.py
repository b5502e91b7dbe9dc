"""Page of an evaluation: maps, witnesses, drift, uncertainty budget.

All of it is read from the folder of the maps, so the page can be made later, of any evaluation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cldit.dit.budget import PARTS, part_file
from cldit.dit.maps import Maps, Reason
from cldit.errors import RunFolderError
from cldit.io.images import read_image
from cldit.io.plain_data import read_json
from cldit.show.figures.maps import (
    change_panel,
    error_panel,
    errors_panels,
    map_figure,
    spray_figure,
)
from cldit.show.figures.panels import ImageFrame
from cldit.show.figures.style import SCREEN_DPI
from cldit.show.page import Block, Bullets, Figure, Page, Section, Table, write_page

PAGE = "report.html"
STORED = "evaluation.json"
_IMPROBABLE = "{:.2g} % of the pixels have a fit_probability below 0.001; chance gives 0.1 %."
_TOTALS = {
    "apparent_temperature_systematic_error_K": "systematic error of T_app",
    "apparent_temperature_total_error_K": "total error of T_app",
    "emissivity_systematic_error": "systematic error of emissivity",
    "emissivity_total_error": "total error of emissivity",
}


def evaluation_sections(maps: Path, frame: ImageFrame, *, title: str) -> list[Section]:
    """Sections on the stored evaluation in the folder `maps`; none for folders of old versions."""
    place = maps / STORED
    if not place.is_file():
        return []
    stored = read_json(place)
    try:
        return _sections(stored, maps, frame, title)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RunFolderError(f"{place}: is damaged ({error}); evaluate the shots again") from error


def _sections(stored: Any, maps: Path, frame: ImageFrame, title: str) -> list[Section]:
    parts = stored.get("budget") or {}
    drifts = _by_background(
        "term",
        [
            (drift["name"], drift["setpoints"], [f"{k:+.3f} K" for k in drift["kelvin"]])
            for drift in stored.get("drifts", [])
        ],
    )
    budget = _budget(parts)
    return [
        Section("Consistency of the shots", _witnesses(stored), folded=True),
        Section(
            "Drift that references and injections share",
            [
                str(stored.get("drift_axis", "")),
                "Terms of the fit's covariance, in kelvin of the black body. A steady drift has "
                "its sign; the others are standard deviations." if drifts.rows else "",
                drifts,
            ],
            folded=True,
        ),
        Section(
            "Uncertainty budget: errors that no shot shows",
            [
                "Medians over the evaluated pixels:" if budget.rows else "",
                budget,
                *_error_figures(list(parts), maps, frame, title),
            ],
            folded=True,
        ),
    ]  # fmt: skip


def _witnesses(stored: Mapping[str, Any]) -> list[Block]:
    witnesses = stored.get("witnesses", [])
    share = stored.get("improbable_share")
    in_kelvin = [witness for witness in witnesses if witness.get("setpoints")]
    rest = [row for row in witnesses if not row.get("setpoints") and not row["stands_out"]]
    table = _by_background(
        "witness",
        [
            (row["compared"], row["setpoints"], _with_noise(row), row["says"] or "none detected")
            for row in in_kelvin
        ],
        last_title="finding",
    )
    return [
        Bullets(
            [
                f"{witness['name']}: {witness.get('says') or witness['text']}"
                for witness in witnesses
                if witness["stands_out"]
            ]
        ),
        "Each witness in kelvin of the black body, with its noise:" if table.rows else "",
        table,
        *(witness["text"] for witness in rest),
        "" if share is None else _IMPROBABLE.format(100.0 * share),
        *stored["remarks"],
    ]


def _with_noise(witness: Mapping[str, Any]) -> list[str]:
    return [
        f"{kelvin:+.2f} ± {noise:.2f} K"
        for kelvin, noise in zip(witness["kelvin"], witness["noise_K"], strict=True)
    ]


def _by_background(title: str, rows: Sequence[tuple[Any, ...]], *, last_title: str = "") -> Table:
    """Table with a column for each background; rows: (name, set points, cells, last cell)."""
    if not rows:
        return Table((), ())
    columns = [f"{kelvin:g} K" for kelvin in rows[0][1]]
    titles = [title, *columns, *([last_title] if last_title else [])]
    return Table(titles, [[name, *cells, *last_cells] for name, _, cells, *last_cells in rows])


def _budget(parts: Mapping[str, Any]) -> Table:
    rows = [
        [name, f"{part['apparent_temperature_K']:.2g} K", f"{part['emissivity']:.1g}"]
        for name, part in parts.items()
        if part["apparent_temperature_K"] is not None and part["emissivity"] is not None
    ]
    return Table(["part and its size", "T_app", "emissivity"], rows)


def _error_figures(names: Sequence[str], maps: Path, frame: ImageFrame, title: str) -> list[Figure]:
    """Systematic and total errors; and the change of T_app by each part alone."""
    shown = Maps.load(maps)
    thin = shown.reason == Reason.EMISSIVITY_TOO_LOW
    totals = [
        error_panel(read_image(path)[0], title, "error / K", decades="total" in title, clear=thin)
        if name.endswith("_K")
        else error_panel(read_image(path)[0], title, "error")
        for name, title in _TOTALS.items()
        if (path := maps / f"{name}.tif").is_file()
    ]
    single = [
        replace(change_panel(image, name.replace(" um", " µm"), "change / K"), clear=thin)
        for name in names
        if (path := maps / f"{part_file(name, 'K')}.tif").is_file()
        and np.nanmax(np.abs(image := read_image(path)[0]), initial=0.0)
        > 1e-6  # else rounding: it cancels
    ]
    drawn = [
        (totals, "budget", f"Root of the sum of the squares of all parts, and with the statistical "
         f"error. A map of each part is in {maps.name}/{PARTS}."),
        (single, "T_app by cause", "Change of the apparent temperature by each cause alone."),
    ]  # fmt: skip
    return [
        Figure.of(spray_figure(panels, shown, frame, title=f"{title}: {subject}"), caption,
                  dpi=SCREEN_DPI)
        for panels, subject, caption in drawn
        if panels
    ]  # fmt: skip


def pixels_section(maps: Maps) -> Section:
    """Number and share of pixels by the reason why they have a value or none."""
    count = {reason.text: number for reason, number in maps.count().items()}
    total = max(sum(count.values()), 1)
    rows = [[name, str(n), f"{100 * n / total:.1f} %"] for name, n in count.items()]
    return Section("Pixels", [Table((), rows, numbers=(1, 2))], folded=True)


def write_evaluation_page(maps: Path, frame: ImageFrame, *, title: str) -> Path:
    """Writes the page of an evaluation beside its maps and returns the page's path."""
    drawn = Maps.load(maps)
    errors = spray_figure(errors_panels(drawn), drawn, frame, title=f"{title}: standard errors")
    figures = [
        Figure.of(map_figure(drawn, frame, title=title), "Apparent temperature and emissivity."),
        Figure.of(errors, "Standard errors, including what the witnesses found."),
    ]
    content = [
        Section("Emissivity and apparent temperature", figures),
        *evaluation_sections(maps, frame, title=title),
        pixels_section(drawn),
    ]
    return write_page(Page(title, content), maps / PAGE)
