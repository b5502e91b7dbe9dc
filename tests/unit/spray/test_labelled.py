"""A spray as a labelled data set, and files of it."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.spray.result import Cells, Parcels, Spray, Vapour
from tests.extras import needs

pytestmark = needs("xarray", extra="studies")


def spray() -> Spray:
    one = np.ones(3)
    parcels = Parcels(
        1e-3 * np.arange(9.0).reshape(3, 3), 1e-5 * one, 5 * one, 350 * one, 700 * one
    )
    cells = Cells.regular(
        origin_m=np.array([0.0, 0.0, -4e-3]), spacing_m=np.full(3, 2e-3), shape=(1, 1, 2)
    )
    vapour = Vapour(cells, np.array([1e24, 2e24]), np.array([400.0, 500.0]), 0.1)
    return Spray(parcels, vapour, notes={"time_s": 1e-3}, remarks=("a", "b"))


def test_places_in_mm_and_units() -> None:
    data = spray().to_xarray()
    assert data.parcel_z.values == pytest.approx([2.0, 5.0, 8.0])
    assert data.cell_z.values == pytest.approx([-3.0, -1.0])
    assert data.cell_width_z.values == pytest.approx([2.0, 2.0])
    assert all("units" in data[name].attrs for name in data.variables)
    assert data.vapour_temperature_K.values.tolist() == [400.0, 500.0]
    assert data.attrs["time_s"] == 1e-3 and data.attrs["remarks"] == "a\nb"


def test_a_spray_of_nothing() -> None:
    assert not Spray().to_xarray().variables
