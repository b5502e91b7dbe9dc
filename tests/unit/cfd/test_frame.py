"""Nozzle and axis: given, from the case's dictionary, or from the parcels; the turn to -z."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from cldit.cfd.openfoam.dictionaries import read_injectors
from cldit.cfd.orientation import InjectorFrame, extrapolated
from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.load import dump_scene, parse_scene
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import read, refused

HEAD = "FoamFile { version 2.0; format ascii; class dictionary; object sprayCloudProperties; }\n"
SPRAY = """
subModels
{{
    // a remark with a brace {{ and (a bracket
    injectionModels
    {{
        {models}
    }}
    flowRateProfile table ((0 0.1) (1e-5 6.2));
    phases ( liquid {{ C7H16 1; }} );
    include "quoted; text {{";
}}
"""
DOWN = "a { position (0 0 0); direction (0 -1 0); } "
ONE = "model1 { type coneNozzleInjection; position (0.001 0.008 0); direction (0 -1 0); }"
FORMATS = [
    ONE,
    "m { position constant (0.001 0.008 0); direction constant (0 -2 0); }",
    "m { type coneInjection; positionAxis ( ((0.001 0.008 0) (0 -1 0)) ); }",
    "a { type manualInjection; } /* b { */ c { d { direction (0 -1 0); position (1e-3 8e-3 0); } }",
]


def written(case: Path, models: str, text: str = SPRAY) -> Path:
    file = case / "constant" / "sprayCloudProperties"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(HEAD + '#includeEtc "x"\n' + text.format(models=models))
    return file


@pytest.mark.parametrize(
    "axis",
    [(0, -1, 0), (0, 1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1), (1, 2, -3), (1e-9, 0, 1)],
)
def test_turn_is_proper_and_takes_the_axis_down(axis: tuple[float, float, float]) -> None:
    unit = np.array(axis) / np.linalg.norm(axis)
    turn = InjectorFrame(np.zeros(3), unit, ()).rotation
    assert turn @ unit == pytest.approx([0, 0, -1], abs=1e-8)  # the last is snapped to +z
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-14)
    if np.count_nonzero(axis) == 1:
        assert set(np.abs(turn).ravel().tolist()) == {0.0, 1.0}  # boxes stay boxes


@pytest.mark.parametrize("models", FORMATS)
def test_injector_of_the_dictionary(tmp_path: Path, models: str) -> None:
    foam.case(tmp_path)
    file = written(tmp_path, models)
    spray = read_cfd(CfdSpray(file=tmp_path))
    assert [spray.notes[f"nozzle_{name}_m"] for name in "xyz"] == [0.001, 0.008, 0.0]
    assert [spray.notes[f"axis_{name}"] for name in "xyz"] == [0.0, -1.0, 0.0]
    assert spray.remarks == (
        f"Injection axis (0, -1, 0), from {file}.",
        f"Nozzle at (0.001, 0.008, 0) m, from {file}.",
    )


@pytest.mark.parametrize("axis", [(0, -1, 0), (1, 2, -3)])
def test_boxes_keep_volume_centroid_and_proportions(
    tmp_path: Path, axis: tuple[float, float, float]
) -> None:
    """The bounds of a cell in the case, here sheared, are turned with it."""
    block = foam.sample(shear=0.3)[0]
    case = foam.case(tmp_path, gas={"C7H16": 0.1}, shear=0.3)
    nozzle = (0.5e-3, 9e-3, 0.1e-3)
    away = "none"  # parcels lie upstream for the oblique axis
    vapour = read(case, nozzle_m=nozzle, axis=axis, cloud=away).vapour
    assert vapour is not None
    lower, upper = vapour.cells.lower_m, vapour.cells.upper_m
    turn = InjectorFrame(np.zeros(3), np.array(axis) / np.linalg.norm(axis), ()).rotation
    x, y, z = np.meshgrid(*map(np.diff, block.edges), indexing="ij")
    edges = np.stack([x + 0.3 * y, y, z], axis=-1).transpose(2, 1, 0, 3).reshape(-1, 3)
    ratio = (upper - lower) / (edges @ np.abs(turn).T)
    assert np.prod(upper - lower, axis=1) == pytest.approx(block.volume, rel=1e-12, abs=0)
    assert (lower + upper) / 2 == pytest.approx((block.centre - nozzle) @ turn.T, abs=1e-12)
    assert ratio == pytest.approx(np.tile(ratio[:, :1], 3), rel=1e-12)


def test_ring_of_holes_makes_one_axis(tmp_path: Path) -> None:
    foam.case(tmp_path)
    angles = np.radians(np.arange(0, 360, 45))
    holes = (
        f"hole{n} {{ position ({1e-4 * np.cos(a)} 0.008 {1e-4 * np.sin(a)}); "
        f"direction ({np.cos(a):.4f} -2 {np.sin(a):.4f}); }}"
        for n, a in enumerate(angles)
    )
    written(tmp_path, "\n".join(holes))
    notes = read_cfd(CfdSpray(file=tmp_path)).notes
    assert [notes[f"axis_{name}"] for name in "xyz"] == [0.0, -1.0, 0.0]
    nozzle = [notes[f"nozzle_{name}_m"] for name in "xyz"]
    assert nozzle == pytest.approx([0.0, 0.008, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("models", "message"),
    [
        (
            DOWN + DOWN.replace("0 0 0", "0 1 0").replace("a", "b", 1),
            "injectors in several places.*set spray.nozzle_m and spray.axis",
        ),
        (
            DOWN + DOWN.replace("-1", "1").replace("a", "b", 1),
            "oppose each other.*set spray.nozzle_m and spray.axis",
        ),
        ("a { position (0 0 0;", "sprayCloudProperties: brackets do not match"),
        ("a { position (0 0 0); } } }", "sprayCloudProperties: brackets do not match"),
    ],
)
def test_dictionary_of_no_use(tmp_path: Path, models: str, message: str) -> None:
    foam.case(tmp_path)
    written(tmp_path, models)
    with pytest.raises(SprayError, match=message):
        read_cfd(CfdSpray(file=tmp_path))


@pytest.mark.parametrize(
    "models",
    [
        "a { type patchInjection; patch inlet; }",
        "a { position $nozzle; direction (0 -1 0); }",
        "a { position (0 0 0); direction table ((0 (0 -1 0)) (1 (0 -1 0))); }",
        "a { position (0 0 0); direction (0 0 0); }",
        "a { position (0 x 0); direction (0 -1 0); }",
    ],
)
def test_injectors_that_say_nothing_are_passed_over(tmp_path: Path, models: str) -> None:
    assert read_injectors(written(tmp_path, models)) == ()


def _plume(tilt_deg: float, age: bool) -> tuple[Any, Any, dict[str, Any]]:
    """Parcels on straight paths from one point, within 10 degrees of an axis tilted from -y."""
    block, gas, _ = foam.sample()
    random = np.random.default_rng(11)
    tilt = np.radians(tilt_deg)
    axis = np.array([np.sin(tilt), -np.cos(tilt), 0.0])
    spread = random.normal(0.0, 0.05, (400, 3))
    velocity = 80.0 * (axis + spread - (spread @ axis)[:, None] * axis)
    ages = random.uniform(0.0, 4e-5, 400)
    position = np.array([-1e-3, 6.5e-3, 0.5e-3]) + velocity * ages[:, None]
    cloud = {
        "position": position,
        "d": np.full(400, 1e-5),
        "nParticle": np.full(400, 10.0),
        "T": np.full(400, 350.0),
        "rho": np.full(400, 650.0),
        "U": velocity,
    }
    return block, gas, cloud | ({"age": ages} if age else {})


@pytest.mark.parametrize("age", [True, False])
@pytest.mark.parametrize("tilt_deg", [0.0, 8.0, 30.0])
def test_from_the_parcels(tmp_path: Path, tilt_deg: float, age: bool) -> None:
    block, gas, cloud = _plume(tilt_deg, age)
    foam.write(tmp_path, block, gas=gas, cloud=cloud)
    if not age:
        with pytest.raises(SprayError, match="has no age to trace parcels back with"):
            read_cfd(CfdSpray(file=tmp_path))
    place: dict[str, Any] = {} if age else {"nozzle_m": (-1e-3, 6.5e-3, 0.5e-3)}
    spray = read_cfd(CfdSpray(file=tmp_path, **place))
    axis = np.array([spray.notes[f"axis_{name}"] for name in "xyz"])
    if tilt_deg < 10.0:
        assert axis.tolist() == [0.0, -1.0, 0.0]  # snapped
    else:
        # 400 directions of 0.05 rad scatter: 0.0025 rad standard error, four of them
        angle = np.arccos(axis @ [np.sin(np.radians(30)), -np.cos(np.radians(30)), 0.0])
        assert angle < 0.01
    nozzle = np.array([spray.notes[f"nozzle_{name}_m"] for name in "xyz"])
    # paths meet in the nozzle
    assert nozzle == pytest.approx([-1e-3, 6.5e-3, 0.5e-3], abs=1e-12)
    assert "mean velocity" in spray.remarks[0]
    assert not age or "spray.nozzle_m sets it exactly" in spray.remarks[1]
    assert spray.notes["liquid_penetration_95_m"] == pytest.approx(0.95 * 3.2e-3, rel=0.05)


AROUND = np.random.default_rng(1).normal(0.0, 1.0, (17, 3))
EQUAL = dict.fromkeys(("d", "rho", "nParticle"), lambda values: np.full(17, values[0]))
LACKING: dict[str, tuple[Any, dict[str, Any], str]] = {
    "gas": (False, {}, r"it has no parcels.; set spray.nozzle_m and spray"),
    "gas and axis": (False, {"axis": "-y"}, "it has no parcels"),
    "still": ({"U": None}, {}, "'sprayCloud' has no velocity U"),
    "around": (EQUAL | {"U": AROUND - AROUND.mean(axis=0)}, {}, "have no common direction"),
    "broken": (
        {"U": lambda U: np.where(np.arange(51).reshape(17, 3) < 7, np.nan, U)},
        {},
        "sprayCloud/U: 3 of 17 parcels have no finite",
    ),
}


@pytest.mark.parametrize("kind", LACKING)
def test_what_cannot_be_inferred(tmp_path: Path, kind: str) -> None:
    cloud, keys, message = LACKING[kind]
    with pytest.raises(SprayError, match=message):
        read_cfd(CfdSpray(file=foam.case(tmp_path, cloud=cloud), **keys))


def test_axis_in_a_scene() -> None:
    assert CfdSpray(file=Path("x")).axis is None
    assert CfdSpray(file=Path("x"), axis="+z").axis == (0.0, 0.0, 1.0)
    assert CfdSpray(file=Path("x"), axis=[1, 0, -1]).axis == (1.0, 0.0, -1.0)
    for wrong in ("y", "down", "-w", (0, 0, 0), (1, 2), 3, (0, float("nan"), 1)):
        with pytest.raises(ValidationError):
            CfdSpray(file=Path("x"), axis=wrong)
    scene = parse_scene({"name": "s", "spray": {"model": "cfd", "file": "x", "axis": "-y"}})
    again = parse_scene(yaml.safe_load(dump_scene(scene)))
    assert again == scene
    assert isinstance(again.spray, CfdSpray)
    assert again.spray.axis == (0.0, -1.0, 0.0)


NOZZLE = np.array([1e-3, 50e-3, -2e-3])
AXIS = np.array([0.0, -1.0, 0.0])


def slowed(count: int, seed: int, *, oldest_s: float = 1e-4) -> tuple[Any, Any, Any]:
    """Parcels that Stokes' drag slows on their way, exact: x = v tau (1 - exp(-t/tau))."""
    random = np.random.default_rng(seed)
    age = random.uniform(0.0, oldest_s, count)
    relaxation = random.uniform(1e-4, 3e-4, count)
    spread = random.normal(0.0, 0.08, (count, 3))
    start = 300.0 * (AXIS + spread - np.outer(spread @ AXIS, AXIS))
    fallen = relaxation * (1.0 - np.exp(-age / relaxation))
    position = NOZZLE + start * fallen[:, None]
    return position, start * np.exp(-age / relaxation)[:, None], age


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("count", [30, 300, 3000])
def test_extrapolation_to_age_zero(count: int, seed: int) -> None:
    """The error said covers the true one, and is a small part of what drag adds without it."""
    position, velocity, age = slowed(count, seed)
    found, error = extrapolated(position, velocity, age, AXIS)
    assert np.linalg.norm(found - NOZZLE) < error
    straight = np.median((position - velocity * age[:, None])[np.argsort(age)[:100]], axis=0)
    assert np.linalg.norm(found - NOZZLE) < 0.7 * np.linalg.norm(straight - NOZZLE)
    assert error < (4e-3 if count == 30 else 1e-3)


@pytest.mark.parametrize("youngest_s", [6e-5, 1e-4, 2e-4])
def test_after_the_end_of_injection(youngest_s: float) -> None:
    """Newton's drag, x = v tau ln(1 + t/tau): a parabola alone was 2.4 mm off, and said 0.9 mm."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        age, tau = random.uniform(youngest_s, 1e-3, 2000), random.uniform(1e-4, 3e-4, 2000)
        start = random.uniform(150.0, 350.0) * AXIS
        position = NOZZLE + start * (tau * np.log1p(age / tau))[:, None]
        found, error = extrapolated(position, start / (1.0 + age / tau)[:, None], age, AXIS)
        assert np.linalg.norm(found - NOZZLE) < max(error, 1e-3)


@pytest.mark.parametrize(
    ("nozzle", "hint"),
    [
        ((0.5, 9.0, 0.1), r"are metres: \(0\.0005, 0\.009, 0\.0001\) m if mm were meant"),
        ((0.05, 0.6, 0.01), r"are metres: .*\(0\.0005, 0\.006, 0\.0001\) m if cm were meant"),
        ((0.0, 0.0, -90.0), "coordinates are metres$"),
    ],
)
def test_a_nozzle_far_away(tmp_path: Path, nozzle: tuple[float, float, float], hint: str) -> None:
    case = foam.case(tmp_path)
    refused(case, rf"spray\.nozzle_m: .* m away from the case.*{hint}", nozzle_m=nozzle, axis="-y")


def test_liquid_upstream(tmp_path: Path) -> None:
    case = foam.case(tmp_path)
    refused(
        case,
        r"100 % of the liquid is upstream .* axis \(0, 1, 0",
        nozzle_m=(0.5e-3, 9e-3, 0.1e-3),
        axis="+y",
    )
