"""Between parcels and grid: nothing is lost, and linear fields are read exactly."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.spray.flow.exchange import CENTRE, FACES, gather, scatter
from cldit.spray.flow.gas import FlowGrid


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("shift", [CENTRE, *FACES])
def test_amounts_are_kept(closed: bool, shift: tuple[float, float, float]) -> None:
    box = FlowGrid(np.array([-3e-3, 1e-3, 0.0]), 1e-3, (6, 5, 7), closed)
    random = np.random.default_rng(3)
    at = box.origin_m + random.random((400, 3)) * 1e-3 * np.array(box.shape)
    at[:4] = box.origin_m, box.upper_m, box.upper_m + 1e-9, box.origin_m - 1e-9
    amounts = random.standard_normal(400)
    field = scatter(box, at, amounts, shift)
    assert field.sum() * box.cell_m3 == pytest.approx(amounts.sum(), rel=1e-12)
    if closed:  # nothing on a wall
        for axis in range(3):
            if shift[axis] == 0:
                assert not np.any(np.take(field, 0, axis=axis))


@pytest.mark.parametrize("shift", [CENTRE, *FACES])
def test_a_linear_field_is_read_exactly(shift: tuple[float, float, float]) -> None:
    box = FlowGrid(np.array([1.0, 2.0, -4.0]), 0.5, (8, 9, 10))
    place = np.stack(np.meshgrid(*(np.arange(n) for n in box.shape), indexing="ij"), axis=-1)
    where = box.origin_m + (place + np.array(shift)) * 0.5
    slope = np.array([1.0, -2.0, 3.0])
    random = np.random.default_rng(4)
    at = box.origin_m + (1 + random.random((50, 3)) * (np.array(box.shape) - 2.5)) * 0.5
    np.testing.assert_allclose(gather(box, at, where @ slope, shift), at @ slope, rtol=1e-12)


def test_gathering_and_scattering_are_adjoint() -> None:
    box = FlowGrid(np.zeros(3), 1.0, (5, 5, 5))
    random = np.random.default_rng(5)
    at, amounts = random.random((30, 3)) * 5, random.random(30)
    field = random.random((5, 5, 5))
    left = np.sum(scatter(box, at, amounts) * field)
    assert left == pytest.approx(np.sum(amounts * gather(box, at, field)), rel=1e-12)
