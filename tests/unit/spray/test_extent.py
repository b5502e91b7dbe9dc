"""Files keep the extent of droplets, and figures draw it as points; other files are refused."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.scene.spray import ConeSpray
from cldit.show.report.spray_report import liquid_mass
from cldit.spray.extent import Box, Cloud, Extent
from cldit.spray.result import Parcels, Spray
from cldit.spray.spray_file import read_spray, write_spray
from tests.cones import cone_spray


def _parcels(extent: Extent | None) -> Parcels:
    one = np.ones(3)
    return Parcels(np.arange(9.0).reshape(3, 3), 1e-5 * one, one, 300 * one, 600 * one, extent)


@pytest.mark.parametrize(
    "extent", [None, Box(np.array([1e-3, 2e-3, 3e-3])), Cloud(np.arange(27.0).reshape(3, 3, 3))]
)
def test_files_keep_it(extent: Extent | None, tmp_path: Path) -> None:
    path = tmp_path / "spray.npz"
    write_spray(path, Spray(parcels=_parcels(extent)))
    found = read_spray(path).parcels
    assert found is not None
    assert type(found.extent) is type(extent)
    for name, value in vars(extent).items() if extent is not None else ():
        np.testing.assert_array_equal(getattr(found.extent, name), value)


def test_files_of_the_first_layout_are_points(tmp_path: Path) -> None:
    path = tmp_path / "spray.npz"
    write_spray(path, Spray(parcels=_parcels(None)))
    with np.load(path) as archive:
        arrays = dict(archive)
    about = json.loads(str(arrays.pop("about")))
    about["layout"] = 1
    np.savez(path, about=np.array(json.dumps(about)), **arrays)
    found = read_spray(path).parcels
    assert found is not None and found.extent is None


def test_some_of_the_parcels_keep_their_own() -> None:
    chosen = np.array([True, False, True])
    cloud = Cloud(np.arange(27.0).reshape(3, 3, 3))
    taken = _parcels(cloud).take(chosen)
    assert isinstance(taken.extent, Cloud)
    np.testing.assert_array_equal(taken.extent.covariance_m2, cloud.covariance_m2[chosen])
    np.testing.assert_array_equal(taken.position_m, _parcels(None).position_m[chosen])


def test_pictures_of_a_cone_do_not_show_its_lattice() -> None:
    """Pixels of 0.55 of a cell: columns of boxes keep their mass, and no row of pixels within the
    spray is empty, as every other would be with points in the middle of cells of 1 mm."""
    spec = ConeSpray(spacing_m=1e-3, size_classes=2)
    spray = cone_spray(spec)
    assert spray.parcels is not None
    seen = liquid_mass(spray, "side", pixel_m=0.55e-3)
    assert seen.image.sum() * 0.55e-3**2 == pytest.approx(spray.parcels.mass_kg, rel=1e-9)
    rows = seen.image.sum(axis=1)
    inside = rows[rows > 0.3 * rows.max()]
    assert np.abs(np.diff(inside)).max() < 0.4 * rows.max()


def test_a_name_twice_and_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "spray.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("about.npy", b" " * 1_000_000)
    monkeypatch.setattr("cldit.spray.spray_file.free_bytes", lambda: 500_000)
    with pytest.raises(SprayError, match=r"unpacks to 0\.001 GB; 0\.0005 GB of memory are free"):
        read_spray(path)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("about.npy", b"")
    with pytest.raises(SprayError, match=r"has about\.npy twice"):
        read_spray(path)
