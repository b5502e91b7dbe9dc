"""GMRES, its defect correction, and the device memory of the stages."""

from __future__ import annotations

import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.errors import NotConvergedError
from cldit.gpu.device import Device
from cldit.transport.angular_moments import MOMENTS
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gmres import defect_correction, gmres, order_0
from cldit.transport.discrete_ordinates.quadrature import isotropic
from cldit.transport.discrete_ordinates.sweep import Sweeper
from cldit.transport.trace import trace
from tests.phase_tables import henyey_greenstein

from .medium import random_tree, scene_of, settings_of, sweep_program, sweeper_of


def _rms(values: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))


@pytest.mark.parametrize("deeper", [1.0, 30.0])
def test_correction_along_more_directions(device: Device, deeper: float) -> None:
    """A solution of few ordinates, corrected by one sweep along many, is that of the many up to the
    second order of their difference. So it is closer than after one more scattering along the many,
    and that is closer than before. The radiance is that of the source."""
    tree = random_tree(3, scattering=deeper)
    cells = OpticalCells.of(tree)
    sweeper = sweeper_of(device, cells)
    rng = np.random.default_rng(4)
    few, many = (
        sweeper.rays(isotropic(count, rng).balanced(), rng.random((count, 2))) for count in (8, 128)
    )
    guess = order_0(sweeper, cells.albedo)
    truth = sweeper.read(gmres(sweeper, guess, many, tolerance=1e-6).source)
    rough = gmres(sweeper, guess, few, tolerance=1e-6)
    sweeper.set_source(rough.source, shining=True)
    sweeper.sweep(many, shining=True)
    light = (sweeper.read(sweeper.next_order()) - sweeper.thermal) / cells.albedo
    radiance = sweeper.listed(light)
    better = defect_correction(sweeper, rough, few, tolerance=1e-6, light=radiance)
    source = sweeper.read(better.source)
    first = _rms(sweeper.read(rough.source) - truth)
    again = _rms(cells.albedo * light + sweeper.thermal - truth)
    assert _rms(source - truth) < 0.5 * again < 0.5 * first
    assert first > 1e-3  # or there was nothing to correct
    scattered = cells.albedo * sweeper.read(radiance) + sweeper.thermal
    # To what GMRES leaves, half of 1e-6, times the share that it is divided by, at most 1.
    assert _rms(scattered - source) < 1e-6
    assert better.iterations > rough.iterations
    assert _rms(sweeper.krylov().read(better.residual)) < 1e-6


def test_the_correction_ends(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cycles of four vectors; each reduces the residual, but four iterations are all there are."""
    cells = OpticalCells.of(random_tree(3, scattering=30.0))
    sweeper = sweeper_of(device, cells)
    rng = np.random.default_rng(4)
    few, many = (
        sweeper.rays(isotropic(count, rng).balanced(), rng.random((count, 2))) for count in (8, 128)
    )
    rough = gmres(sweeper, order_0(sweeper, cells.albedo), few, tolerance=1e-3)
    sweeper.set_source(rough.source, shining=True)
    sweeper.sweep(many, shining=True)
    short = replace(sweeper.tuning, iterations=rough.iterations + 4, krylov=4)
    monkeypatch.setattr(sweeper, "tuning", short)
    with pytest.raises(NotConvergedError, match=rf"after {rough.iterations + 4} iterations"):
        defect_correction(sweeper, rough, few, tolerance=1e-12)


def test_one_sweeper_at_a_time(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a phase function two media are swept, each by a sweeper of its own. The solver's is
    released, with all its buffers, before the other is made; no scratch outlives its sweeps."""
    alive: weakref.WeakSet[Sweeper] = weakref.WeakSet()
    made = []
    init = Sweeper.__init__

    def counted(self: Sweeper, *given: Any, **named: Any) -> None:
        made.append(len(alive))
        alive.add(self)
        init(self, *given, **named)

    monkeypatch.setattr(Sweeper, "__init__", counted)
    scene = scene_of()
    settings = settings_of(phase=henyey_greenstein(0.8), max_samples=64, accuracy_K=10.0)
    trace(random_tree(6), scene, device, settings)
    assert made == [0, 0]
    assert not alive


@pytest.mark.parametrize("many", [1, MOMENTS])
def test_residual_after_moments(device: Device, many: int) -> None:
    """A sweep for moments leaves the I - S from which the residual follows, as a sweep for it."""
    cells = OpticalCells.of(random_tree(3))
    sweeper = sweeper_of(device, cells)
    rng = np.random.default_rng(4)
    rays = sweeper.rays(isotropic(12, rng), rng.random((12, 2)))
    sweeper.set_source(rng.random((sweeper.components, sweeper.count)), shining=True)
    space = sweeper.krylov()
    sweeper.sweep(rays, shining=True)
    sweeper.residual(space, space.left, shining=True)
    program = sweep_program(device, cells, {"ANGULAR_MOMENTS": 1} if many > 1 else {})
    room = sweeper.room(many)
    sweeper.moments(program, rays, out=sweeper.unset_light(many), room=room)
    listed = room[1] if many > 1 else None
    sweeper.residual(space, space.image, shining=True, listed=listed)
    expected = space.read(space.left)
    assert _rms(expected) > 0.1
    # Rounding of twelve terms, over 1 - Lambda*, which is of order 1 in these cells.
    np.testing.assert_allclose(space.read(space.image), expected, atol=2e-6)
