"""Errors of the sources that a scene fixes, estimated on coarse cells."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy import predict
from cldit.accuracy.allocation import Allocation
from cldit.accuracy.errors import Cause, Errors, Estimate
from cldit.accuracy.predict import coarse_estimates
from cldit.accuracy.sources.parcels import PARCELS
from cldit.accuracy.sources.pixel_sampling import PIXEL_SAMPLING
from cldit.accuracy.trace_error import TraceError
from cldit.errors import TransportError
from cldit.medium.frame import Cube
from cldit.prepare.stages import Stages
from cldit.scene import Scene, load_scene
from tests.unit.accuracy.number_images import NumberTracer

GAS: Any = (("sources",), 0.052)  # and the vapour's penetration
VARIANTS: Any = ((1, 2), 3, 0.5)
KNOWN_K = {
    "first half of the parcels": 1.0,
    "second half of the parcels": -1.0,
    "parcels spread less": 0.75,
    "gas on cells twice as large": 9.0,
}


@pytest.fixture(autouse=True)
def _numbers_without_halves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TraceError, "of_halves", lambda *_: ())


def gdi_flow() -> Scene:
    return load_scene("gdi-flow").with_(**{"spray.box.spacing_m": 1e-3})


def tracer_of(
    *,
    coarsest: int = 0,
    parcels: Any = None,
    gas: Any = None,
    count: int = 20_000,
    scene: Scene | None = None,
    image_K: float = 0.0,
) -> Any:
    """The medium's own images are alike; cells of less than `coarsest` halvings fail."""

    def level_K(cell_m: float) -> float:
        if cell_m > 1.001 * 0.2 / 2**coarsest:
            raise TransportError("cells reach behind a patch")
        return image_K

    kept = {
        "parcels": parcels,
        "gas on cells twice as large": gas,
        "gas on cells four times as large": "12 along the vapour",
    }
    sampled = SimpleNamespace(sampled=True, droplets=np.ones(2))
    return NumberTracer(
        level_K,
        KNOWN_K,
        scene=scene or gdi_flow(),
        sources=(SimpleNamespace(position_m=np.zeros((count, 3))), []),
        spec=gdi_flow().spray,
        made=SimpleNamespace(parcels=None if parcels is None else sampled),
        spray=SimpleNamespace(vapour=gas, notes={"vapour_penetration_m": 0.05}),
        is_empty=False,
        variant=lambda name, _: kept[name],
    )


def errors_of(tracer: Any) -> dict[str, tuple[float | None, bool]]:
    return {e.cause.name: (e.error_K, e.cause.at_most) for e in coarse_estimates(tracer)}


def test_a_computed_spray() -> None:
    """All on the coarsest cells that will do; an upper bound is marked as one."""
    tracer = tracer_of(parcels=VARIANTS, gas=GAS)
    assert errors_of(tracer) == {
        "parcels": (1.0, False),
        "deposit width": (1.0, True),
        "gas grid": (9.0, False),
    }
    (depth,) = tracer.varied  # the coarsest
    finer = tracer_of(coarsest=depth + 1, parcels=VARIANTS, gas=GAS)
    assert errors_of(finer) == errors_of(tracer) and finer.varied == {depth + 1}


def test_rays_that_the_scene_fixes_are_known_before_the_cells(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the image on the coarsest cells; free ones wait for the image, as do cells."""

    def estimate(at: Any) -> list[Estimate]:
        return [Estimate(Cause("pixel sampling", at.image, ""))]

    monkeypatch.setattr(PIXEL_SAMPLING, "estimate", estimate)
    keys = {"camera.rays_per_pixel": 1, "domain.leaf_edge_m": 1e-3}
    for scene, errors in (
        (gdi_flow(), {}),
        (gdi_flow().with_(**keys), {"pixel sampling": (7.0, False)}),
    ):
        assert errors_of(tracer_of(scene=scene, image_K=7.0)) == errors


def test_an_error_that_is_unknown_bounds_nothing() -> None:
    assert errors_of(tracer_of(gas="above 0.01 m")) == {}


@pytest.mark.parametrize(("parcels", "known"), [(12_999, False), (13_000, True)])
def test_few_parcels_of_a_computed_spray_say_at_least(parcels: int, known: bool) -> None:
    """Their halves share a gas that they drive. Parcels of a case that is read drive none here."""
    tracer = tracer_of(parcels=VARIANTS, count=parcels)

    def errors() -> Errors:
        return Errors.of(estimate.cause for estimate in PARCELS.estimate(tracer))

    assert errors().unknown == (() if known else ("gas of few parcels",))
    assert errors().text.startswith("at least") != known
    tracer.scene = SimpleNamespace(spray=SimpleNamespace(droplets_per_parcel=None))
    assert not errors().unknown


def test_size_classes_for_their_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of 4 classes falls as one over their number; a lattice within its share stays."""
    scene = load_scene("gdi-cone").with_(
        **{"domain.leaf_edge_m": 1e-3, "spray.size_classes": None, "spray.spacing_m": None}
    )
    allocation = Allocation.of(scene, 1.0)
    large_K = 2.4 * allocation["size classes"]
    errors_K = {"size classes": large_K, "gas grid": 0.5 * allocation["gas grid"]}
    estimates = tuple(Estimate(Cause(name, error_K, "")) for name, error_K in errors_K.items())
    monkeypatch.setattr(predict, "coarse_estimates", lambda _: estimates)
    cube = Cube((0.0, 0.0, 0.0), edge_m=0.2, depth=7)
    prepared = SimpleNamespace(cube=cube, cone=1, is_empty=False, is_clear=False)
    tracer: Any = SimpleNamespace(prepared=prepared, frame=lambda _: cube, predicted={})
    problem: Any = SimpleNamespace(
        scene=scene, spray=None, stages=Stages(None),
        tracer=lambda resolution: (resolution, tracer),
    )  # fmt: skip
    resolution, asked = predict.predict(problem, 1.0)
    assert resolution.size_classes == 10  # 2.4 times 4
    assert resolution.spacing_m == scene.spray.lattice_m  # type: ignore[union-attr]
    assert asked == allocation and tracer.predicted["size classes"].error_K == large_K
