"""Free parameters of a spray: keys, deviations, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.comparison.rivals import drawn
from cldit.comparison.unknowns import DEFAULT, Unknown, unknowns_of
from cldit.errors import StudyError
from cldit.scene import load_scene


def test_shares_and_lists() -> None:
    scene = load_scene("gdi")
    mass = Unknown.of("spray.injected_mass_kg", "5 %", scene)
    assert mass.values(2.0) == {"spray.injected_mass_kg": pytest.approx(1.1e-5)}
    cone = Unknown.of("spray.plumes[*].cone_angle_deg", 2.0, scene)
    assert len(cone.means) == 8
    made = scene.with_(**cone.values(-1.0))
    assert {plume.cone_angle_deg for plume in made.spray.plumes} == {20.0}  # type: ignore[union-attr]


def test_defaults_are_those_that_a_scene_has() -> None:
    assert [one.key for one in unknowns_of(load_scene("gdi"))] == list(DEFAULT)
    cone = [one.key for one in unknowns_of(load_scene("gdi-cone"))]
    assert cone == [key for key in DEFAULT if key != "spray.mixing_length"]
    assert unknowns_of(load_scene("empty")) == ()


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("spray.mixing_lenght: 5 %", "no such key"),
        ("spray.mixing_length: much", r"'much'; allowed: a standard deviation above 0"),
        ("spray.mixing_length: 0", "allowed: a standard deviation above 0"),
        ("spray.fuel: 1.0", "allowed: keys with a number"),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str, match: str) -> None:
    file = tmp_path / "free.yaml"
    file.write_text(text)
    with pytest.raises(StudyError, match=rf"free\.yaml: .*{match}"):
        unknowns_of(load_scene("gdi"), file)


def test_draws_have_the_priors() -> None:
    """The deviations that are returned are those of the scenes; each has its own random numbers."""
    scene = load_scene("gdi")
    free = unknowns_of(scene, {"spray.mixing_length": "10 %", "spray.time_s": 2e-5})
    sizes, scenes = zip(*drawn(scene, free, 5, seed=3), strict=True)
    mixing = [one.spray.mixing_length for one in scenes]
    assert mixing == pytest.approx([0.018 * (1.0 + 0.1 * size[0]) for size in sizes], rel=1e-6)
    assert len({one.spray.seed for one in scenes}) == 5
    assert np.std([size[1] for size in sizes]) > 0.1
    assert drawn(load_scene("empty"), (), 5, seed=3) == []


def test_a_rival_keeps_its_own_values() -> None:
    """Draws of another model have the same deviations about the values of its scene."""
    scene = load_scene("gdi")
    (mixing,) = unknowns_of(scene, {"spray.mixing_length": "10 %"})
    other = mixing.of_scene(scene.with_(**{"spray.mixing_length": 0.03}))
    assert other.values(2.0) == {"spray.mixing_length": pytest.approx(0.03 + 2.0 * 0.0018)}
