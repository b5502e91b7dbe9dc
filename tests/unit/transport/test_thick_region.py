"""The region around thick cells: its faces, and where rays come through them."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.medium.frame import Frame
from cldit.medium.octree import CellSource, build_octree
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.segments import Segments
from cldit.transport.thick_region import ThickRegion
from cldit.transport.tuning import Tuning


def scattered_cells(seed: int) -> OpticalCells:
    """Cells of optical depth 0 to 1 here and there in a cube of 32, at its sides too."""
    rng = np.random.default_rng(seed)
    frame = Frame(lower_m=(0.0, 0.0, 0.0), edge_m=0.32, depth=5)
    place = np.argwhere(rng.random((32, 32, 32)) < 0.02)
    lower = place * frame.cell_m
    half = rng.uniform(0.0, 0.5, len(place)) / frame.cell_m
    source = CellSource(
        lower_m=np.asarray(lower, np.float64),
        upper_m=np.asarray(lower + frame.cell_m, np.float64),
        vapour_absorption=0 * half,
        vapour_emission=0 * half,
        droplet_absorption=half,
        droplet_scattering=half,
        droplet_emission=half,
    )
    return OpticalCells.of(build_octree(frame, None, [source], optical_depth_split=1e-5))


def test_faces_of_the_region() -> None:
    """It holds the thick cells and what shares a face with them. Every face to another cell of the
    box has a number, and those that one direction goes through have different ones."""
    cells = scattered_cells(3)
    box = cells.box()
    thick = ThickRegion.of(cells, box, deeper_than=0.6, tuning=Tuning())
    assert thick is not None
    at = {tuple(place) for place in cells.positions(cells.address[thick.listed]) - box.low}
    beside = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    inside = {
        tuple(near)
        for place in at
        for near in (np.array(place), *(np.array(place) + beside))
        if np.all(near >= 0) and np.all(near < box.shape)
    }
    assert {tuple(place) for place in thick.at} == inside
    for place, faces in zip(thick.at, thick.faces, strict=True):
        for side, number in enumerate(faces):
            step = np.zeros(3, int)
            step[side // 2] = 2 * (side % 2) - 1
            near = place + step
            there = np.all(near >= 0) and np.all(near < box.shape)
            assert (number >= 0) == (there and tuple(near) not in inside)
    number_of = {tuple(place): number for number, place in enumerate(thick.at)}
    for place, faces, next_ in zip(thick.at, thick.faces, thick.beside, strict=True):
        for side in range(6):  # the next cell; else a face; else the side of the box
            near = place.copy()
            near[side // 2] += 2 * (side % 2) - 1
            face = -2 - faces[side] if faces[side] >= 0 else -1
            assert next_[side] == number_of.get(tuple(near), face)
    for signs in np.ndindex(2, 2, 2):
        met = thick.faces[:, [2 * axis + up for axis, up in enumerate(signs)]]
        met = met[met >= 0]
        assert len(np.unique(met)) == len(met)
        assert met.max() < thick.interfaces
    assert thick.faces.max() == thick.interfaces - 1
    stored = thick.address >= 0
    np.testing.assert_array_equal(
        cells.positions(thick.address[stored]) - box.low, thick.at[stored]
    )


def test_no_thick_cell() -> None:
    cells = scattered_cells(3)
    assert ThickRegion.of(cells, cells.box(), deeper_than=2.0, tuning=Tuning()) is None


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.37, -0.81), (-1.0, 1.0), (1e-9, 0.5)])
def test_where_rays_leave_cells(slopes: tuple[float, float], backwards: bool) -> None:
    """The last segment of a layer leaves along l, and along u and v at least one does: where rays
    enter the next cell, if they do."""
    start = np.array([[0.21, 0.64]])
    rays = Segments.of(np.array([slopes]), start, layers=40, backwards=np.array([backwards]))
    last = np.diff(rays.layer, append=-9) != 0
    np.testing.assert_array_equal(rays.exits[:, 2], last)
    for moved, leaves in zip(rays.shift.T, rays.exits.T[:2], strict=True):
        goes = np.diff(moved, append=moved[-1]) != 0
        np.testing.assert_array_equal(leaves[~last], goes[~last])
        assert np.all(
            np.bincount(rays.layer, leaves) == np.maximum(np.bincount(rays.layer, goes & ~last), 1)
        )
