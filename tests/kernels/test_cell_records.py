"""Records of cells, as the image kernel reads them."""

from __future__ import annotations

import numpy as np

from cldit.transport.cell_records import CellRecords
from cldit.transport.cells import OpticalCells

from .medium import random_tree


def test_records_of_filled_cells() -> None:
    """Sources of both images lie where the kernel reads them, and thick cells have their emission
    alone. Elsewhere the boundary's part and the emission at radiance 1 sum to 1."""
    medium = OpticalCells.of(random_tree(8))
    rng = np.random.default_rng(6)
    made = CellRecords.of(medium)
    assert np.array_equal(np.flatnonzero(made.number >= 0), np.flatnonzero(medium.depth > 0))
    cells, count = len(medium.address), len(medium.needs.components)
    listed = [rng.random((count, cells)) / 8 for _ in range(2)]
    thick = np.flatnonzero(rng.random(cells) < 0.3)
    records = made.records(list(listed), np.zeros(cells), thick, np.float64)
    assert records.shape == (len(made.at), 2 + 2 * (count + 1))
    np.testing.assert_array_equal(records[:, 0], medium.depth[made.at])
    row = made.number[medium.address]
    plain = np.setdiff1d(np.arange(cells), thick)
    np.testing.assert_array_equal(records[row[thick], 1], medium.albedo[thick])
    assert not records[row[plain], 1].any()
    for image, source in enumerate(listed):
        mine = records[:, 2 + image * (count + 1) : 2 + (image + 1) * (count + 1)]
        np.testing.assert_array_equal(mine[row[plain], :-1], source[:, plain].T)
        emitted = np.zeros((count, len(thick)))
        emitted[2:] = medium.thermal_planes(np.float64)[:, medium.address[thick]]
        np.testing.assert_array_equal(mine[row[thick], :-1], emitted.T)
        whole = mine[:, :2].sum(axis=1) + mine[:, -1]
        whole[row[thick]] += medium.albedo[thick]  # the gather's
        np.testing.assert_allclose(whole, 1.0, rtol=1e-12)
