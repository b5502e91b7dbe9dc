"""What the shots say of their own evaluation: witnesses, drift terms and budget, as part of a page.

All of it is read from the folder of the maps, so that a page can be made later, of any evaluation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cldit.dit.budget import PARTS, part_file
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.io.files import write_text
from cldit.io.images import read_image
from cldit.io.plain_data import read_json
from cldit.show.figures.panels import Frame, Panel, panels_picture
from cldit.show.figures.pictures import errors_picture, map_picture
from cldit.show.report.html import EvaluationContent, Picture, Table, render

PAGE = "report.html"
STORED = "evaluation.json"
_SEEN_K = 1e-6  # below it a cause drops out of the equation, and rounding is left
_SETPOINT = "{:g} K"
_WHAT = {  # of the budget's maps
    "apparent_temperature_systematic_error_K": ("systematic error of apparent temperature", "K"),
    "apparent_temperature_total_error_K": ("total error of apparent temperature", "K"),
    "emissivity_systematic_error": ("systematic error of emissivity", ""),
    "emissivity_total_error": ("total error of emissivity", ""),
}


def evaluation_content(maps: Path, frame: Frame, *, title: str) -> EvaluationContent:
    """What is stored of an evaluation.

    Args:
        maps: folder of its maps.
        frame: axes of the pictures.
        title: of the pictures.

    Returns:
        Nothing but empty parts where the folder was written before there were such files.

    Raises:
        RunFolderError: a file is damaged.
    """
    place = maps / STORED
    if not place.is_file():
        return EvaluationContent()
    stored = read_json(place)
    try:
        return _content(stored, maps, frame, title)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RunFolderError(f"{place}: is damaged ({error}); evaluate the shots again") from error


def _content(stored: Any, maps: Path, frame: Frame, title: str) -> EvaluationContent:
    witnesses = stored.get("witnesses", [])
    in_kelvin = [one for one in witnesses if one.get("setpoints")]
    parts = stored.get("budget") or {}
    return EvaluationContent(
        remarks=tuple(stored["remarks"]),
        findings=tuple(
            f"{one['name']}: {one.get('says') or one['text']}"
            for one in witnesses
            if one["stands_out"]
        ),
        witnesses=_by_background(
            "witness",
            [
                (one["compared"], one["setpoints"], _with_noise(one), one["says"] or "nothing")
                for one in in_kelvin
            ],
            last="what it names",
        ),
        others=tuple(
            one["text"] for one in witnesses if not one.get("setpoints") and not one["stands_out"]
        ),
        improbable=_improbable(stored),
        drifts=_by_background(
            "term",
            [
                (one["name"], one["setpoints"], [f"{k:+.3f} K" for k in one["kelvin"]])
                for one in stored.get("drifts", [])
            ],
        ),
        drift_axis=str(stored.get("drift_axis", "")),
        budget=_budget(parts),
        pictures=_pictures(list(parts), maps, frame, title),
    )


def _with_noise(witness: Mapping[str, Any]) -> list[str]:
    return [
        f"{kelvin:+.2f} ± {noise:.2f} K"
        for kelvin, noise in zip(witness["kelvin"], witness["noise_K"], strict=True)
    ]


def _by_background(first: str, rows: Sequence[tuple[Any, ...]], *, last: str = "") -> Table:
    """Columns by background: (name, set points, cells), and a last one where it has a title."""
    if not rows:
        return [], []
    titles = [first, *(_SETPOINT.format(k) for k in rows[0][1]), *([last] if last else [])]
    return titles, [[name, *cells, *more] for name, _, cells, *more in rows]


def _improbable(stored: Mapping[str, Any]) -> str:
    share = stored.get("improbable_share")
    if share is None:
        return ""
    return (
        f"{100.0 * share:.2g} % of the pixels have a fit_probability below 0.001; chance gives "
        "0.1 %."
    )


def _budget(parts: Mapping[str, Any]) -> Table:
    rows = [
        [name, f"{one['apparent_temperature_K']:.2g} K", f"{one['emissivity']:.1g}"]
        for name, one in parts.items()
        if one["apparent_temperature_K"] is not None and one["emissivity"] is not None
    ]
    return (["cause, by so much", "T_app", "emissivity"], rows) if rows else ([], [])


def _pictures(names: Sequence[str], maps: Path, frame: Frame, title: str) -> tuple[Picture, ...]:
    """Systematic and total errors; and what each part does to the apparent temperature."""
    panels = [
        Panel(read_image(path)[0], text, unit, colours="viridis")
        for name, (text, unit) in _WHAT.items()
        if (path := maps / f"{name}.tif").is_file()
    ]
    single = [
        Panel(image, name, "K", colours="viridis")
        for name in names
        if (path := maps / f"{part_file(name, 'K')}.tif").is_file()
        and np.nanmax(np.abs(image := read_image(path)[0]), initial=0.0) > _SEEN_K
    ]
    drawn = [
        (panels, "budget", f"Root of the sum of the squares of all parts, and with the statistical "
         f"error. A map of each part is in {maps.name}/{PARTS}."),
        (single, "T_app by cause", "Change of the apparent temperature by each cause alone."),
    ]  # fmt: skip
    return tuple(
        Picture(panels_picture(some, frame, title=f"{title}: {what}"), caption)
        for some, what, caption in drawn
        if some
    )


def write_evaluation_page(maps: Path, frame: Frame, *, title: str) -> Path:
    """Writes the page of an evaluation beside its maps.

    Args:
        maps: folder of its maps.
        frame: axes of the pictures.
        title: of page and pictures.

    Returns:
        The page's path.

    Raises:
        RunFolderError: a file is missing or damaged.
    """
    drawn = Maps.load(maps)
    text = render(
        "evaluation.html",
        title=title,
        maps=(
            Picture(
                map_picture(drawn, frame, title=title),
                "Hue is the apparent temperature, saturation the emissivity.",
            ),
            Picture(
                errors_picture(drawn, frame, title=f"{title}: standard errors"),
                "Standard errors, with what the witnesses found.",
            ),
        ),
        evaluation=evaluation_content(maps, frame, title=title),
        reasons={reason.text: count for reason, count in drawn.count().items()},
    )
    write_text(maps / PAGE, text)
    return maps / PAGE
