"""Coefficients that are linear in cells: what they conserve, and that nothing falls below 0."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from cldit.medium.frame import Frame
from cldit.medium.octree import CellSource, build_octree
from cldit.transport.cells import OpticalCells
from tests.kernels.cell_twin import RecordsTwin, linear_of, middles_of

CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))


def random_cells(seed: int, *, isothermal: bool = False) -> OpticalCells:
    """Coefficients over four decades, each phase here and there."""
    rng = np.random.default_rng(seed)
    frame = Frame(lower_m=(0.0, 0.0, 0.0), edge_m=0.32, depth=5)
    place = np.argwhere(rng.random((32, 32, 32)) < 0.4)
    lower = np.asarray(place * frame.cell_m, np.float64)
    some = rng.random((3, len(place))) < 0.7
    gas, absorbing, scattering = 10.0 ** rng.uniform(-2, 2, (3, len(place))) * some
    hot = np.ones((2, len(place))) if isothermal else rng.uniform(0.01, 1.0, (2, len(place)))
    source = CellSource(
        lower_m=lower,
        upper_m=np.asarray(lower + frame.cell_m, np.float64),
        vapour_absorption=gas,
        vapour_emission=hot[0] * gas,
        droplet_absorption=absorbing,
        droplet_scattering=scattering,
        droplet_emission=hot[1] * absorbing,
    )
    return OpticalCells.of(build_octree(frame, None, [source], optical_depth_split=1e-9))


def planes(cells: OpticalCells) -> NDArray[np.float64]:
    """Albedo and emission (3, P) of a medium."""
    albedo = np.zeros(len(cells.depth))
    albedo[cells.address] = cells.albedo
    return np.stack([albedo, *(cells.emitted[name] for name in cells.needs.emitters)])


def test_never_below_zero() -> None:
    """At any corner, with what is taken from the middle; and no more is scattered than is taken."""
    cells = random_cells(1)
    gradients = np.stack([linear_of(cells).albedo, *linear_of(cells).emission]).astype(float)
    corners = planes(middles_of(cells))[..., None] + gradients @ CORNERS.T
    assert corners.min() > -1e-6
    assert corners[0].max() < 1 + 1e-6
    assert np.mean(np.abs(gradients).max(axis=2) > 0) > 0.1
    assert (1 + linear_of(cells).extinction.astype(float) @ CORNERS.T).min() > 0


def test_a_cell_emits_and_scatters_what_its_means_say() -> None:
    """By Gauss's rule of two points an axis, which is exact for products of linear functions."""
    cells = random_cells(2)
    points = CORNERS / 3**0.5
    extinction = 1 + linear_of(cells).extinction.astype(float) @ points.T
    np.testing.assert_allclose(extinction.mean(axis=1), 1.0, atol=1e-6)
    gradients = np.stack([linear_of(cells).albedo, *linear_of(cells).emission]).astype(float)
    values = planes(middles_of(cells))[..., None] + gradients @ points.T
    found = np.mean(extinction * values, axis=2)
    np.testing.assert_allclose(found, planes(cells), atol=2e-7)


def test_isothermal_medium_stays_so() -> None:
    """Emission and albedo change oppositely: in a cavity nothing shows."""
    linear = random_cells(3, isothermal=True)
    changes = linear_of(linear).albedo + linear.scale * linear_of(linear).emission.sum(axis=0)
    assert np.abs(linear_of(linear).albedo).max() > 0.2
    np.testing.assert_allclose(changes, 0.0, atol=1e-6)


def test_sources_of_the_image() -> None:
    """Mean over a cell, weighted by extinction, as given; none below 0 at a corner. Thick cells
    have the gradients of the medium's own emission, and of what it leaves to the gather."""
    cells = random_cells(4)
    made = RecordsTwin.of(cells, linear=True)
    rng = np.random.default_rng(5)
    count, inner = len(cells.address), cells.needs.boundaries
    light = rng.random((2, 4, count))
    light /= light[:, :inner].sum(axis=1, keepdims=True)
    thermal = cells.thermal_source()
    given = [(thermal + cells.albedo * one).astype(np.float32) for one in light]
    gradient = rng.normal(size=(3, 4, count)).astype(np.float32) * 0.1
    thick = np.arange(0, count, 7)
    sources, table = made.linear_sources(list(given), gradient, thick)
    steep = table.reshape(len(made.at), 3, 4)
    own = linear_of(cells)
    at = cells.address[thick]
    np.testing.assert_array_equal(steep[thick][:, :, 0], own.albedo[at])
    assert not steep[thick][:, :, 1:inner].any()
    emission = steep[thick][:, :, inner:].transpose(2, 0, 1)
    np.testing.assert_array_equal(emission, own.emission[:, at])
    points = CORNERS / 3**0.5
    extinction = 1 + linear_of(cells).extinction[cells.address].astype(float) @ points.T
    for source, before in zip(sources, given, strict=True):
        assert source is not None and source is not before
        change = np.einsum("pic,ki->cpk", steep[:count].astype(float), points)
        found = np.mean((source[..., None] + change) * extinction, axis=2)
        plain = np.setdiff1d(np.arange(count), thick)
        np.testing.assert_allclose(found[:, plain], before[:, plain], atol=1e-6)
    mean = np.mean([one for one in sources if one is not None], axis=0)
    corners = mean[..., None] + np.einsum("pic,ki->cpk", steep[:count].astype(float), CORNERS)
    assert corners[:, np.setdiff1d(np.arange(count), thick)].min() > -1e-6
