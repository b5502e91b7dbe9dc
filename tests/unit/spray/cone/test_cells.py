"""Cells of the cone: merged, thinned and measured as by ways that are slower and plainer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.scene import load_scene
from cldit.scene.spray import ConeSpray, Plume
from cldit.spray.cone import plume_cells as cone
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
