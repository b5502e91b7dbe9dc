"""`cldit evaluate` prints what the witnesses say, and ends where one of them is severe."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml
from click.testing import CliRunner

from cldit.cli import main
from cldit.images import read_image
from tests.laboratory import AROUND, FILTER_UM, Laboratory, laboratory

SHAPE = (24, 40)


def _write(folder: Path, made: Laboratory, **more: Any) -> None:
    """The shots as a TIFF a kind and background, and their measured.yaml."""
    folder.mkdir(exist_ok=True)
    backgrounds = []
    for background_K in sorted({shot.background_K for shot in made.recorded.shots}):
        names = {}
        for kind in ("reference", "injection"):
            names[f"{kind}s"] = f"{kind}_{background_K:g}.tif"
            stack = [
                shot.image
                for shot in made.recorded.shots
                if (shot.kind, shot.background_K) == (kind, background_K)
            ]
            tifffile.imwrite(folder / names[f"{kind}s"], np.stack(stack), photometric="minisblack")
        backgrounds.append({"temperature_K": background_K, **names})
    data = {
        "filter_um": list(FILTER_UM),
        "setup": {
            "pixel_m": [1e-4, 1e-4],
            "background_emissivity": AROUND.background_emissivity,
            "wall_temperature_K": AROUND.wall_temperature_K,
            "camera_surroundings_K": AROUND.camera_surroundings_K,
            "windows": [window.model_dump() for window in AROUND.windows],
            "uncertainty": {"wall_temperature_K": 5.0},
        },
        "sensor": {"saturation_counts": 16383},
        "backgrounds": backgrounds,
        **more,
    }
    (folder / "measured.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")


def _run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(main, ["evaluate", *arguments])
    return result.exit_code, " ".join(result.output.split())


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ({"off_K": {483.0: 1.0}}, "background 483 K reads +1.00 K off the others"),
        ({"offset_of_injections": 20.0}, "as if the camera's offset changed between the kinds"),
    ],
)
def test_what_is_found_is_printed(tmp_path: Path, fault: dict[str, Any], text: str) -> None:
    _write(tmp_path, laboratory(1, shape=SHAPE, **fault))
    code, output = _run(str(tmp_path))
    assert code == 0 and text in output
    assert "walls by 5 K" in output and "fit_probability below 0.001" in output
    stored = json.loads((tmp_path / "maps" / "evaluation.json").read_text(encoding="utf-8"))
    assert any(text in one["text"] and one["stands_out"] for one in stored["witnesses"])
    assert stored["budget"]["total"]["apparent_temperature_K"] > 0.0
    total, statistical = (
        read_image(tmp_path / "maps" / f"apparent_temperature_{name}_error_K.tif")[0]
        for name in ("total", "standard")
    )
    assert np.all((total >= statistical)[np.isfinite(total)])


def test_severe_findings_end_the_evaluation_unless_accepted(tmp_path: Path) -> None:
    made = laboratory(2, shape=SHAPE, blackbody_of_injections_K=5.0)
    _write(tmp_path, made)
    code, output = _run(str(tmp_path))
    assert code == 1 and "accept: [kinds]" in output and not (tmp_path / "maps").exists()
    code, output = _run(str(tmp_path), "--accept", "kinds")
    assert code == 0 and (tmp_path / "maps" / "emissivity.tif").is_file()
    _write(tmp_path, made, accept=["kinds"])
    assert _run(str(tmp_path))[0] == 0
    _write(tmp_path, made, accept=["kindness"])
    code, output = _run(str(tmp_path))
    assert code == 1 and "accept" in output and "'backgrounds'" in output
