"""Computed sprays are kept by what they were made from, and come back bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.scene.spray import LagrangianSpray
from cldit.spray.cache import cached_spray
from cldit.spray.result import Cells, Parcels, Spray, Vapour


def _spray() -> Spray:
    """Two droplets' parcels, and vapour in three of a grid's 24 voxels."""
    rng = np.random.default_rng(1)
    cells = Cells.regular(
        origin_m=np.array([-0.01, -0.01, -0.03]),
        spacing_m=np.full(3, 1e-3 / 3),
        shape=(2, 3, 4),
        index=np.array([1, 7, 23]),
    )
    parcels = Parcels(
        position_m=rng.normal(size=(2, 3)) * 1e-3,
        diameter_m=np.array([9e-6, 4e-6]),
        droplets=np.array([1e4, 3.3e3]),
        temperature_K=np.array([370.0, 351.7]),
        density_kg_m3=np.array([616.0, 633.1]),
    )
    vapour = Vapour(cells, np.array([1e24, 2e23, 1e20]), np.array([400.0, 500.0, 570.0]), 0.1002)
    return Spray(parcels=parcels, vapour=vapour, notes={"liquid_mass_kg": 1e-9}, remarks=("so",))


def test_computed_once(tmp_path: Path) -> None:
    made: list[int] = []

    def make() -> Spray:
        made.append(1)
        return _spray()

    spec = LagrangianSpray()
    first = cached_spray(spec, tmp_path, make)
    again = cached_spray(spec, tmp_path, make)
    assert len(made) == 1
    assert again.parcels is not None and again.vapour is not None
    assert first.parcels is not None and first.vapour is not None
    np.testing.assert_array_equal(again.parcels.position_m, first.parcels.position_m)
    np.testing.assert_array_equal(again.vapour.cells.lower_m, first.vapour.cells.lower_m)
    grids = again.vapour.cells.grid, first.vapour.cells.grid
    assert grids[0] is not None and grids[1] is not None
    np.testing.assert_array_equal(grids[0].index, grids[1].index)
    assert grids[0].shape == grids[1].shape
    assert (again.notes, again.remarks) == (first.notes, first.remarks)
    cached_spray(spec.model_copy(update={"seed": 2}), tmp_path, make)
    assert len(made) == 2
    cached_spray(spec, None, make)
    assert len(made) == 3


def test_damaged_file_is_made_anew(tmp_path: Path) -> None:
    cached_spray(LagrangianSpray(), tmp_path, _spray)
    (file,) = (tmp_path / "sprays").glob("*.npz")
    file.write_bytes(file.read_bytes()[:100])
    assert cached_spray(LagrangianSpray(), tmp_path, _spray).parcels is not None
    assert file.stat().st_size > 100


def test_what_fails_is_not_kept(tmp_path: Path) -> None:
    def make() -> Spray:
        raise SprayError("no")

    with pytest.raises(SprayError, match="no"):
        cached_spray(LagrangianSpray(), tmp_path, make)
    assert not list((tmp_path / "sprays").glob("*.npz"))


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert cached_spray(LagrangianSpray(), tmp_path / "file", _spray).parcels is not None
