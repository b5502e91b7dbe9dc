"""`cldit.evaluate`: labelled maps, their pictures, and files of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cldit
from tests.extras import needs
from tests.laboratory import laboratory
from tests.measured_files import write_measured

pytestmark = needs("xarray", extra="studies")


def test_an_evaluation_is_drawn_compared_and_stored(tmp_path: Path) -> None:
    folder = tmp_path / "july"
    folder.mkdir()
    write_measured(folder, laboratory(1, shape=(24, 40)))
    data = cldit.evaluate(folder)
    for name in data.apparent_temperature_K.ancillary_variables.split():
        assert name in data
    assert "apparent_temperature_total_error_K" in data.apparent_temperature_K.ancillary_variables
    assert cldit.plot(data).axes[0].get_xlabel() == "x / mm"
    assert len(cldit.plot(data, "errors").axes) == 4  # two pictures, two colour bars
    budget = cldit.plot(data, "budget").axes[0]
    assert "walls" in " ".join(label.get_text() for label in budget.get_yticklabels())

    stored = json.loads((folder / "maps" / "evaluation.json").read_text())
    names = [Path(one["path"]).name for one in stored["origin"]["inputs"]]
    assert "measured.yaml" in names and len(names) > 3
    assert all(len(one["sha256"]) == 64 for one in stored["origin"]["inputs"])
    assert json.loads(data.attrs["evaluation"])["origin"]["inputs"] == []

    found = cldit.compare(folder, folder).differences[0]
    assert found.same and found.stated_K[0] is not None

    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf", reason="the extra studies is not installed")
    path = tmp_path / "july.nc"
    data.to_netcdf(path, engine="h5netcdf")
    back = xarray.open_dataset(path, engine="h5netcdf", mask_and_scale=False)
    assert back.equals(data) and back.attrs["title"] == data.attrs["title"]
    np.testing.assert_allclose(back.x.values, data.x.values)
