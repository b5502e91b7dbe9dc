"""Errors of measured.yaml name the file and the key, and quote values in 80 letters."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml

from cldit.acquisition.measured import open_measured
from cldit.acquisition.measured_draft import write_measured
from cldit.errors import ClditError

LONG = "x" * 100_000
MANY = [1.0 + n for n in range(20_000)]
IMAGE = np.arange(20 * 16, dtype=np.uint16).reshape(20, 16)


@pytest.fixture
def data(tmp_path: Path) -> dict[str, Any]:
    for name in ("a", "b", "c", "d"):
        tifffile.imwrite(tmp_path / f"{name}.tif", np.stack([IMAGE] * 3), photometric="minisblack")
    return {
        "filter_um": [3.3, 3.5],
        "setup": {"pixel_m": [1e-4, 1e-4]},
        "sensor": {"saturation_counts": 16383},
        "backgrounds": [
            {"temperature_K": 413.0, "references": "a.tif", "injections": "b.tif"},
            {"temperature_K": 453.0, "references": "c.tif", "injections": "d.tif"},
        ],
    }


def _message(folder: Path, data: dict[str, Any]) -> str:
    (folder / "measured.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(ClditError) as caught:
        open_measured(folder)
    return str(caught.value)


def _second(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda data: data["backgrounds"][1].update({key: value})


def _top(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda data: data.update({key: value})


CASES: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    (_second("references", LONG), "backgrounds[1].references"),
    (_second("references", "a.tif"), "backgrounds[1].references"),
    (_second("references", "c.tif[0:99]"), "backgrounds[1].references"),
    (_second("injections", f"{LONG}[]::"), "backgrounds[1].injections"),
    (_second("references_s", MANY), "backgrounds[1].references_s"),
    (_second("references_s", [1.0, 3.0, 2.0]), "backgrounds[1].references_s"),
    (_second("injections_s", f"log.csv::{LONG}"), "backgrounds[1].injections_s"),
    (_second("references_K", [453.0] * 4), "backgrounds[1].references_K"),
    (_second("injections_K", [453.0, 180.0, 453.0]), "backgrounds[1].injections_K"),
    (_second("references_C", [1.0, 2.0, 3.0]), "backgrounds[1].references_C"),
    (_second("temperature_K", 413.0), "backgrounds"),
    (_second("temperature_K", LONG), "backgrounds[1].temperature_K"),
    (_top("references", 5), "backgrounds[0].references"),
    (_top("bad_pixels", LONG), "bad_pixels"),
    (_top("name", [LONG]), "name"),
    (_top("axes", [LONG, "rows", "columns"]), "axes"),
    (_top("sensor", {"saturation_counts": LONG}), "sensor.saturation_counts"),
    (_top(LONG, 1), "x" * 70),
]


@pytest.mark.parametrize("number", range(len(CASES)))
def test_an_error_names_file_and_key_in_few_letters(
    tmp_path: Path, data: dict[str, Any], number: int
) -> None:
    change, key = CASES[number]
    change(data)
    message = _message(tmp_path, data)
    assert message.startswith(f"{tmp_path / 'measured.yaml'}:")
    assert re.search(rf":\s{re.escape(key)}", message), message[:2000]
    assert len(message) < 1500 and not re.search("x{81}", message)


def test_an_unfinished_draft_lists_what_is_missing(tmp_path: Path, data: dict[str, Any]) -> None:
    out = tmp_path / "measured.yaml"
    write_measured(tmp_path, out)
    with pytest.raises(ClditError) as caught:
        open_measured(out)
    first, *lines = str(caught.value).splitlines()
    assert first == f"{out}: is incomplete; complete and uncomment what is missing:"
    assert {"filter_um: is missing", "setup.pixel_m: is missing"} <= set(lines)
    assert "backgrounds[0].temperature_K: is missing" in lines
