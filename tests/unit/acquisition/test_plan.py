"""The plan: what it expands to, in which order, and what it refuses."""

from __future__ import annotations

from typing import Any

import pytest

from cldit.acquisition import Plan, load_plan, parse_plan, plan_from_scene
from cldit.errors import SceneError
from cldit.scene import Scene


def test_steps() -> None:
    plan = parse_plan({"backgrounds_K": [400, 440], "shots": 2, "references": 1})
    assert [shot.id for shot in plan.steps()] == [
        "b00_ref_00",
        "b00_inj_00",
        "b00_inj_01",
        "b01_ref_00",
        "b01_inj_00",
        "b01_inj_01",
    ]
    assert [shot.background_K for shot in plan.steps()] == 3 * [400.0] + 3 * [440.0]
    assert [plan.burst(shot).inject for shot in plan.steps()] == 2 * [False, True, True]
    assert all(plan.burst(shot).n == 1 for shot in plan.steps())


def test_ids_are_unique_and_sort_beyond_a_hundred() -> None:
    plan = Plan(backgrounds_K=(400.0,), shots=101, references=0)
    ids = [shot.id for shot in plan.steps()]
    assert ids == sorted(set(ids)) and ids[-1] == "b00_inj_100"


def test_hash_follows_the_content() -> None:
    plan = Plan(backgrounds_K=(400.0, 440.0))
    assert plan.hash() == parse_plan({"backgrounds_K": [400, 440], "shots": 5}).hash()
    for change in ({"backgrounds_K": (440.0, 400.0)}, {"shots": 6}, {"drift_K": 0.6}):
        assert plan.model_copy(update=change).hash() != plan.hash()


def test_yaml_round_trip(tmp_path: Any, tiny_scene: Scene) -> None:
    plan = plan_from_scene(tiny_scene)
    (tmp_path / "plan.yaml").write_text(plan.dump())
    assert load_plan(tmp_path / "plan.yaml") == plan


@pytest.mark.parametrize(
    ("order", "present_K", "expected"),
    [
        ("fastest", 295.0, (1, 2, 0)),
        ("fastest", 600.0, (0, 2, 1)),
        ("fastest", 430.0, (1, 2, 0)),  # 30 K down and 100 K up beats 70 down and 100 up
        ("fastest", float("nan"), (0, 1, 2)),
        ("given", 295.0, (0, 1, 2)),
    ],
)
def test_background_order(order: Any, present_K: float, expected: tuple[int, ...]) -> None:
    plan = Plan(backgrounds_K=(500.0, 400.0, 440.0), order=order)
    assert plan.background_order([0, 1, 2], present_K=present_K) == expected
    assert plan.background_order([], present_K=present_K) == ()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({}, "backgrounds_K: is missing"),
        ({"backgrounds_K": []}, "backgrounds_K: 0 temperatures; allowed: 1..1000"),
        ({"backgrounds_K": [400, "440 K"]}, "'440 K' is not a number"),
        ({"backgrounds_K": [400], "shots": -1}, "shots: -1 is outside 0..100000"),
        (
            {"backgrounds_K": [400], "shot": 3},
            "shot: unknown key; did you mean shots?; allowed: backgrounds_K, shots",
        ),
        ({"backgrounds_K": [400], "shots": 0, "references": 0}, "both are 0"),
        ({"backgrounds_K": [400], "drift_K": 0.1}, "drift_K: 0.1 is less than"),
        ({"backgrounds_K": [400], "stability": {"hold_s": float("nan")}}, "stability.hold_s: nan"),
        ({"backgrounds_K": [400], "order": "random"}, "order: 'random'"),
        (
            {"backgrounds_K": [400], "delays_s": [1e-3, 1e-3]},
            "delays_s: 0.001 and 0.001 are closer than",
        ),
        ({"backgrounds_K": [400], "delays_s": [1e-3, -1e-3]}, "outside 0..1"),
        ({"backgrounds_K": [400], "delays_s": [0.001] * 101}, "101 delays, allowed: 0..100"),
        ({"backgrounds_K": [400], "filters": ["a", "b", "a"]}, "filters: a twice; allowed: each"),
        ({"backgrounds_K": [400], "filters": ["a/b"]}, "filters: 'a/b' is no name; allowed: up to"),
    ],
)
def test_refused(data: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_plan(data, source="plan.yaml")
    assert message in str(caught.value) and str(caught.value).startswith("plan.yaml:\n")


def test_a_slow_black_body_gets_its_time(tiny_scene: Scene) -> None:
    rig = tiny_scene.rig.model_copy(update={"background_time_constant_s": 1000.0})
    plan = plan_from_scene(tiny_scene.model_copy(update={"rig": rig}))
    assert plan.stability.timeout_s == 20_000.0


def _kinds(references: int, shots: int, **more: bool) -> str:
    plan = Plan(backgrounds_K=(400.0,), references=references, shots=shots, **more)
    return "".join(shot.kind[0] for shot in plan.steps())


def test_references_and_injections_alternate() -> None:
    assert _kinds(4, 4) == "riirriir"
    assert _kinds(5, 2) == "rririrr"
    assert _kinds(4, 4, interleave=False) == "rrrriiii"
    assert _kinds(0, 3) == "iii" and _kinds(3, 0) == "rrr"


def test_a_steady_drift_is_the_same_in_both_kinds() -> None:
    """Whatever the numbers: a reference is first, none is lost, and the kinds' mean places are
    less than a shot apart; the same for even and equal numbers."""
    for references in range(2, 13):
        for shots in range(2, 13):
            order = _kinds(references, shots)
            assert (
                order[0] == "r"
                and order.count("r") == references
                and len(order) == (references + shots)
            )
            places = {
                kind: [at for at, one in enumerate(order) if one == kind] for kind in ("r", "i")
            }
            apart = sum(places["r"]) / references - sum(places["i"]) / shots
            assert abs(apart) < 1.0
            if references == shots and shots % 2 == 0:
                assert apart == 0.0


def test_the_order_of_the_kinds_is_no_other_measurement() -> None:
    """Folders that older plans filled belong to the same plan."""
    one, other = (Plan(backgrounds_K=(400.0,), interleave=value) for value in (True, False))
    assert one.hash() == other.hash()
