"""`cldit evaluate` prints what the witnesses say, and ends where one of them is severe."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.cli import main
from cldit.io.images import read_image
from tests.laboratory import laboratory
from tests.measured_files import write_measured

SHAPE = (24, 40)


def _run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(main, ["evaluate", *arguments])
    return result.exit_code, " ".join(result.output.split())


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ({"off_K": {483.0: 1.0}}, "background 483 K deviates by +1.00 K"),
        pytest.param(
            {"offset_of_injections": 20.0},
            "as if the camera's offset changed between the kinds",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_is_found_is_printed(tmp_path: Path, fault: dict[str, Any], text: str) -> None:
    write_measured(tmp_path, laboratory(1, shape=SHAPE, **fault))
    code, output = _run(str(tmp_path))
    assert code == 0 and text in output
    assert "walls by 5 K" in output and "fit_probability below 0.001" in output
    assert "drift fitted against the shot number" in output
    page = (tmp_path / "maps" / "report.html").read_text(encoding="utf-8")
    assert "drift fitted against the shot number: no shot has a time" in page
    stored = json.loads((tmp_path / "maps" / "evaluation.json").read_text(encoding="utf-8"))
    assert any(text in one["text"] and one["stands_out"] for one in stored["witnesses"])
    assert stored["budget"]["total"]["apparent_temperature_K"] > 0.0
    total, statistical = (
        read_image(tmp_path / "maps" / f"apparent_temperature_{name}_error_K.tif")[0]
        for name in ("total", "standard")
    )
    assert np.all((total >= statistical)[np.isfinite(total)])


@pytest.mark.usefixtures("without_pages")
def test_severe_findings_end_the_evaluation_unless_accepted(tmp_path: Path) -> None:
    made = laboratory(2, shape=SHAPE, blackbody_of_injections_K=5.0)
    write_measured(tmp_path, made)
    code, output = _run(str(tmp_path))
    assert code == 1 and "accept: [kinds]" in output and not (tmp_path / "maps").exists()
    code, output = _run(str(tmp_path), "--accept", "kinds")
    assert code == 0 and (tmp_path / "maps" / "emissivity.tif").is_file()
    write_measured(tmp_path, made, accept=["kinds"])
    assert _run(str(tmp_path))[0] == 0
    write_measured(tmp_path, made, accept=["kindness"])
    code, output = _run(str(tmp_path))
    assert code == 1 and "accept" in output and "'backgrounds'" in output
