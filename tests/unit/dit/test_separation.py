"""Two models told apart, or not: the distance against dense algebra, and its limits."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.acquisition.plan import load_plan
from cldit.cli import main
from cldit.dit.design import MOST_SHOTS, BlackBody
from cldit.dit.fit import apparent_radiance, fit_pair
from cldit.dit.separation import NEEDED, Rivals, _Test, rivals
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature
from cldit.rig.protocols import Stability
from cldit.scene import Scene, load_scene
from cldit.study.separate import check_rivals
from tests.conftest import tiny_weights

_BLACKBODY = BlackBody(
    limits_K=(440.0, 480.0), start_K=295.0, time_constant_s=120.0, stability=Stability()
)


def _test() -> _Test:
    rng = np.random.default_rng(7)
    return _Test(
        change_K=rng.normal(0.0, 1.0, 60),
        noise_K2=rng.uniform(1.0, 9.0, 60),
        depth=rng.normal(0.0, 0.3, (3, 60)),
        varied_K2=rng.uniform(0.0, 0.5, 60),
        setup={"walls": rng.normal(0.0, 0.2, 60), "filter": rng.normal(0.0, 0.2, 60)},
        models={"cells": rng.uniform(0.0, 0.3, 60)},
    )


@pytest.mark.parametrize("shots", [1, 30, 10_000])
def test_distance_is_that_of_the_dense_covariance(shots: int) -> None:
    test = _test()
    fixed = np.diag(test.noise_K2 / shots) + test.depth.T @ test.depth / shots
    fixed += sum(np.outer(image, image) for image in test.setup.values())
    size = np.sqrt(test.varied_K2 / shots + test.models["cells"] ** 2)
    d = test.change_K
    distances = []
    for factor in np.geomspace(1e-4, 1e4, 2000):
        u = np.clip(factor * d, -size, size)
        distances.append(math.sqrt(d @ np.linalg.solve(fixed + np.outer(u, u), d)))
    assert test.distance(shots) == pytest.approx(min(distances), rel=5e-3)


def test_more_shots_tell_no_less_and_none_tells_an_equal_error() -> None:
    """An error as large as the difference in every pixel bounds z by 1: u = d is possible."""
    test = _test()
    distances = [test.distance(n) for n in (1, 10, 100, 1000, 10_000)]
    assert distances == sorted(distances)
    equal = replace(test, setup={}, models={"cells": np.abs(test.change_K)})
    assert 0.99 < equal.distance(10**9) < 1.05
    assert replace(test, change_K=np.zeros(60)).distance(10**4) == 0.0
    noise_only = replace(test, setup={}, models={}, varied_K2=np.zeros(60), depth=np.zeros((1, 60)))
    plain = math.sqrt(np.sum(7 * test.change_K**2 / test.noise_K2))
    assert noise_only.distance(7) == pytest.approx(plain, rel=1e-9)


def _rivals(
    scene: Scene, *, brighter: float, error_K: float, other_scene: Scene | None = None
) -> Rivals:
    spray, bare = (tiny_weights(scene, depth=depth) for depth in (2.0, 0.0))
    scattered = 0.1 * np.maximum(bare.background - spray.background, 0.0)
    spray = replace(spray, wall=spray.wall + np.float32(scattered))
    rival = replace(spray, liquid=np.float32(1.0 + brighter) * spray.liquid)
    quadrature = Quadrature.grey(scene_filter(scene), reference_K=460.0)
    model = Subject.of(scene, quadrature, (spray,), bare, least_emissivity=0.2)
    columns, rows = scene.camera.sensor.pixels
    errors_K = {"cells of both": np.full((rows, columns), error_K)}
    rival_model = (other_scene or scene, quadrature, (rival,), bare)
    return rivals(scene, model, rival_model, injections=[], errors_K=errors_K, delay_s=None)


def test_response_is_the_derivative_of_the_evaluation(tiny_scene: Scene) -> None:
    """Central differences of a fit with the same weights, to second order in a step of 1e-3."""
    subject = _rivals(tiny_scene, brighter=0.0, error_K=0.0).model
    backgrounds = (440.0, 455.0, 480.0)
    response = subject.response(backgrounds)
    lines, variance = subject._fitted(backgrounds)
    bare, spray = subject.both(backgrounds)
    source = subject.filter_boundary.leaving(backgrounds)
    for number in range(3):
        shifted = []
        for way in (1e-3, -1e-3):
            moved = spray.copy()
            moved[number] *= 1.0 + way
            fitted = fit_pair(
                (source, source), (bare, moved), variance=(variance, variance),
                usable=np.ones(bare.shape, bool),
            )  # fmt: skip
            shifted.append(subject.curve.temperature(apparent_radiance(fitted)[0]))
        slope = (shifted[0] - shifted[1]) / (2e-3 * spray[number])
        assert response[number] == pytest.approx(slope, rel=1e-3)
    assert lines.values.shape == (subject.places.size, 4)


def test_the_fewest_shots(tiny_scene: Scene) -> None:
    """T_app is some 9 K apart, more than the setup errs: one shot less would not be enough."""
    pair = _rivals(tiny_scene, brighter=0.4, error_K=0.05)
    best = pair.best(_BLACKBODY, shot_s=0.2, counts=(2, 3))
    assert best.shots is not None and 1 < best.shots < MOST_SHOTS and best.time_s is not None
    test = pair._test(best.backgrounds_K)
    assert test.distance(best.shots) >= NEEDED > test.distance(best.shots - 1)
    assert best.of_noise > best.distance and 5.0 < best.rms_K < 12.0
    assert f"{best.shots} injections" in best.text


def test_none_is_enough_where_the_simulations_err_as_much(tiny_scene: Scene) -> None:
    best = _rivals(tiny_scene, brighter=0.02, error_K=2.0).best(_BLACKBODY, shot_s=0.2)
    assert best.shots is best.time_s is None and best.distance < 1.5
    assert best.text.startswith("cannot be told: 10000 injections")
    assert best.largest == "cells of both"


def test_one_background_is_refused(tiny_scene: Scene) -> None:
    pair = _rivals(tiny_scene, brighter=0.1, error_K=0.0)
    with pytest.raises(EvaluationError, match="440 K alone"):
        pair.best(replace(_BLACKBODY, limits_K=(440.0, 440.0)), shot_s=0.2)


def test_other_views_are_refused() -> None:
    gdi = load_scene("gdi-cone")
    with pytest.raises(EvaluationError, match=r"camera\.field_m: .*0\.16.* in gdi-cone, .*0\.1"):
        check_rivals(gdi, gdi.with_(**{"camera.field_m": [0.1, 0.1]}))


def test_models_may_differ_in_all_else(tiny_scene: Scene) -> None:
    """Walls 200 K warmer behind an equal spray, whose droplets scatter light of the walls."""
    warmer = tiny_scene.with_(**{"walls.temperature_K": tiny_scene.walls.temperature_K + 200.0})
    check_rivals(tiny_scene, warmer)
    for scene, least_K, most_K in ((tiny_scene, 0.0, 1e-9), (warmer, 1.0, 100.0)):
        found = _rivals(tiny_scene, brighter=0.0, error_K=0.05, other_scene=scene)
        assert least_K <= found.rms_K((440.0, 480.0)) <= most_K


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fuel 30 K colder is distinguished, the same scene never; the exit status reports it."""
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(
        "base: droplets-only\ncamera: {pixels: 40, rays_per_pixel: 1}\n"
        "domain: {leaf_edge_m: 4.0e-3}\nspray: {spacing_m: 2.0e-3}\ntransport: {audit: false}\n"
    )
    Path("b.yaml").write_text("base: a.yaml\nspray: {fuel_temperature_K: 340.0}\n")
    words = ["plan", "--separate", "a.yaml", "b.yaml", "--out", "ab", "--json"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    output = result.stdout  # with older versions of click after what is said of the progress
    (plan,) = json.loads(output[output.index("{") :])["plans"]
    assert plan["shots"] >= 1 and plan["chosen"]
    assert load_plan(Path("ab/plan.yaml")).shots == plan["shots"]
    same = CliRunner().invoke(main, ["plan", "--separate", "a.yaml", "a.yaml", "--out", "aa"])
    assert same.exit_code == 3 and "have the same T_app" in same.stdout.replace("\n", " ")
    wrong = CliRunner().invoke(main, ["plan", "a.yaml", "--separate", "a.yaml", "b.yaml"])
    assert wrong.exit_code == 2
