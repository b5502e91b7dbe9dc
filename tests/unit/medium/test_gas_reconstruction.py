"""Linear reconstruction of gas: exact for linear fields, conservative, without new extremes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.medium.gas_reconstruction import coarsened, reconstructed
from cldit.spray.result import Cells, Vapour

_EDGE_m = 1e-3


def _vapour(density: np.ndarray, temperature: np.ndarray, some: np.ndarray | None = None) -> Vapour:
    index = None if some is None else np.flatnonzero(some)
    cells = Cells.regular(
        origin_m=np.array([-3e-3, 1e-3, 0.0]),
        spacing_m=np.full(3, _EDGE_m),
        shape=density.shape,
        index=index,
    )
    chosen = slice(None) if index is None else index
    return Vapour(cells, density.reshape(-1)[chosen], temperature.reshape(-1)[chosen], 0.1)


def _boxes_of_parts(coarse: Vapour, fine: Vapour) -> np.ndarray:
    """The box of each part."""
    middle = 0.5 * (fine.cells.lower_m + fine.cells.upper_m)
    place = np.floor((middle - [-3e-3, 1e-3, 0.0]) / _EDGE_m).astype(int)
    own = np.rint((coarse.cells.lower_m - [-3e-3, 1e-3, 0.0]) / _EDGE_m).astype(int)
    at = {tuple(one): number for number, one in enumerate(own)}
    return np.array([at[tuple(one)] for one in place])


def test_a_linear_field_is_met_in_every_part() -> None:
    """Except in the outer boxes, which have no vapour beside them. A temperature that varies as
    well is shifted by what keeps its mean, so it is even here."""
    x, y, z = np.indices((6, 7, 5)).astype(float)
    fine = reconstructed(_vapour(1e20 * (10 + x + 0.5 * y - 0.25 * z), np.full(x.shape, 400.0)))
    assert len(fine.temperature_K) == 8 * x.size
    place = (0.5 * (fine.cells.lower_m + fine.cells.upper_m) - [-3e-3, 1e-3, 0.0]) / _EDGE_m - 0.5
    inside = np.all((place > 0.6) & (place < np.array(x.shape) - 1.6), axis=1)
    expected = 1e20 * (10 + place @ [1.0, 0.5, -0.25])
    assert inside.sum() > 100
    np.testing.assert_allclose(fine.number_density_m3[inside], expected[inside], rtol=1e-12)
    np.testing.assert_allclose(fine.temperature_K, 400.0, rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_content_and_temperature_are_kept_and_no_extremes_arise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (8, 9, 7)
    density = rng.lognormal(sigma=2.0, size=shape) * 1e20
    coarse = _vapour(density, rng.uniform(300.0, 600.0, shape), rng.random(shape) < 0.7)
    fine = reconstructed(coarse)
    of = _boxes_of_parts(coarse, fine)
    count = len(coarse.temperature_K)
    number = np.bincount(of, fine.number_density_m3, count) / 8
    np.testing.assert_allclose(number, coarse.number_density_m3, rtol=1e-12)
    heat = np.bincount(of, fine.number_density_m3 * fine.temperature_K, count) / 8
    np.testing.assert_allclose(heat / number, coarse.temperature_K, rtol=1e-12)
    assert fine.number_density_m3.min() >= 0.0
    for name in ("number_density_m3", "temperature_K"):
        assert getattr(fine, name).max() <= getattr(coarse, name).max() * (1 + 1e-12)
    assert fine.temperature_K.min() >= coarse.temperature_K.min() * (1 - 1e-12)


def test_the_error_of_a_smooth_jet_falls_as_that_of_the_second_order() -> None:
    """A Gaussian jet of 2 mm in boxes of 1 mm: parts of 0.5 mm against the exact density there.
    Boxes are off by first order. In boxes of 2 mm, of a quarter of the parts, it is 2^2 as much
    or more: the limiter cuts the peak, which adds some."""
    x, y, _ = np.indices((16, 16, 4)) - 7.5
    coarse = _vapour(1e20 * np.exp(-(x**2 + y**2) / 8), np.full(x.shape, 400.0))
    twice = coarsened(coarse)
    assert twice is not None

    def error(vapour: Vapour) -> float:
        middle = (
            0.5 * (vapour.cells.lower_m + vapour.cells.upper_m) - [-3e-3, 1e-3, 0.0]
        ) / _EDGE_m
        exact = 1e20 * np.exp(-((middle[:, 0] - 8) ** 2 + (middle[:, 1] - 8) ** 2) / 8)
        return float(np.sqrt(np.mean((vapour.number_density_m3 - exact) ** 2)))

    fine = reconstructed(coarse)
    blocks = replace(
        fine, number_density_m3=coarse.number_density_m3[_boxes_of_parts(coarse, fine)]
    )
    assert error(fine) < 0.3 * error(blocks)
    assert 3.0 < error(reconstructed(twice)) / error(fine) < 6.0


def test_larger_boxes_keep_content_and_temperature() -> None:
    rng = np.random.default_rng(2)
    shape = (5, 6, 7)
    fine = _vapour(rng.random(shape), rng.uniform(300.0, 600.0, shape), rng.random(shape) < 0.5)
    twice = coarsened(fine)
    assert twice is not None
    assert twice.mass_kg == pytest.approx(fine.mass_kg, rel=1e-12)
    heat = [
        np.sum(one.number_density_m3 * one.cells.volume_m3 * one.temperature_K)
        for one in (fine, twice)
    ]
    assert heat[0] == pytest.approx(heat[1], rel=1e-12)


def test_boxes_on_no_lattice_stay_as_they_are() -> None:
    rng = np.random.default_rng(1)
    lower = rng.uniform(size=(50, 3))
    odd = Vapour(
        Cells(lower, lower + rng.uniform(0.5, 1.0, (50, 3))), np.ones(50), np.full(50, 400.0), 0.1
    )
    assert reconstructed(odd) is odd and coarsened(odd) is None
    even = Vapour(Cells(lower, lower + 1e-3), np.ones(50), np.full(50, 400.0), 0.1)
    assert reconstructed(even) is even
