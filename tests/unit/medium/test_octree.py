"""The octree: what goes in comes out, and it divides where the paper says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.errors import MediumError
from cldit.medium.deposit import PlacedBoxes, PlacedPoints, place_boxes
from cldit.medium.frame import Frame
from cldit.medium.octree import FIELDS, CellSource, Octree, PointSource, build_octree

EDGE = 0.2
Floats = NDArray[np.float64]


def frame(leaf_edge_m: float) -> Frame:
    return Frame.around(centre_m=(0.0, 0.0, 0.0), edge_m=EDGE, leaf_edge_m=leaf_edge_m)


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


def one_by_one(where: Frame, lower: Floats, upper: Floats, vapour: Floats) -> Octree:
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
