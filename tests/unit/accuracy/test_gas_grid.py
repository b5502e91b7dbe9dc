"""The error of a computed gas's own cells, by sprays on cells twice and four times as large."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.accuracy.errors import Errors
from cldit.accuracy.remarks import too_large
from cldit.accuracy.sources.gas_grid import (
    GAS_GRID,
    ORDER,
    Rest,
    coarser_gas,
    head_error_m,
)
from cldit.errors import MediumError, SprayError
from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.octree import CellSource, Sources
from cldit.prepare import medium
from cldit.prepare.stages import Stages
from cldit.run import simulate
from cldit.scene import Scene, load_scene, parse_scene
from cldit.scene.spray import LagrangianSpray
from cldit.spray.result import Cells, Parcels, Spray, Vapour
from tests.unit.accuracy.number_images import NumberTracer

H = 1e-3
CUBE = Cube.around(centre_m=(0.0, 0.0, 0.0), edge_m=0.064, leaf_edge_m=2e-3)


def vapour(h_m: float = H, *, long: int = 24) -> Vapour:
    """A column of gas, `long` cells high."""
    cells = Cells.regular(
        origin_m=np.array([-2 * h_m, -2 * h_m, -0.03]),
        spacing_m=np.full(3, h_m),
        shape=(4, 4, long),
    )
    one = np.ones(len(cells.lower_m))
    return Vapour(cells, 1e24 * one, 480.0 * one, 0.1)


def prepared(gas: Vapour, resprayed: Any) -> Any:
    edge_m = float(gas.cells.upper_m[0, 0] - gas.cells.lower_m[0, 0])
    spray = SimpleNamespace(vapour=gas, notes={"gas_spacing_m": round(edge_m, 9)})
    notes = {"vapour_penetration_m": 0.03}
    return SimpleNamespace(
        spray=spray,
        stages=Stages(None),
        cube=CUBE,
        other_spray=lambda spec: SimpleNamespace(spec=spec, notes=notes),
        sources_of=lambda other: resprayed(other.spec),
    )


def test_the_same_spray_on_cells_twice_as_large() -> None:
    asked: list[LagrangianSpray] = []

    def made(spec: LagrangianSpray) -> Sources:
        asked.append(spec)
        return None, []

    spec = LagrangianSpray(seed=7)
    for up in (2, 4):
        found = coarser_gas(prepared(vapour(long=48), made), spec, up)
        assert not isinstance(found, str) and found[1] == 0.03
        other = asked.pop()
        assert other.box.spacing_m == up * spec.box.cell_m
        data = other.model_dump()
        data["box"]["spacing_m"] = spec.box.spacing_m
        assert data == spec.model_dump()


@pytest.mark.parametrize(
    ("spacing_m", "here", "why"),
    [
        (1e-3, vapour(long=11), "5.5 along the vapour"),  # 6 are 12 of those of half the edge
        (1e-3, vapour(2e-3), "the spray was given"),
        (6e-3, vapour(6e-3, long=24), "above 0.01 m"),
        (1e-3, vapour(), "the gas is too fast"),
    ],
)
def test_no_spray_where_none_tells(spacing_m: float, here: Vapour, why: str) -> None:
    def fails(_: LagrangianSpray) -> Sources:
        raise SprayError("the gas is too fast")

    spec = LagrangianSpray(box={"spacing_m": spacing_m})
    found = coarser_gas(prepared(here, fails), spec, 2)
    assert isinstance(found, str) and why in found


def test_too_much_outside_is_no_answer() -> None:
    """One part in a thousand of the gas is what may be lost."""
    low = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0]])
    none = np.zeros(2)
    for inside, known in ((500.0, False), (1100.0, True)):
        absorption = np.array([inside, 1.0])
        gas = CellSource(low, low + 2e-3, absorption, 2 * absorption, none, none, none)
        sources: Sources = (None, [gas])
        found = coarser_gas(prepared(vapour(), lambda _, s=sources: s), LagrangianSpray(), 2)
        assert isinstance(found, str) != known
        assert known or "0.2 % of the spray" in found


@pytest.mark.parametrize(
    ("steps_K", "factor"),
    [
        ((4.0, 8.0, 12.0), 1.0),  # 4 C h and 8 C h, all of one sign: Richardson's, order 1
        ((5.0, 50.0**0.5, 75.0**0.5), 1.0),  # fronts, order 1: half the displacement, 0.71 the RMS
        ((6.0, 60.0**0.5, 96.0**0.5), 1.5**0.5),  # fronts, slower: 0.6 of the displacement
        ((4.0, 8.0, 80.0**0.5), 0.6**0.5),  # fronts: no higher order than 1.4 is relied on
        ((4.0, 8.0, 4.0), 0.6**0.5),  # of opposite sign: as unrelated
        ((15.2, 17.7, 32.9), "steps are 18 and 15 K"),  # hardly smaller on smaller cells
        ((None, 8.0, 12.0), "unknown"),
    ],
)
def test_the_steps_that_are_left_are_summed(
    steps_K: tuple[float | None, float | None, float | None], factor: float | str
) -> None:
    last_K, before_K, both_K = steps_K
    found = Rest.of(last_K, before_K, both_K)
    if isinstance(factor, float):
        assert isinstance(found, Rest) and found.factor == pytest.approx(factor)
    else:
        assert isinstance(found, str) and factor in found


@pytest.mark.parametrize(("order", "width"), [(1.0, 0), (0.7, 2000)])
def test_the_error_of_a_displaced_front(order: float, width: int) -> None:
    """An edge, and a slope wider than its displacements, displaced by 512 (h / h0)^order of 8192
    pixels: the estimate from three grids is the difference from the edge in its place. To 2 % the
    edge's displacements are whole pixels; the ends of the slope make 5 %."""

    def image(cells: float) -> NDArray[np.float64]:
        place = np.arange(8192.0) - 3000.0 - round(512 * cells**order)
        return np.asarray(30.0 * (np.clip(place / width, 0.0, 1.0) if width else place > 0.0))

    def step_K(one: float, other: float) -> float:
        return float(np.sqrt(np.mean((image(one) - image(other)) ** 2)))

    finest = 0.25
    found = Rest.of(step_K(2 * finest, finest), step_K(4 * finest, 2 * finest),
                    step_K(4 * finest, finest))  # fmt: skip
    assert isinstance(found, Rest)
    stated_K = found.factor * step_K(2 * finest, finest)
    assert stated_K == pytest.approx(step_K(finest, 0.0), rel=0.05 if width else 0.02)


@pytest.mark.parametrize(
    ("heads_mm", "error_mm"),
    [((52.0, 53.0, 55.0), 1.0), ((52.0, 52.1, 55.1), 1.5), ((52.0, 51.0), 1.0)],
)
def test_the_error_of_the_heads(heads_mm: tuple[float, ...], error_mm: float) -> None:
    """First order leaves as much as the last step, and half of the one before."""
    assert head_error_m([1e-3 * one for one in heads_mm]) == pytest.approx(1e-3 * error_mm)


SPRAY: Any = (("sources",), 0.052)  # and the vapour's penetration
TWICE, FOUR = "gas on cells twice as large", "gas on cells four times as large"


def own_cells(cell_m: float) -> float:
    """The image on its own cells: larger ones would blur those of the gas."""
    assert cell_m == 1e-3
    return 0.0


def errors_of(
    gas: Any, once_K: float | Exception = 9.0, *, more: Any = "too few", twice_K: float = 27.0
) -> Errors:
    tracer: Any = NumberTracer(
        own_cells,
        {TWICE: once_K, FOUR: twice_K},
        scene=scene(),
        spec=scene().spray,
        made=SimpleNamespace(parcels=None),
        spray=SimpleNamespace(vapour=gas, notes={"vapour_penetration_m": 0.05}),
        variant=lambda name, _: {TWICE: gas, FOUR: more}[name],
    )
    estimates = GAS_GRID.of(tracer)
    heads = {name: error for one in estimates for name, error in one.figures.items()}
    known = not isinstance(gas, str | None) and not isinstance(once_K, Exception)
    assert heads == ({"vapour_penetration_m": pytest.approx(2e-3)} if known else {})
    return Errors.of(one.cause for one in estimates)


def test_the_error_is_stated() -> None:
    (cause,) = errors_of(SPRAY, more=SPRAY).causes
    assert (cause.name, cause.fixed) == ("gas grid", "spray.box.spacing_m")
    assert cause.error_K == pytest.approx(9.0) and "correlation 1" in cause.how
    (remark,) = too_large(errors_of(SPRAY), 1.0, {})
    assert "gas grid contributes 9 K" in remark
    assert "allowed: a smaller spray.box.spacing_m" in remark
    assert errors_of(None).causes == ()
    (cause,) = errors_of("one grid alone").causes
    assert cause.error_K is None and cause.how == "one grid alone"
    (cause,) = errors_of(SPRAY, MediumError("more than memory holds")).causes
    assert cause.error_K is None and "more than memory holds" in cause.how


def test_an_imported_gas_states_the_error_of_its_reconstruction() -> None:
    """Differences of 9 and 36 K between the three images are of order 2, so 3 K are left."""

    def stated(gas: Vapour) -> Errors:
        averaged = "gas averaged over cells {} as large"
        tracer: Any = NumberTracer(
            own_cells,
            {averaged.format("twice"): 9.0, averaged.format("four times"): 45.0},
            spec=None,
            made=SimpleNamespace(vapour=gas, parcels=None),
            spray=Spray(vapour=gas),
            sources_of=lambda spray: spray,
        )
        return Errors.of(one.cause for one in GAS_GRID.of(tracer))

    cause, order = stated(vapour()).causes
    assert cause.error_K == pytest.approx(3.0) and "order 2" in cause.how
    assert cause.fixed == "spray.file"
    assert order.name == ORDER and order.error_K is None and "one grid alone" in order.how
    cells = vapour().cells
    odd = replace(vapour(), cells=Cells(cells.lower_m, cells.upper_m + 1e-2 * cells.lower_m))
    cause, order = stated(odd).causes
    assert cause.error_K is None and "no lattice" in cause.how


@pytest.mark.parametrize(("more", "twice_K"), [("too few", 0.0), (SPRAY, 18.0)])
def test_without_an_order_the_step_is_a_lower_bound(more: Any, twice_K: float) -> None:
    """No third grid, and equal steps."""
    errors = errors_of(SPRAY, more=more, twice_K=twice_K)
    assert errors.unknown == (ORDER,) and errors.text == "at least 9 K"


SPEC = {"model": "lagrangian", "box": {"spacing_m": H}}


def scene() -> Scene:
    return parse_scene({"name": "s", "spray": SPEC, "optics": {"compare_paper": False}})


def test_two_more_sprays_are_made_for_the_estimate_alone(
    device: Device, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It is deposited as the spray is, comes from the same cache, once, and is a stage."""
    asked: list[tuple[float, Path]] = []
    place = np.random.default_rng(1).normal(0, 1e-3, (50, 3))
    one = np.ones(50)
    parcels = Parcels(place, 1e-5 * one, 1e3 * one, 370.0 * one, 600.0 * one)

    def make(spec: Any, _: Any, *, cache: Path, **__: Any) -> Spray:
        h_m = spec.box.spacing_m
        asked.append((h_m, cache))
        here = vapour(h_m, long=round(48 * H / h_m))
        notes = {"gas_spacing_m": h_m, "vapour_penetration_m": 0.03}
        return Spray(parcels=parcels, vapour=here, notes=notes)

    monkeypatch.setattr(medium, "make_spray", make)
    stages = Stages(None)
    prepared = medium.prepare(scene(), device, stages, tmp_path)
    assert asked == [(H, tmp_path)]
    assert [stage.name for stage in stages.done] == ["spray", "optics"]
    traced: list[Sources] = []

    class Tracer(NumberTracer):
        def variant(self, _: str, made: Any, __: float) -> float:
            traced.append(made())
            return 1.0

    tracer: Any = Tracer(own_cells, scene=scene())
    tracer.prepared = prepared
    for _ in range(2):
        GAS_GRID.estimate(tracer)
    assert asked == [(H, tmp_path), (2 * H, tmp_path), (4 * H, tmp_path)]
    named = [stage.name for stage in stages.done]
    more = [f"spray on cells of gas {how} as large" for how in ("twice", "four times")]
    assert named == ["spray", "optics", *more]
    assert traced[-1][0] is not None and traced[-1][0].extent is not None


@pytest.mark.slow
def test_the_estimate_gives_way_where_a_coarser_cone_leaves_the_domain(device: Device) -> None:
    """The cone's boxes of 10 and 20 mm reach out of the domain of 80 mm; those of 5 mm do not."""
    data = load_scene("gdi-cone").model_dump(mode="json")
    data["spray"]["spacing_m"] = 5e-3
    data["camera"]["pixels"] = [12, 12]
    errors = simulate(parse_scene(data), device=device).errors
    assert errors is not None and errors.text.startswith("at least ")
    found = {cause.name: cause for cause in errors.causes}["gas grid"]
    assert found.error_K is None and found.fixed == "spray.spacing_m"
    assert "lattices of 10 and 20 mm" in found.how and "allowed: a smaller" in found.how
