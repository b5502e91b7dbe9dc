"""The reader plugin of napari: its manifest, and the layers that it gives."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.api.napari_reader import get_reader
from cldit.io.plain_data import read_mapping
from cldit.run import open_run

PACKAGE = Path(cldit.__file__).parent
WRITTEN = Path(__file__).parents[1] / "data" / "run-0.1.0"


def test_layers_lie_where_the_camera_saw_them() -> None:
    run = open_run(WRITTEN)
    reader = get_reader(str(WRITTEN))
    assert reader is not None
    layers = {about["name"]: (values, about, kind) for values, about, kind in reader(str(WRITTEN))}
    values, about, kind = layers["apparent temperature / K"]
    np.testing.assert_array_equal(values, run.maps.apparent_temperature_K)
    rows, columns = values.shape
    width, height = (1e3 * one for one in run.pixel_m)
    x, _, z = run.scene.target_m
    assert kind == "image" and about["scale"] == pytest.approx((height, width))
    middle = [t + (n - 1) / 2 * s for t, n, s in zip(about["translate"], (rows, columns),
                                                    about["scale"], strict=True)]  # fmt: skip
    assert middle == pytest.approx([-1e3 * z, 1e3 * x])
    assert {"emissivity", "optical depth"} <= set(layers)


def test_acquisitions_are_read_and_other_things_left() -> None:
    reader = get_reader([str(WRITTEN / "acquisition")])
    assert reader is not None and len(reader([str(WRITTEN / "acquisition")])) == 4
    for other in (str(WRITTEN / "maps"), str(WRITTEN / "scene.yaml"), str(WRITTEN / "nowhere"),
                  [str(WRITTEN), str(WRITTEN)]):  # fmt: skip
        assert get_reader(other) is None


def test_the_entry_point_names_the_manifest() -> None:
    """The manifest's commands are there."""
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    package, _, file = project["project"]["entry-points"]["napari.manifest"]["cldit"].partition(":")
    assert package == "cldit" and file in project["tool"]["setuptools"]["package-data"]["cldit"]
    manifest = read_mapping(PACKAGE / file)
    (command,) = manifest["contributions"]["commands"]
    assert command["python_name"] == f"{get_reader.__module__}:{get_reader.__name__}"


@pytest.mark.skipif(find_spec("npe2") is None, reason="npe2 is not installed")
def test_npe2_takes_the_manifest() -> None:
    code = (
        "import sys; from npe2 import PluginManifest as M; m = M.from_file(sys.argv[1]); "
        "m.validate_imports(); print(m.contributions.readers[0].accepts_directories)"
    )
    words = [sys.executable, "-W", "ignore", "-c", code, str(PACKAGE / "napari.yaml")]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
