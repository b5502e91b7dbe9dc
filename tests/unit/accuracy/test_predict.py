"""Errors of the sources that a scene fixes, estimated on coarse cells."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy import predict
from cldit.accuracy.allocation import Allocation
from cldit.accuracy.errors import Cause, Errors, Estimate
from cldit.accuracy.image_pair import ImageDifference
from cldit.accuracy.predict import coarse_estimates
from cldit.accuracy.sources.base import Measurement
from cldit.accuracy.sources.parcels import PARCELS
from cldit.errors import TransportError
from cldit.medium.frame import Frame
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene, parse_scene

GAS: Any = ("coarse gas", 0.052)  # and the vapour's penetration
VARIANTS: Any = (("one", "other"), "narrower", 0.5)
KNOWN_K = {"one": 1.0, "other": -1.0, "narrower": 0.75, GAS[0]: 9.0}


class Tracer:
    """Images are numbers: the medium's own has an error of `cell_K` in cells of 1 m, of first
    order."""

    def __init__(
        self,
        *,
        cell_K: float = 0.0,
        coarsest: int = 0,
        parcels: Any = None,
        gas: Any = None,
        count: int = 20_000,
    ) -> None:
        self.cell_K, self.coarsest = cell_K, coarsest
        points = SimpleNamespace(position_m=np.zeros((count, 3)))
        kept = {
            "parcels": parcels,
            "gas on cells twice as large": gas,
            "gas on cells four times as large": "12 along the vapour",
        }
        sampled = SimpleNamespace(sampled=True, droplets=np.ones(2))
        self.prepared = SimpleNamespace(
            scene=gdi_flow(),
            cube=Frame((0.0, 0.0, 0.0), edge_m=0.1, depth=7),
            sources=(points, []),
            on_lattice=False,
            cone=None,
            spec=gdi_flow().spray,
            made=SimpleNamespace(parcels=None if parcels is None else sampled),
            spray=SimpleNamespace(vapour=gas, notes={"vapour_penetration_m": 0.05}),
            variant=lambda name, _: kept[name],
        )
        self.scene = SimpleNamespace(camera=SimpleNamespace(field_m=(0.1, 0.1)))
        self.seen: set[int] = set()  # halvings
        self.step = 2.0

    def level(self, cell_m: float) -> float:
        if round(math.log2(0.1 / cell_m)) < self.coarsest:
            raise TransportError("cells reach behind a patch")
        return self.cell_K * cell_m / 0.1

    def grids(self, cell_m: float) -> Any:
        return [(up, self.level(up * cell_m)) for up in (1.0, 2.0, 4.0)]

    def variant(self, _: str, make: Any, cell_m: float) -> float:
        self.seen.add(round(math.log2(0.1 / cell_m)))
        return self.level(cell_m) + KNOWN_K[make()]

    def difference(self, one: float, other: float) -> tuple[ImageDifference, ...]:
        sizes = abs(one - other), 0.5 * abs(one - other)
        return tuple(ImageDifference(size, np.full((2, 2), size)) for size in sizes)


def found(scene: Scene, tracer: Any) -> dict[str, Any]:
    problem: Any = SimpleNamespace(scene=scene, stages=Stages(None))
    estimates = coarse_estimates(problem, tracer)
    return {one.cause.name: (one.error_K, one.cause.at_most) for one in estimates}


def gdi_flow(**sections: dict[str, Any]) -> Scene:
    data = load_scene("gdi-flow").model_dump(mode="json")
    data["spray"]["box"]["spacing_m"] = 1e-3
    for section, values in sections.items():
        data[section].update(values)
    return parse_scene(data)


def test_a_computed_spray() -> None:
    """All on the coarsest cells that will do; an upper bound is marked as one."""
    tracer = Tracer(parcels=VARIANTS, gas=GAS)
    causes = found(gdi_flow(), tracer)
    assert causes["parcels"] == (1.0, False)
    assert causes["deposit width"] == (1.0, True)
    error_K, at_most = causes["gas grid"]
    assert error_K == 9.0 and not at_most
    assert set(causes) == {"parcels", "deposit width", "gas grid"}
    assert tracer.seen == {5}  # 1/32 of the image
    tracer = Tracer(coarsest=6, parcels=VARIANTS, gas=GAS)
    assert found(gdi_flow(), tracer) == causes and tracer.seen == {6}


def test_an_error_that_is_unknown_bounds_nothing() -> None:
    assert found(gdi_flow(), Tracer(gas="above 0.01 m")) == {}


@pytest.mark.parametrize(("parcels", "known"), [(12_999, False), (13_000, True)])
def test_few_parcels_of_a_computed_spray_say_at_least(parcels: int, known: bool) -> None:
    """Their halves share a gas that they drive. Parcels of a case that is read drive none here."""
    tracer: Any = Tracer(parcels=VARIANTS, count=parcels)
    computed = gdi_flow()

    def errors(scene: Scene) -> Errors:
        at = Measurement(scene, tracer, Stages(None), cell_m=2e-3, coarse_m=4e-3)
        return Errors.of(one.cause for one in PARCELS.estimate(at))

    assert errors(computed).unknown == (() if known else ("gas of few parcels",))
    assert errors(computed).text.startswith("at least") != known
    read = computed.model_copy(update={"spray": SimpleNamespace(droplets_per_parcel=None)})
    assert not errors(read).unknown


def test_size_classes_for_their_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of 4 classes falls as one over their number; a lattice within its share stays."""
    scene = load_scene("gdi-cone").with_(
        **{"domain.leaf_edge_m": 1e-3, "spray.size_classes": None, "spray.spacing_m": None}
    )
    allocation = Allocation.of(scene, 1.0)
    large_K = 2.4 * allocation["size classes"]
    errors_K = {"size classes": large_K, "gas grid": 0.5 * allocation["gas grid"]}
    estimates = tuple(Estimate(Cause(name, error_K, "")) for name, error_K in errors_K.items())
    monkeypatch.setattr(predict, "coarse_estimates", lambda *_: estimates)
    cube = Frame((0.0, 0.0, 0.0), edge_m=0.2, depth=7)
    prepared = SimpleNamespace(cube=cube, cone=1, is_empty=False)
    tracer: Any = SimpleNamespace(prepared=prepared, frame=lambda _: cube)
    problem: Any = SimpleNamespace(
        scene=scene, spray=None, stages=Stages(None), predicted={}, is_clear=lambda _: False,
        tracer=lambda resolution: (resolution, tracer),
    )  # fmt: skip
    resolution, asked = predict.predict(problem, 1.0)
    assert resolution.size_classes == 10  # 2.4 times 4
    assert resolution.spacing_m == scene.spray.lattice_m  # type: ignore[union-attr]
    assert asked == allocation and problem.predicted["size classes"].error_K == large_K
