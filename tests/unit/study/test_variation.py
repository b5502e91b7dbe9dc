"""Errors of a study's figures: of known random numbers and of known steps of gas cells."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.cli import main
from cldit.errors import StudyError
from cldit.scene import Scene
from cldit.study.lab import Lab
from cldit.study.paper import STUDIES, studies_of
from cldit.study.paper.results import Results, sentences
from cldit.study.paper.variation import MOST_SEEDS, repeat

_NOISE = np.random.default_rng(3).normal(size=100)


def _study(lab: Lab, *, chance: float, step: float, model: str = "lagrangian") -> Results:
    """Figure of 5 with an error of `step` times the cells' edge, and noise."""
    scene = lab.gdi("gdi")
    lab.used["gdi"] = scene if model == "lagrangian" else replace_spray(scene)
    value = 5.0 + step * lab.coarser + chance * float(_NOISE[lab.seed])
    return Results(
        values={"value": value, "name": "text"}, table=[{"case": "a", "value / K": value}]
    )


def replace_spray(scene: Scene) -> Scene:
    return scene.with_(spray={"model": "none"})


def _never(_: Results) -> bool:
    return False


def test_error_of_cells_is_the_step_between_them() -> None:
    """First order: the step from twice the edge to the edge is what is left."""
    found = repeat(lambda lab: _study(lab, chance=0.0, step=0.7), Lab(), decided=lambda _: True)
    assert found.seeds == (1, 2)
    assert found.errors == pytest.approx({"value": 0.7})
    assert found.row_errors[0]["value / K"] == pytest.approx(0.7)
    assert found.values["name"] == "text"


def test_error_by_chance_holds_the_truth() -> None:
    """Of 24 means of four seeds about 68 % lie within one error, which has three degrees of
    freedom: 16.4 +- 2.3; three of those."""
    inside = 0
    for first in range(0, 96, 4):
        lab = replace(Lab(), seed=first)
        found = repeat(lambda lab: _study(lab, chance=1.0, step=0.0), lab, decided=_never)
        assert len(found.seeds) == MOST_SEEDS[False]
        inside += abs(float(found.values["value"]) - 5.0) < found.errors["value"]
    assert 9 <= inside <= 23


def test_what_is_not_random_is_repeated_on_coarser_cells_alone() -> None:
    ran: list[Lab] = []

    def study(lab: Lab) -> Results:
        ran.append(lab)
        return _study(lab, chance=1.0, step=0.7, model="none")

    found = repeat(study, Lab(), decided=_never)
    assert found.errors == pytest.approx({"value": 0.7})
    assert [(lab.seed, lab.coarser) for lab in ran] == [(1, 1.0), (1, 2.0)]
    assert found.seeds == ()


def test_what_traces_nothing_has_no_error() -> None:
    found = repeat(lambda lab: Results(values={"n": 1.3}, table=[]), Lab(), decided=_never)
    assert found.errors == {}


def test_seeds_and_cells_reach_the_scene() -> None:
    coarse, normal = Lab(seed=4, coarser=2.0, quick=True).gdi("gdi"), Lab(quick=True).gdi("gdi")
    assert coarse.domain.leaf_edge_m == 2 * normal.domain.leaf_edge_m  # type: ignore[operator]
    scene, fine = coarse.spray, normal.spray
    assert (scene.seed, fine.seed) == (4, 1)  # type: ignore[union-attr]
    assert scene.box.spacing_m == 2 * fine.box.cell_m  # type: ignore[union-attr]


def test_reduced_pixels_are_square() -> None:
    """125 x 250 over the 57 x 114 mm of the methane jet."""
    camera = Lab(quick=True).shipped("methane-jet").camera
    assert camera.pixels == (125, 250)
    assert camera.field_m[0] / 125 == camera.field_m[1] / 250


def test_help_lists_all_studies_with_their_figures() -> None:
    shown = " ".join(CliRunner().invoke(main, ["study", "--help"]).output.split())
    for study in STUDIES:
        figures = re.findall(r"\d+", sentences()[study]["figure"])
        assert f"{study} {', '.join(f'fig{number}' for number in figures)}" in shown


def test_studies_by_figure() -> None:
    assert studies_of("fig12") == ["index"]
    assert studies_of("Fig. 2") == ["methane"]
    assert studies_of("all") == list(STUDIES)
    with pytest.raises(StudyError, match=r"fig1: no such study; allowed: methane \(Fig. 2\)"):
        studies_of("fig1")
