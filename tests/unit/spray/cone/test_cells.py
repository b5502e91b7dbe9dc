"""Cells of the cone against slower and plainer ways; plumes draw each other together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.scene import load_scene
from cldit.scene.spray import ConeSpray, Plume
from cldit.spray.cone import plume_cells as cone
from cldit.spray.cone.attraction import displaced_m
from cldit.spray.cone.jet import Jet
from cldit.spray.cone.plume_cells import NEGLIGIBLE, plume_cells
from tests.cones import cone_spray


def test_plumes_that_share_cells_add_up(monkeypatch: pytest.MonkeyPatch, device: Device) -> None:
    """Merged by one stable sort: the same sums, to the last bit, as by a dictionary of parts."""
    spec = load_scene("gdi-cone").spray.model_copy(update={"spacing_m": 1.5e-3})
    assert isinstance(spec, ConeSpray)
    made: list[Any] = []
    filled = cone._filled

    def kept(*given: Any) -> Any:
        made.append(filled(*given))
        return made[-1]

    monkeypatch.setattr(cone, "_filled", kept)
    cells = plume_cells(spec, device, injected=1e-6)
    total = sum(one.mass_fraction for one in spec.plumes)
    found: dict[tuple[int, ...], float] = {}
    for one, (cell, part, amount, _, _) in zip(spec.plumes, made, strict=True):
        masses = amount * (one.mass_fraction / total * 1e-6 / amount.sum())
        for *key, mass in zip(*cell.tolist(), part.tolist(), masses.tolist(), strict=True):
            found[tuple(key)] = found.get(tuple(key), 0.0) + mass
    assert len(found) < sum(len(part) for _, part, *_ in made)  # some parts are shared
    parts = sorted(found)
    all_mass = np.array([found[part] for part in parts])
    order = np.argsort(all_mass, kind="stable")
    left = np.sort(order[np.cumsum(all_mass[order]) > NEGLIGIBLE * 1e-6])
    np.testing.assert_array_equal(cells.mass_kg, all_mass[left] * (1e-6 / all_mass[left].sum()))
    count = np.diff(np.append(cells.start, len(left)))
    expected = np.array(parts)[left, :3]
    np.testing.assert_array_equal(np.repeat(cells.cell, count, axis=0), expected)
    assert count.max() > 100 and count.min() == 1  # in the fine part near the nozzle, and beyond


def test_cells_near_the_nozzle_have_the_mass_of_finer_ones(device: Device) -> None:
    """Cells of 0.8 mm in the first 6 mm, against the sums of 8^3 cells of 0.1 mm: 4 % RMS, half as
    much with each halving of the parts (49 % without them)."""
    spec = ConeSpray(plumes=(Plume(inclination_deg=30.0, azimuth_deg=20.0),), time_s=5e-5)
    sums: list[dict[tuple[int, ...], float]] = []
    for h, times in ((0.8e-3, 1), (0.1e-3, 8)):
        wanted = spec.model_copy(update={"spacing_m": h})
        made = plume_cells(wanted, device, injected=1e-6)
        sums.append({})
        for cell, mass in zip(made.cell // times, made.total(made.mass_kg), strict=True):
            sums[-1][tuple(cell)] = sums[-1].get(tuple(cell), 0.0) + float(mass)
    coarse, fine = sums
    pairs = np.array([(coarse.get(at, 0.0), fine.get(at, 0.0)) for at in {*coarse, *fine}])
    assert np.std(pairs[:, 0] - pairs[:, 1]) < 0.06 * np.sqrt(np.mean(pairs[:, 1] ** 2))


def test_liquid_depth_is_that_of_the_parcels() -> None:
    spray = cone_spray(ConeSpray(spacing_m=1e-3))
    assert spray.parcels is not None
    layer = np.floor(-spray.parcels.position_m[:, 2] / 1e-3).astype(int)
    below = np.append(0.0, np.cumsum(np.bincount(layer, spray.parcels.masses_kg)))
    depth = 1e-3 * np.interp(0.97 * below[-1], below, np.arange(len(below)))
    # Sums of the same masses in another order.
    assert spray.notes["liquid_penetration_m"] == pytest.approx(depth, rel=1e-12)


JET = Jet(
    rate_kg_s=1.6e-3,
    speed_m_s=224.0,
    half_angle_rad=np.radians(11.0),
    fuel_kg_m3=616.0,
    gas_kg_m3=3.55,
)


def _ring(count: int, inclination_deg: float) -> list[np.ndarray]:
    tilt, turn = np.radians(inclination_deg), 2 * np.pi * np.arange(count) / count
    down = np.full(count, -np.cos(tilt))
    return list(np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), down], axis=1))


def _displaced(axes: list[np.ndarray], time_s: float) -> list[tuple[np.ndarray, np.ndarray]]:
    return displaced_m(axes, [JET] * len(axes), [JET.tip_m(time_s)] * len(axes))


def test_symmetry() -> None:
    """One plume stays on its axis, and so does one in the middle of a ring, to rounding; plumes of
    a ring turn towards its axis, all alike."""
    ((_, alone),) = _displaced([np.array([0.0, 0.0, -1.0])], 0.7e-3)
    assert not alone.any()
    axes = [np.array([0.0, 0.0, -1.0]), *_ring(6, 25.0)]
    middle, *ring = (path for _, path in _displaced(axes, 0.7e-3))
    assert np.abs(middle[:, :2]).max() < 1e-12
    inwards = [-path[:, :2] @ axis[:2] for axis, path in zip(axes[1:], ring, strict=True)]
    assert np.allclose(inwards, inwards[0], rtol=1e-9)
    assert inwards[0][:90].min() > 0  # the heads push each other apart


def test_ring_turns_as_in_the_computed_spray() -> None:
    """Eight plumes at 33 degrees, 0.7 ms: mean inclination of the liquid of `gdi-flow` in shells of
    4 mm, with gas cells of 0.5 mm. 1 degree: its droplets fill cones, and begin 0.6 too far out."""
    axes = _ring(8, 33.0)
    along, path = _displaced(axes, 0.7e-3)[0]
    out = np.array([np.cos(np.radians(33.0)), 0.0, np.sin(np.radians(33.0))])
    for s_mm, inclination_deg in ((10, 31.5), (18, 29.5), (26, 29.1), (34, 30.2)):
        turned = np.degrees(np.interp(s_mm * 1e-3, along, path @ out) / (s_mm * 1e-3))
        assert 33.0 + turned == pytest.approx(inclination_deg, abs=1.0), s_mm
