"""Findings follow their numbers; the page of them is whole."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from cldit.scene import load_scene
from cldit.study.page import write_page
from tests.bench.scattering.estimators import Knows
from tests.bench.scattering.findings import findings
from tests.bench.scattering.page import scattering_page
from tests.bench.scattering.run import Error, Row, Study
from tests.bench.scattering.truth import through_second_filter

_CLASSES = {"thin": 0.25, "thick": 0.75, "seldom": 0.001}


def _row(
    method: str, knows: Knows, rms_K: float, *, held: float = 0.95, width_K: float = 4.0
) -> Row:
    error = Error(bias_K=-rms_K, rms_K=rms_K, held=held)
    alone = method.startswith(("alone", "band"))
    return Row(
        method=method,
        needs=f"needs of {method}",
        knows=knows,
        medium=None if alone else error,
        droplets=Error(bias_K=rms_K + 60.0, rms_K=rms_K + 60.0, held=held),
        noise_K=1.0,
        width_K=width_K,
        answered=0.5,
        where=dict.fromkeys(_CLASSES, rms_K),
    )


def _study(*more: Row, wet: float = 0.125) -> Study:
    scene = load_scene("gdi-cone")
    rows = (
        _row("plain DIT", Knows.NOTHING, 5.0),
        _row("as a bound", Knows.RIG, 5.0, width_K=math.inf),
        _row("walls", Knows.RIG, 0.25),
        _row("plate", Knows.RIG, 7.0, held=0.5),
        _row("walls", Knows.RIG_WRONG, 3.0),
        _row("share", Knows.MODEL, 0.0),
        _row("share", Knows.MODEL_WRONG, 2.0, held=0.1),
        _row("share", Knows.MODEL_WRONG, 4.0, held=0.2),
        _row("share", Knows.MODELS, 1.0, held=1.0, width_K=12.5),
        *more,
    )
    image = np.full((12, 12), np.nan)
    image[2:8, 3:9] = 2.0
    second = through_second_filter(scene)
    return Study(rows, {"one": image, "two": image}, wet, _CLASSES, scene, second)


_VAPOUR = (
    _row("alone", Knows.MODEL, 0.0),
    _row("alone", Knows.MODEL_WRONG, 20.0),
    _row("alone", Knows.MODELS, 9.0),
    _row("band", Knows.OTHER_BAND, 1.5),
)


def test_every_number_is_of_the_study() -> None:
    said = findings(_study(wet=1.0))
    text = "\n".join(said)
    assert "5.0 K too cold (RMS 5.0 K), with walls at 450 K" in said[0]
    assert "a model of the spray: walls (needs of walls) 0.25 K, noise 1.0 K." in said[1]
    assert "No better than plain DIT without a model: plate (needs of plate) 7.0 K." in text
    assert "with a wrong input: walls (needs of walls) 3.0 K." in text
    assert "or more for as a bound (needs of as a bound); walls (needs of walls)." in text
    assert "They do not, as they contain noise only, for plate (50 %)." in text
    assert "right model has an RMS error of 0.00 K" in text
    assert "2.0 K (needs of share) to 4.0 K" in text
    assert "contain the truth in 10 % to 20 %" in text and "it in 100 %, is 12.5 K wide" in text
    assert "thin (25 % of the pixels) 5.0 K against 2.0 to 4.0 K" in text and "seldom" not in text
    assert "vapour" not in text  # there is none


def test_they_follow_the_numbers() -> None:
    study = _study(wet=1.0)
    plain = replace(study.rows[0], medium=Error(bias_K=1.0, rms_K=9.0, held=0.0))
    text = "\n".join(findings(replace(study, rows=(plain, *study.rows[1:]))))
    assert "1.0 K too warm (RMS 9.0 K)" in text and "No better" not in text


def test_droplets_under_vapour() -> None:
    text = "\n".join(findings(_study(*_VAPOUR)))
    assert "more than the vapour in 12 % of the pixels. There they are 65.0 K colder" in text
    assert "the share of the right model has an RMS error of 60.0 K" in text
    # Of the shipped cross sections and n and k, which the other filter's optics hold.
    assert "From 3.5 to 3.6 µm the vapour absorbs 0.0" in text and "61.5 K (needs of band)" in text


def test_no_droplets_that_emit_more() -> None:
    text = "\n".join(findings(replace(_study(*_VAPOUR), wet=0.0)))
    assert "less than the vapour in all pixels" in text and "nan" not in text


def test_page_is_whole(tmp_path: Path) -> None:
    page = scattering_page(_study(*_VAPOUR), command="cldit scattering gdi")
    html = write_page(page, tmp_path).read_text(encoding="utf-8")
    assert page.findings[0] in html and "cldit scattering gdi" in html and "open" in html
    markdown = (tmp_path / f"{page.name}.md").read_text(encoding="utf-8")
    assert f"- {page.findings[0]}\n" in markdown
    assert "## Where it fails" in markdown and "thin, 25 % of the pixels" in markdown
    told = json.loads((tmp_path / f"{page.name}.json").read_text(encoding="utf-8"))
    assert told["findings"] == list(page.findings)
    assert len(told["table"]) == len(told["more"][next(iter(told["more"]))]) == 13
    assert told["table"][-1]["what emits: RMS / K"] is None  # it is after the droplets
