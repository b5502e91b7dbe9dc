"""What a scene errs by whatever is chosen for it, measured on coarse cells."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.budget import Budget
from cldit.accuracy.errors import Errors
from cldit.accuracy.fixed_causes import fixed_causes
from cldit.accuracy.picture import Step
from cldit.errors import TransportError
from cldit.prepare.gas_grid import GasGrid
from cldit.prepare.probed import ParcelVariants
from cldit.scene import Scene, load_scene, parse_scene

GAS: Any = GasGrid("coarse gas", "step", "spray.box.spacing_m")  # type: ignore[arg-type]
PARCELS: Any = ParcelVariants(("one", "other"), "narrower", 0.5)  # type: ignore[arg-type]
KNOWN_K = {"one": 1.0, "other": -1.0, "narrower": 0.75, "coarse gas": 9.0}


class Pilot:
    """Pictures are numbers: the medium's own errs by `cell_K` in cells of 1 m, by first order."""

    def __init__(self, *, cell_K: float = 0.0, coarsest: int = 0, **probed: Any) -> None:
        self.cell_K, self.coarsest = cell_K, coarsest
        points = SimpleNamespace(position_m=np.zeros((20_000, 3)))
        parts = {"parcels": None, "gas": None, "cone": None, "on_lattice": False} | probed
        frame = SimpleNamespace(edge_m=0.1, depth=7)
        self.probed = SimpleNamespace(frame=frame, sources=(points, []), **parts)
        self.scene = SimpleNamespace(camera=SimpleNamespace(field_m=(0.1, 0.1)))
        self.seen: set[int] = set()

    def level(self, depth: int) -> float:
        if depth < self.coarsest:
            raise TransportError("cells reach behind a patch")
        return float(self.cell_K / 2**depth)

    def coarser(self, depth: int) -> Any:
        return (2.0, self.level(depth - 1)), (4.0, self.level(depth - 2))

    def variant(self, _: str, sources: str, depth: int) -> float:
        self.seen.add(depth)
        return self.level(depth) + KNOWN_K[sources]

    def step(self, one: float, other: float) -> Step:
        return Step(abs(one - other), np.full((2, 2), abs(one - other)))


def found(scene: Scene, pilot: Any) -> dict[str, Any]:
    causes = fixed_causes(scene, pilot, lambda _: None)
    return {one.name: (one.error_K, one.at_most) for one in causes}


def gdi_flow(**sections: dict[str, Any]) -> Scene:
    data = load_scene("gdi-flow").model_dump(mode="json")
    for section, values in sections.items():
        data[section].update(values)
    return parse_scene(data)


def test_a_computed_spray() -> None:
    """All on the coarsest cells that will do; what may be too large says so."""
    pilot = Pilot(parcels=PARCELS, gas=GAS)
    causes = found(gdi_flow(), pilot)
    assert causes["parcels"] == (1.0, False)
    assert causes["deposit width"] == (1.0, True)
    error_K, at_most = causes["gas grid"]
    assert error_K == pytest.approx((81.0 - 2.0) ** 0.5) and not at_most
    assert set(causes) == {"parcels", "deposit width", "gas grid"}
    assert pilot.seen == {5}  # 1/32 of the picture
    pilot = Pilot(coarsest=6, parcels=PARCELS, gas=GAS)
    assert found(gdi_flow(), pilot) == causes and pilot.seen == {6}


def test_a_gas_whose_step_may_be_chance_is_a_bound() -> None:
    alone = found(gdi_flow(), Pilot(gas=GAS))
    assert alone == {"gas grid": (9.0, True)}


def test_cells_of_the_scene() -> None:
    """Of 0.1 / 128 m: foretold by those of twice and four times the edge."""
    own = gdi_flow(domain={"leaf_edge_m": 1e-3})
    error_K, at_most = found(own, Pilot(cell_K=256.0))["cells"]
    assert error_K == pytest.approx(2.0) and not at_most
    assert found(gdi_flow(), Pilot(cell_K=256.0)) == {}


def test_an_error_that_is_unknown_bounds_nothing() -> None:
    assert found(gdi_flow(), Pilot(gas=GasGrid(None, "one grid alone"))) == {}


@pytest.mark.parametrize(("parcels", "known"), [(12_999, False), (13_000, True)])
def test_few_parcels_of_a_computed_spray_say_at_least(parcels: int, known: bool) -> None:
    """Their halves share a gas that they drive. Parcels of a case that is read drive none here."""
    pilot: Any = Pilot(parcels=PARCELS)
    pilot.probed.sources = SimpleNamespace(position_m=np.zeros((parcels, 3))), []
    computed = gdi_flow()
    errors = Errors.of(cause for cause, _ in Budget(computed, pilot, 6, print).of_sources())
    assert errors.unknown == (() if known else ("gas of few parcels",))
    assert errors.text.startswith("at least") != known
    read = computed.model_copy(update={"spray": SimpleNamespace(droplets_per_parcel=None)})
    assert not Errors.of(c for c, _ in Budget(read, pilot, 6, print).of_sources()).unknown
