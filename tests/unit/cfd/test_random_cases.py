"""Random small clouds and meshes in random pieces come back the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.to_spray import read_cfd
from tests.unit.cfd.randomcases import random_case, rows_read, write_vtk

pytest.importorskip("vtkmodules")


def comes_back(folder: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    case = random_case(random)
    spray = read_cfd(case.spec(write_vtk(folder, case, random)))
    gas, parcels = rows_read(spray, case)
    # float32 numbers are held as they are; some double roundings of places of 10 mm, and of a
    # box by the third root of its volume over its edges
    assert gas[:, :6] == pytest.approx(case.gas_rows()[:, :6], abs=1e-15, rel=1e-12)
    assert gas[:, 6:] == pytest.approx(case.gas_rows()[:, 6:], rel=1e-12)
    assert parcels[:, :3] == pytest.approx(case.parcel_rows()[:, :3], abs=1e-17, rel=1e-14)
    assert np.array_equal(parcels[:, 3:], case.parcel_rows()[:, 3:])


@pytest.mark.parametrize("seed", range(8))
def test_vtk_in_pieces(seed: int, tmp_path: Path) -> None:
    comes_back(tmp_path, seed)


@pytest.mark.slow
def test_vtk_in_many_pieces(tmp_path: Path) -> None:
    for seed in range(100, 400):
        comes_back(tmp_path / str(seed), seed)
