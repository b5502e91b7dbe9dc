"""Columns along lines of sight: nothing is lost, and each is what lies along its beam.

The reference cuts every box with every slice of every beam, one by one.
"""

from __future__ import annotations

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.optics.sightlines import Beams, Sightlines
from cldit.spray.result import Cells, Parcels, Spray, Vapour

MOLE = 6.02214076e23


def cut(beams: Beams, lower_m: Floats, upper_m: Floats, amount: Floats) -> Floats:
    """Amount per area, (beams, slices), box by box."""
    nx, ny, nz = beams.shape
    out = np.zeros((nx, nz, ny))
    for low, high, each in zip(lower_m, upper_m, amount, strict=True):
        for x, y, z in np.ndindex(nx, ny, nz):
            corner = beams.lower_m + np.array([x, y, z]) * beams.pitch_m
            edge = np.minimum(high, corner + beams.pitch_m) - np.maximum(low, corner)
            out[x, z, y] += each * np.prod(np.maximum(edge, 0.0)) / np.prod(high - low)
    return np.asarray(out.reshape(nx * nz, ny) / (beams.pitch_m[0] * beams.pitch_m[2]))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_boxes_against_one_by_one(seed: int) -> None:
    """Boxes from a tenth of a beam to all beams; sums are exact to rounding, and slivers of 1e-6
    of a beam's slice may lie in the neighbour."""
    rng = np.random.default_rng(seed)
    lower = rng.uniform(0.0, 0.05, (20, 3))
    upper = lower + rng.uniform(5e-4, 0.05, (20, 3))
    amount = rng.random(20)
    beams = Beams.around(lower, upper, width_m=0.012)
    (found,) = beams.columns(lower, upper, [amount])
    area = beams.pitch_m[0] * beams.pitch_m[2]
    assert found.sum() * area == pytest.approx(amount.sum(), rel=1e-12)
    np.testing.assert_allclose(found, cut(beams, lower, upper, amount), atol=1e-4 * found.max())


def test_points_and_boxes_together() -> None:
    """Points lie in one beam; a point on the far face of all beams is in the last of them."""
    lower = np.array([[0.0, 0.0, 0.0], [0.01, 0.01, 0.01], [0.0, 0.0, 0.0]])
    upper = np.array([[0.0, 0.0, 0.0], [0.01, 0.01, 0.01], [0.01, 0.01, 0.01]])
    beams = Beams.around(lower, upper, width_m=1e-3)
    assert beams.shape == (10, 10, 10)
    (found,) = beams.columns(lower, upper, [np.array([3.0, 5.0, 1000.0])])
    found *= beams.pitch_m[0] * beams.pitch_m[2]
    expected = np.ones((100, 10))
    expected[0, 0] += 3.0
    expected[99, 9] += 5.0
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def even(cells: int, edge_m: float = 0.05) -> Spray:
    """A cube of even vapour, in so many cells each way."""
    boxes = Cells.regular(
        origin_m=np.zeros(3), spacing_m=np.full(3, edge_m / cells), shape=(cells,) * 3
    )
    count = len(boxes.lower_m)
    return Spray(vapour=Vapour(boxes, np.full(count, MOLE), np.full(count, 500.0), 0.1))


@pytest.mark.parametrize("cells", [1, 3, 17, 50])
def test_columns_are_those_of_the_gas_however_large_its_cells_are(cells: int) -> None:
    """1 mol/m3 along 0.05 m: no line sees more than another, coarse or fine."""
    lines = Sightlines.through(even(cells), width_m=1e-3)
    np.testing.assert_allclose(lines.vapour_mol_m2.sum(axis=1), 0.05, rtol=1e-5)
    np.testing.assert_allclose(lines.vapour_K, 500.0, rtol=1e-9)


def test_one_parcel_is_seen_as_in_one_cell() -> None:
    parcel = Parcels(
        np.zeros((1, 3)), np.array([1e-5]), np.array([1e3]), np.array([370.0]), np.array([600.0])
    )
    lines = Sightlines.through(Spray(parcels=parcel), width_m=1e-3)
    assert lines.droplet_m2.shape == (1, 1, len(lines.diameter_m))
    assert lines.droplet_m2.sum() == pytest.approx(1e3 * np.pi / 4 * 1e-10 / 1e-6)
    np.testing.assert_allclose(lines.droplet_K, 370.0)


def test_a_few_cold_lines_count_as_a_few() -> None:
    """One voxel of 20 x 20 x 1 is cold, so one line of 400 stands for it, and the rest for 399."""
    boxes = Cells.regular(origin_m=np.zeros(3), spacing_m=np.full(3, 1e-3), shape=(20, 1, 20))
    kelvin = np.where(np.arange(400) == 137, 300.0, 500.0)
    even = Vapour(boxes, np.full(400, 1e3 * MOLE), kelvin, 0.1)
    lines = Sightlines.through(Spray(vapour=even), width_m=1e-3)
    assert lines.count.sum() == 400
    cold = lines.vapour_K[:, 0] < 400.0
    assert np.count_nonzero(cold) == 1 and lines.count[cold].sum() == 1
