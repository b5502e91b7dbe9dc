"""Kernels between sweeps against NumPy: scattered light, corrections, error in a cavity."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.transport.angular_moments import MOMENTS, phase_coefficients
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.quadrature import isotropic
from cldit.transport.discrete_ordinates.sweep import Sweeper

from .cell_twin import limit
from .medium import random_tree, sweeper_of

ROUNDINGS = 4e-7  # some of single precision, of numbers up to 2


def random_sweeper(device: Device, flags: dict[str, Any]) -> Sweeper:
    """Sweeper of random cells, a third of which have a gradient with LINEAR_SOURCE."""
    cells = OpticalCells.of(random_tree(3))
    linear = np.arange(len(cells.address)) % 3 == 0 if "LINEAR_SOURCE" in flags else None
    return sweeper_of(device, cells, flags, linear_cells=linear)


@pytest.mark.parametrize("alike", [True, False])
def test_scattered_light_is_numpys(device: Device, alike: bool) -> None:
    """All moments by one phase function or one a cell, and the limited gradient."""
    sweeper = random_sweeper(device, {"MOMENT_SOURCE": 1, "LINEAR_SOURCE": 1})
    rng = np.random.default_rng(2)
    light = rng.uniform(-0.1, 1.0, (MOMENTS, sweeper.components, sweeper.count))
    gradient = rng.uniform(-1.0, 1.0, (3, sweeper.components, len(sweeper.linear_cells)))
    first, second = rng.uniform(0.0, 0.8, (2, 1 if alike else sweeper.count))
    ratios = phase_coefficients(first, second)
    limited = sweeper.scatter(sweeper.listed(light), sweeper.listed(gradient), ratios)

    expected = sweeper.albedo * light
    expected[0] += sweeper.thermal
    mean = expected[0].copy()
    expected[1:] *= ratios[:, None]
    got = sweeper.read(sweeper.source, MOMENTS).reshape(light.shape)
    np.testing.assert_allclose(got, expected, rtol=0, atol=12 * ROUNDINGS)  # ratios up to 12
    steep = sweeper.albedo[sweeper.linear_cells] * gradient
    change = steep.copy()
    limit(change, mean[:, sweeper.linear_cells], sweeper.boundaries)
    assert np.any(np.abs(change - steep) > 0.1) and np.any(np.abs(change - steep) < 0.01)
    np.testing.assert_allclose(sweeper.read_gradient(limited), change, rtol=0, atol=10 * ROUNDINGS)


def test_gradients_of_source_and_radiance_add_up(device: Device) -> None:
    """The gradient of the radiance is that of I - S, beside the source's if it is given."""
    flags = {"LINEAR_SOURCE": 1, "SPATIAL_MOMENTS": 1}
    sweeper = random_sweeper(device, flags)
    rng = np.random.default_rng(2)
    sweeper.set_source(rng.random((sweeper.components, sweeper.count)), shining=True)
    rays, out = sweeper.rays(isotropic(8, rng), rng.random((8, 2))), sweeper.unset_light(1)
    program = sweeper._sweep
    alone = sweeper.read_gradient(sweeper.moments(program, rays, out=out))
    own = rng.uniform(-1.0, 1.0, alone.shape)
    both = sweeper.moments(program, rays, out=out, since=sweeper.listed(own))
    assert np.abs(alone).max() > 0.1
    np.testing.assert_allclose(sweeper.read_gradient(both), own + alone, rtol=0, atol=ROUNDINGS)


@pytest.mark.parametrize("flags", [{}, {"LINEAR_SOURCE": 1, "SPATIAL_MOMENTS": 1}])
def test_boxes_that_share_a_buffer_change_nothing(device: Device, flags: dict[str, Any]) -> None:
    """A box that both orders share, as sources and emission change from sweep to sweep."""
    results = []
    for memory_bytes in (10**9, 0):
        info = replace(device.info, memory_bytes=memory_bytes)
        sweeper = random_sweeper(replace(device, info=info), flags)
        assert sweeper.boxes.apart == bool(memory_bytes)
        rng = np.random.default_rng(2)
        rays, out = sweeper.rays(isotropic(8, rng), rng.random((8, 2))), sweeper.unset_light(1)
        for cavity in (False, True, False):
            for shining in (True, False, True):
                source = rng.random((sweeper.components, sweeper.count))
                sweeper.set_source(source, shining=shining)
                sweeper.sweep(rays, shining=shining, cavity=cavity)
                results.append(sweeper.read(sweeper.next_order()))
        found = sweeper.moments(sweeper._sweep, rays, out=out)
        results.append(sweeper.read(out))
        results.append(np.zeros(0) if found is None else sweeper.read_gradient(found))
    half = len(results) // 2
    for own, shared in zip(results[:half], results[half:], strict=True):
        np.testing.assert_array_equal(own, shared)
    assert not np.array_equal(results[0], results[3])


def test_corrections_are_numpys(device: Device) -> None:
    """Of the source, and of the radiance that it scatters."""
    sweeper = random_sweeper(device, {})
    rng = np.random.default_rng(2)
    space, shape = sweeper.krylov(), (sweeper.components, sweeper.count)
    padded = np.zeros((2, sweeper.components, space.stride))
    padded[..., : sweeper.count] = rng.uniform(-1.0, 1.0, (2, *shape))
    space.onto, residual = (sweeper.listed(each) for each in padded)
    onto, before = padded[..., : sweeper.count]
    source, light = rng.random((2, *shape))
    lit = sweeper.listed(light)
    for given in ((), (lit, residual)):
        corrected = sweeper.read(sweeper.corrected(space, sweeper.listed(source), *given))
        np.testing.assert_allclose(corrected, source + onto, rtol=0, atol=ROUNDINGS)
    more = (onto - before * sweeper.one_minus_lambda) / sweeper.albedo
    # A difference of numbers up to 2, over the albedo.
    apart = np.abs(sweeper.read(lit) - light - more) * sweeper.albedo
    assert apart.max() < 2 * ROUNDINGS


@pytest.mark.parametrize("scattered", [True, False])
def test_the_error_in_a_cavity_is_numpys(device: Device, scattered: bool) -> None:
    """Less the boundary's part of the residual. Without it, it is that of the sweeps alone: in a
    cavity of radiance 1 that is that of the source, less 1."""
    sweeper = random_sweeper(device, {})
    rng = np.random.default_rng(2)
    solution = rng.uniform(0.0, 0.3, (sweeper.components, sweeper.count))
    rays = sweeper.rays(isotropic(8, rng), rng.random((8, 2)))
    listed = sweeper.listed(solution)
    plain = sweeper.defect(listed, rays)
    boundaries = sweeper.boundaries
    even = np.zeros(solution.shape)
    even[:boundaries] = solution[:boundaries]
    even[boundaries] = 1.0 - even.sum(axis=0)
    np.testing.assert_allclose(sweeper.read(sweeper.source), even, rtol=0, atol=ROUNDINGS)
    assert np.abs(plain).max() < 1e-5  # sources are 1 everywhere
    residual = np.zeros((sweeper.components, sweeper.krylov().stride))
    residual[:, : sweeper.count] = rng.uniform(-0.1, 0.1, solution.shape)
    got = sweeper.defect(listed, rays, sweeper.listed(residual), scattered=scattered)
    removed = residual[:boundaries, : sweeper.count].sum(axis=0)
    removed = removed * (sweeper.albedo if scattered else 1.0)
    np.testing.assert_allclose(got, plain - removed, rtol=0, atol=ROUNDINGS)
