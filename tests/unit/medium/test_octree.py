"""The octree: what goes in comes out; gas that is reconstructed in parts of its boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.errors import MediumError
from cldit.medium.deposit import PlacedBoxes, PlacedPoints, place_boxes
from cldit.medium.frame import Cube
from cldit.medium.gas_reconstruction import coarsened, reconstructed
from cldit.medium.octree import FIELDS, CellSource, Octree, PointSource, build_octree
from cldit.spray.result import Cells, Vapour

EDGE = 0.2


def frame(leaf_edge_m: float) -> Cube:
    return Cube.around(centre_m=(0.0, 0.0, 0.0), edge_m=EDGE, leaf_edge_m=leaf_edge_m)


def boxes(lower: Floats, upper: Floats, vapour: Floats) -> CellSource:
    none = np.zeros(len(vapour))
    return CellSource(lower, upper, vapour, 3 * vapour, none, none, none)


def points(position: Floats, amount: Floats) -> PointSource:
    return PointSource(position, amount, 2 * amount, 3 * amount)


@pytest.mark.parametrize("depth", [0, 3, 9])
def test_a_cube_is_halved_until_its_cells_are_small_enough(depth: int) -> None:
    whole = frame(2 * EDGE)
    assert whole.depth == 0
    halved = whole.at(depth)
    assert halved.lower_m == whole.lower_m
    assert halved.cell_m == EDGE / 2**depth
    assert frame(1.01 * halved.cell_m) == halved
    assert frame(halved.cell_m) == whole.at(depth + 1)  # below the bound, not at it


@pytest.mark.parametrize(
    "leaf", [0.3, 0.11, 0.02, 0.004, pytest.param(0.8e-3, marks=pytest.mark.slow)]
)
def test_everything_is_conserved(leaf: float) -> None:
    """Random boxes that fit no cell, and points: integrals equal the input's to float32's 6e-8."""
    rng = np.random.default_rng(1)
    lower = rng.uniform(-0.09, 0.05, (500, 3))
    upper = lower + rng.uniform(1e-5, 0.03, (500, 3))
    vapour = 10.0 ** rng.uniform(-6, 2, 500)
    amount = 10.0 ** rng.uniform(-9, -6, 800)
    tree = build_octree(
        frame(leaf),
        points(rng.normal(0, 0.02, (800, 3)), amount),
        [boxes(lower, upper, vapour)],
        optical_depth_split=1e-5,
    )
    in_boxes = float(np.sum(vapour * np.prod(upper - lower, axis=1)))
    expected = (in_boxes, 3 * in_boxes, amount.sum(), 2 * amount.sum(), 3 * amount.sum())
    for name, value in zip(FIELDS, expected, strict=True):
        assert tree.integral(name) == pytest.approx(value, rel=2e-7), name
    assert sum(n / 8.0**level for level, n in enumerate(tree.leaves)) == pytest.approx(1.0)


@pytest.mark.parametrize("leaf", [0.11, 0.02, 0.004])
def test_shares_of_classes_are_conserved(leaf: float) -> None:
    """What each of three classes scatters in all cells, by bytes that round to half of a 255th of
    what a cell's droplets scatter; the fields are those without classes, to the last bit."""
    rng = np.random.default_rng(2)
    amount = 10.0 ** rng.uniform(-9, -6, 800)
    place, number = rng.normal(0, 0.02, (800, 3)), rng.integers(0, 3, 800)
    number[place[:, 0] > 0.01] = 1  # some cells hold one class alone
    plain = points(place, amount)
    parts = tuple(np.where(number == k, plain.scattering_m2, 0.0) for k in (1, 2))
    tree, without = (
        build_octree(frame(leaf), source, [], optical_depth_split=1e-5)
        for source in (replace(plain, class_scattering_m2=parts), plain)
    )
    assert without.shares is None and tree.fields.keys() == without.fields.keys()
    for name, values in without.fields.items():
        np.testing.assert_array_equal(tree.fields[name], values)
    assert tree.shares is not None and tree.shares.shape == (2, len(values))
    assert np.all(tree.shares[1] >= tree.shares[0])
    ends = np.vstack([np.zeros(len(values)), tree.shares, np.full(len(values), 255.0)])
    total = without.integral("droplet_scattering")
    for k, share in enumerate(np.diff(ends, axis=0) / 255.0):
        of_class = {"droplet_scattering": without.fields["droplet_scattering"] * share}
        found = replace(without, fields=of_class).integral("droplet_scattering")
        expected = float(plain.scattering_m2[number == k].sum())
        assert found == pytest.approx(expected, abs=total / 255)


def test_one_droplet_divides_only_its_own_branch() -> None:
    """Seven empty siblings a level: 7 x depth leaves, and 8 at the last."""
    tree = build_octree(
        frame(1e-3),
        points(np.array([[0.01, 0.02, 0.03]]), np.ones(1)),
        [],
        optical_depth_split=1e-5,
    )
    assert tree.frame.depth == 8
    assert tree.leaves == (0, *[7] * 7, 8)


def test_thin_vapour_is_not_divided() -> None:
    """Optical depth of a cube below the bound: one leaf; just above it: down to the last level."""
    whole = (np.full((1, 3), -EDGE / 2), np.full((1, 3), EDGE / 2))
    thin = build_octree(
        frame(0.02), None, [boxes(*whole, np.array([0.9e-5 / EDGE]))], optical_depth_split=1e-5
    )
    assert thin.leaves == (1, 0, 0, 0, 0)
    assert thin.has_vapour and not thin.has_droplets
    dense = build_octree(
        frame(0.02), None, [boxes(*whole, np.array([1e-3 / EDGE]))], optical_depth_split=1e-5
    )
    assert dense.leaves == (0, 0, 0, 0, 16**3)


def at(tree: Octree, name: str, cell: tuple[int, int, int]) -> float:
    """A field's value in one finest cell (x, y, z), through the directory."""
    x, y, z = cell
    slot = int(tree.directory[z // 8, y // 8, x // 8])
    inside = ((z % 8) * 8 + y % 8) * 8 + x % 8
    address = slot * 512 + inside if slot >= 0 else tree.slots * 512 - 1 - slot
    return float(tree.fields[name][address])


def test_cells_hold_what_lies_in_them() -> None:
    """Every finest cell against the overlap computed by itself."""
    rng = np.random.default_rng(2)
    where = frame(0.013)
    lower = rng.uniform(-0.09, 0.06, (20, 3))
    upper = lower + rng.uniform(0.001, 0.03, (20, 3))
    vapour = rng.uniform(1, 2, 20)
    tree = build_octree(where, None, [boxes(lower, upper, vapour)], optical_depth_split=0.0)
    low = np.asarray(where.lower_m)
    for cell in np.ndindex(16, 16, 16):
        corner = low + np.asarray(cell) * where.cell_m
        overlap = np.minimum(upper, corner + where.cell_m) - np.maximum(lower, corner)
        expected = np.sum(vapour * np.prod(np.maximum(overlap, 0), axis=1)) / where.cell_m**3
        # Slivers below a millionth of a cell go to the neighbour.
        assert at(tree, "vapour_absorption", cell) == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_empty_tree() -> None:
    tree = build_octree(frame(1e-3), None, [], optical_depth_split=1e-5)
    assert tree.leaves[0] == 1 and not tree.filled.any()
    assert not tree.has_vapour and not tree.has_droplets


def test_outside_is_an_error_that_says_where() -> None:
    with pytest.raises(MediumError, match=r"50 % of the droplets is outside .*domain\.edge_m"):
        build_octree(
            frame(0.02),
            points(np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0]]), np.ones(2)),
            [],
            optical_depth_split=1e-5,
        )
    with pytest.raises(MediumError, match=r"gas .* is outside the domain"):
        build_octree(
            frame(0.02),
            None,
            [boxes(np.full((1, 3), 0.05), np.full((1, 3), 0.2), np.ones(1))],
            optical_depth_split=1e-5,
        )


def test_too_many_cells_is_an_error_that_says_what_to_do() -> None:
    whole = (np.full((1, 3), -EDGE / 2), np.full((1, 3), EDGE / 2))
    with pytest.raises(MediumError, match=r"set domain\.leaf_edge_m above"):
        build_octree(
            frame(1e-3), None, [boxes(*whole, np.ones(1))], optical_depth_split=0.0, max_cells=10**6
        )


def one_by_one(where: Cube, lower: Floats, upper: Floats, vapour: Floats) -> Octree:
    """The tree of boxes that are given some at a time."""
    parts = [slice(start, start + 900) for start in range(0, len(lower), 900)]
    some = [boxes(lower[part], upper[part], vapour[part]) for part in parts]
    return build_octree(where, None, some, optical_depth_split=0.0)


def test_boxes_of_the_cells_lattice_are_laid_in_them() -> None:
    """Each box is in one cell, which gets all of it; boxes off the cells are in several.

    Overlaps have shares that are 1 to 1e-12.
    """
    where = frame(1.7e-3)
    rng = np.random.default_rng(7)
    lower = np.asarray(where.lower_m) + np.argwhere(rng.random((14, 16, 12)) < 0.6) * where.cell_m
    upper, vapour = lower + where.cell_m, rng.uniform(1, 2, len(lower))
    placed = place_boxes(where, lower, upper, content="gas")
    assert isinstance(placed, PlacedPoints)
    found = np.floor(where.to_cells(lower + where.cell_m / 2)).astype(int)
    np.testing.assert_array_equal(placed.cell, found)
    off = lower + 0.25 * where.cell_m
    assert isinstance(place_boxes(where, off, off + where.cell_m, content="gas"), PlacedBoxes)
    together = build_octree(where, None, [boxes(lower, upper, vapour)], optical_depth_split=0.0)
    single = one_by_one(where, lower, upper, vapour)
    np.testing.assert_array_equal(together.directory, single.directory)
    np.testing.assert_allclose(
        together.fields["vapour_absorption"], single.fields["vapour_absorption"], rtol=2e-7
    )


def test_slivers_beyond_a_face_are_kept() -> None:
    """A box whose faces lie within 1e-6 cells of those of cells: its shares still sum to 1."""
    off = np.array([-9e-7, -1e-9, 0.0, 1e-9, 9e-7])
    lower, upper = (face.ravel() for face in np.meshgrid(2.0 + off, 5.0 + off))
    boxes = PlacedBoxes(np.tile(lower[:, None], 3), np.tile(upper[:, None], 3))
    total = np.zeros(len(lower))
    for box, cell, share in boxes.overlaps():
        assert cell.min() == 2 and cell.max() == 4  # and no cell beyond the face
        np.add.at(total, box, share)
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


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
