"""Cells of the cone: merged, thinned and measured as by ways that are slower and plainer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.scene import load_scene
from cldit.scene.spray import ConeSpray
from cldit.spray.cone import spray as cone
from cldit.spray.cone.nozzle import nozzle_flow
from cldit.spray.cone.spray import NEGLIGIBLE, _grid, _thinnest, make_cone


def test_plumes_that_share_cells_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Merged by one stable sort: the same sums, to the last bit, as by a dictionary of cells."""
    spec = load_scene("gdi").spray.model_copy(update={"spacing_m": 1.5e-3})
    assert isinstance(spec, ConeSpray)
    made: list[Any] = []
    plume = cone._plume

    def kept(*given: Any) -> Any:
        made.append(plume(*given))
        return made[-1]

    monkeypatch.setattr(cone, "_plume", kept)
    index, mass, _, _ = _grid(spec, nozzle_flow(spec), injected=1e-6)
    total = sum(one.mass_fraction for one in spec.plumes)
    found: dict[tuple[int, ...], float] = {}
    for one, (cells, content, _, _) in zip(spec.plumes, made, strict=True):
        share = one.mass_fraction / total * 1e-6
        for cell, held in zip(cells.tolist(), content * (share / content.sum()), strict=True):
            found[tuple(cell)] = found.get(tuple(cell), 0.0) + float(held)
    assert len(found) < sum(len(cells) for cells, *_ in made)  # some cells are shared
    cells = sorted(found)
    all_mass = np.array([found[cell] for cell in cells])
    order = np.argsort(all_mass, kind="stable")
    left = np.sort(order[np.cumsum(all_mass[order]) > NEGLIGIBLE * 1e-6])
    np.testing.assert_array_equal(index, np.array(cells)[left])
    np.testing.assert_array_equal(mass, all_mass[left] * (1e-6 / all_mass[left].sum()))


@pytest.mark.parametrize("most", [0.0, 1e-9, 1e-3, 0.3, 1.0])
def test_the_thinnest_are_those_of_a_whole_sort(most: float) -> None:
    amount = np.random.default_rng(5).lognormal(sigma=4.0, size=5000)
    order = np.argsort(amount, kind="stable")
    bound = most * amount.sum()
    expected = order[np.cumsum(amount[order]) <= bound]
    np.testing.assert_array_equal(_thinnest(amount, bound), expected)
    assert len(_thinnest(np.zeros(3), 0.0)) == 3


def test_liquid_depth_is_that_of_the_parcels() -> None:
    spray = make_cone(ConeSpray(spacing_m=1e-3))
    assert spray.parcels is not None
    layer = np.floor(-spray.parcels.position_m[:, 2] / 1e-3).astype(int)
    below = np.append(0.0, np.cumsum(np.bincount(layer, spray.parcels.masses_kg)))
    depth = 1e-3 * np.interp(0.97 * below[-1], below, np.arange(len(below)))
    # Sums of the same masses in another order.
    assert spray.notes["liquid_penetration_m"] == pytest.approx(depth, rel=1e-12)
