"""The command line's choice of optics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import cldit
from cldit.cli import main
from tests.small_scenes import WHOLE


@pytest.mark.slow
def test_spectral_run_says_how_far_it_is_from_the_paper(tmp_path: Path) -> None:
    """`gdi` small: several wavelengths, a figure in K against the paper's, and other maps."""
    data = cldit.load_scene("gdi-cone").model_dump(mode="json")
    data["camera"].update(WHOLE, pixels=[40, 40])
    data["domain"]["leaf_edge_m"] = 4e-3
    data["optics"]["wavelengths"] = 3
    scene = tmp_path / "small.yaml"
    scene.write_text(yaml.safe_dump(data))
    folder = tmp_path / "spectral"
    result = CliRunner().invoke(
        main,
        ["run", str(scene), "--preset", "spectral", "--trace-only", "--out", str(folder)],
        catch_exceptions=False,
    )
    assert result.exit_code == 0, result.output
    run = cldit.open_run(folder)
    assert run.info.spectral is not None
    assert len(run.spectral) > 1
    difference = run.info.spectral.from_paper
    assert difference is not None
    assert 0.1 < difference.rms_K < 50
    assert np.nanmax(run.maps.emissivity) > 0.85
