"""The scenes of single injections: their spread, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cldit.errors import SceneError
from cldit.scene import Scene, load_scene, parse_scene
from cldit.scene.scatter import member, members_of, nominal


def _scene(name: str = "gdi-cone", **scatter: Any) -> Scene:
    keys = {f"spray.scatter.{key}": value for key, value in scatter.items()}
    return load_scene(name).with_(**{"spray.scatter.members": 8, **keys})


def _spray(scene: Scene, number: int) -> Any:
    return member(scene, number).spray


def test_members_spread_as_stated() -> None:
    """400 members: standard deviations to 4 / sqrt(800) = 14 %, means to 4 / sqrt(400) of one."""
    given: dict[str, Any] = {"start_s": 3e-5, "duration_s": 5e-5, "mass": 0.05}
    given |= {"fuel_temperature_K": 2.0, "cone_angle_deg": 1.0}
    scene = _scene(**given)
    made = [_spray(scene, number) for number in range(1, 401)]
    found = {
        "time_s": (0.95e-3, given["start_s"]),
        "injection_duration_s": (0.78e-3, given["duration_s"]),
        "injected_mass_kg": (10e-6, 10e-6 * given["mass"]),
        "fuel_temperature_K": (370.0, given["fuel_temperature_K"]),
    }
    for key, (middle, sigma) in found.items():
        values = np.array([getattr(one, key) for one in made])
        assert np.std(values) == pytest.approx(sigma, rel=0.14), key
        assert np.mean(values) == pytest.approx(middle, abs=4 * sigma / 20), key
    wide = np.array([[plume.cone_angle_deg for plume in one.plumes] for one in made])
    assert np.std(wide) == pytest.approx(1.0, rel=0.14 / math.sqrt(8))


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0])
def test_a_plume_turns_alike_in_both_planes(tilt_deg: float) -> None:
    """The angle to the nominal direction is Rayleigh's: its mean square is 2 sigma^2, to 4 / 20."""
    plume = {"inclination_deg": tilt_deg, "azimuth_deg": 200.0}
    scene = _scene(direction_deg=2.0).with_(**{"spray.plumes": [plume]})

    def along(tilt: float, turn: float) -> np.ndarray:
        tilt, turn = math.radians(tilt), math.radians(turn)
        return np.array([math.sin(tilt) * math.cos(turn), math.sin(tilt) * math.sin(turn),
                         -math.cos(tilt)])  # fmt: skip

    first = along(tilt_deg, 200.0)
    square = []
    for number in range(1, 401):
        (one,) = _spray(scene, number).plumes
        assert one.cone_angle_deg == 22.0
        off = along(one.inclination_deg, one.azimuth_deg) @ first
        square.append(math.degrees(math.acos(min(off, 1.0))) ** 2)
    assert np.mean(square) == pytest.approx(2 * 2.0**2, rel=0.2)


def test_a_member_does_not_depend_on_their_number_or_on_other_deviations() -> None:
    few, many = _scene(mass=0.05), _scene(mass=0.05, members=80)
    assert member(few, 3) == member(many, 3) != member(few, 4)
    both = _spray(_scene(mass=0.05, start_s=3e-5), 3)
    assert both.injected_mass_kg == _spray(few, 3).injected_mass_kg
    assert member(_scene(mass=0.05, seed=2), 3) != member(few, 3)
    assert members_of(member(few, 3)) == members_of(nominal(few)) == 1


def test_a_lagrangian_member_has_eddies_of_its_own() -> None:
    scene = _scene("gdi-flow")
    seeds = {_spray(scene, number).seed for number in range(1, 6)}
    assert len(seeds) == 5


@pytest.mark.parametrize(
    ("scatter", "message"),
    [
        ({}, "8 injections without a difference"),
        ({"start_s": 1e-2}, r"injection \d+ of seed 1: spray.time_s: .* is outside 1e-05..0.1"),
        ({"start_s": -1e-6}, "spray.scatter.start_s: -1e-06 is outside 0..0.01"),
        ({"strat_s": 1e-6}, "unknown key; did you mean start_s?"),
    ],
)
def test_what_is_refused(scatter: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        for number in range(1, 9):
            member(_scene(**scatter), number)


def test_an_effect_is_needed() -> None:
    table = {"spray.rate": [[0.0, 1.0], [1e-3, 1.0]]}
    with pytest.raises(SceneError, match=r"duration_s: has no effect, since spray\.rate"):
        member(_scene("gdi-flow", duration_s=1e-5).with_(**table), 1)
    for key in ("members", "mass"):
        with pytest.raises(SceneError, match=f"spray.scatter: {key}: .*allowed: optical_depth"):
            load_scene("empty").with_(**{f"spray.scatter.{key}": 2 if key == "members" else 0.1})


def test_a_scene_of_0_1_has_its_scatter() -> None:
    data = {"name": "old", "spray": {"model": "none"}, "rig": {"shot_scatter": 0.2, "seed": 4}}
    scene = parse_scene(data)
    assert (scene.spray.scatter.optical_depth, scene.rig.seed) == (0.2, 4)
