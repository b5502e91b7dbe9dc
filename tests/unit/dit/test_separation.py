"""Two models told apart, or not: the distance against dense algebra and in closed form."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.acquisition.plan import load_plan
from cldit.api.planning import separate
from cldit.arrays import Floats
from cldit.cli import main
from cldit.comparison.rivals import check_rivals
from cldit.dit.design import MOST_SHOTS, BlackBody
from cldit.dit.fit import apparent_radiance, fit_pair
from cldit.dit.separation import (
    LEVEL,
    NEEDED,
    Rivals,
    Separation,
    SeparationTest,
    Source,
    fewest,
)
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError, SceneError
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature
from cldit.rig.protocols import Stability
from cldit.scene import Scene, load_scene
from tests.conftest import tiny_weights

_BLACKBODY = BlackBody(
    limits_K=(440.0, 480.0), start_K=295.0, time_constant_s=120.0, stability=Stability()
)
_BACKGROUNDS = (440.0, 460.0, 480.0)


def _covariances(rng: np.random.Generator, count: int) -> Floats:
    root = rng.normal(0.0, 1.0, (count, 2, 2))
    return root @ np.swapaxes(root, 1, 2) + np.eye(2)


def _test(seed: int = 7, blocks: int = 30) -> SeparationTest:
    rng = np.random.default_rng(seed)
    shape = (blocks, 2)
    return SeparationTest(
        change=rng.normal(0.0, 1.0, shape),
        noise=_covariances(rng, blocks),
        sources=(
            Source(name="walls", images=rng.normal(0.0, 0.4, (1, *shape))),
            Source.sampled("injections", rng.normal(0.0, 0.3, (3, *shape)), by_injection=True),
            Source.sampled("cells", rng.normal(0.0, 0.2, (1, *shape))),
        ),
    )


def _dense(test: SeparationTest, shots: int) -> Floats:
    size = test.change.size
    whole = np.zeros((size, size))
    for b, noise in enumerate(test.noise):
        here = slice(2 * b, 2 * b + 2)
        whole[here, here] += noise / shots
        for source in test.sources:
            share = 1.0 / shots if source.by_injection else 1.0
            if not isinstance(source.independent, float):
                whole[here, here] += source.independent[b] * share
    for source in test.sources:
        share = 1.0 / shots if source.by_injection else 1.0
        rows = source.images.reshape(-1, size)
        whole += share * rows.T @ rows
    return whole


@pytest.mark.parametrize("shots", [1, 30, 10_000])
@pytest.mark.parametrize("used", [("T_app",), ("emissivity",), ("T_app", "emissivity")])
def test_distance_is_that_of_the_dense_covariance(shots: int, used: tuple[str, ...]) -> None:
    test = _test()
    kept = np.tile([name in used for name in ("T_app", "emissivity")], len(test.change))
    inside = _dense(test, shots)[np.ix_(kept, kept)]
    d = test.change.ravel()[kept]
    expected = math.sqrt(d @ np.linalg.solve(inside, d))
    assert test.distance(shots, used) == pytest.approx(expected, rel=1e-9)


def _campaigns(
    rng: np.random.Generator, *, apart: float, wider: float, count: int
) -> Iterator[tuple[SeparationTest, list[Floats]]]:
    """Tests of two models that are known by single runs and six draws each, and for each model a
    measurement of it, less the first one.

    Sprays have smooth random fields over 40 blocks, the change by an amount that is not known,
    linear and square, and the second model `wider` times as much of all of these. The models are
    `apart` times a smooth change.
    """
    blocks, draws = np.arange(40), 6
    root = np.linalg.cholesky(
        np.exp(-0.5 * ((blocks[:, None] - blocks) / 4.0) ** 2) + 1e-9 * np.eye(len(blocks))
    )

    def fields(number: int, size: float) -> Floats:
        noise = rng.standard_normal((number, len(blocks), 2))
        return np.asarray(size * np.einsum("ab,nbi->nai", root, noise))

    linear, square = fields(1, 1.0), fields(1, 0.3)
    bump = np.exp(-0.5 * ((blocks[:, None] - (15.0, 25.0)) / 6.0) ** 2)
    sizes = (1.0, wider)
    for _ in range(count):
        runs = [fields(1, 0.3 * size)[0] for size in sizes]

        def sprays(number: int, size: float) -> tuple[Floats, Floats]:
            amount = rng.standard_normal(number)[:, None, None]
            change = amount * linear + (amount**2 - 1.0) * square
            return amount, size * change + fields(number, 0.3 * size)

        unexplained, measured = [], []
        for run, size in zip(runs, sizes, strict=True):
            amount, spray = sprays(draws, size)
            unexplained.append(spray - run - amount * linear)
            measured.append(sprays(1, size)[1][0] - run + 0.1 * rng.standard_normal(run.shape))
        change = apart * bump + runs[1] - runs[0]
        measured[1] = measured[1] + change
        yield (
            SeparationTest(
                change=change,
                noise=np.broadcast_to(0.1**2 * np.eye(2), (len(blocks), 2, 2)),
                sources=(Source(name="amount", images=linear),),
                draws=np.array(unexplained),
            ),
            measured,
        )


def test_a_true_model_is_ruled_out_in_one_percent() -> None:
    """Measurements of models that are equal, alike and apart, in which the second one scatters
    twice as much: of 360, 1 % rule out the true model, and the binomial's limit of 99.9 % is 11.

    If the images of six draws are taken for the covariance, and the difference of two single runs
    for that of the models, it is a third: these errors are the same in many blocks, and the
    difference points away from both models. Where the distance is enough, 95 % are right.
    """
    rng = np.random.default_rng(7)
    right, naive, told = [], [], []
    for apart in (0.0, 1.0, 4.0):
        for test, measured in _campaigns(rng, apart=apart, wider=2.0, count=60):
            images = np.asarray(test.draws)[0] / math.sqrt(6.0)
            known = replace(test, draws=None)
            known = replace(known, sources=(*test.sources, Source.sampled("draws", images)))
            enough = test.distance(1) >= NEEDED
            for number, data in enumerate(measured):
                chances = test.p_values(data, 1)
                right.append(chances[number] < LEVEL)
                naive.append(known.p_values(data, 1)[number] < LEVEL)
                told += [chances[1 - number] < LEVEL] * enough
    assert sum(right) <= 11
    assert np.mean(naive) > 0.2
    assert len(told) > 50 and np.mean(told) > 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / len(told))


def test_samples_reach_blocks_that_they_leave_dark() -> None:
    """M images of which one block has none: a share 1 / (M + 1) of the mean of all blocks."""
    images = np.zeros((3, 4, 2))
    images[:, :3, 0] = 2.0
    source = Source.sampled("injections", images)
    mean = 3 * 3 * 4.0 / 4
    assert np.asarray(source.independent)[:, 0, 0] == pytest.approx(
        [(3 * 12.0 + mean) / 4] * 3 + [mean / 4]
    )


def test_bands_share_what_is_fixed_and_not_the_injections() -> None:
    """One parameter g that both bands of noise 1 show: z^2 = 2 d^2 / (1 + 2 g^2); injections of
    their own add nothing between bands, so that z^2 = 2 d^2 / (1 + g^2)."""
    d, g = 3.0, 2.0
    image = np.array([[[g, 0.0]]])
    for by_injection, square in ((False, 1 + 2 * g**2), (True, 1 + g**2)):
        one = SeparationTest(
            change=np.array([[d, 0.0]]),
            noise=np.eye(2)[None],
            sources=(Source(name="start", images=image, by_injection=by_injection),),
        )
        both = SeparationTest.joined([one, one])
        assert both.distance(1) ** 2 == pytest.approx(2 * d**2 / square)


def _subject(scene: Scene, *, depth: float = 2.0, brighter: float = 0.0) -> Any:
    spray, bare = (tiny_weights(scene, depth=of) for of in (depth, 0.0))
    spray = replace(spray, liquid=np.float32(1.0 + brighter) * spray.liquid)
    quadrature = Quadrature.grey(scene_filter(scene), reference_K=460.0)
    return scene, quadrature, (spray,), bare


def _rivals(scene: Scene, *, rival: Any, **others: Any) -> Rivals:
    model = Subject.of(*_subject(scene), least_emissivity=0.2)
    unknowns = {name: model.of_model(*one) for name, one in others.pop("unknowns", {}).items()}
    return Rivals(
        scene=scene,
        model=model,
        rival=model.of_model(*rival),
        about=model,
        unknowns=unknowns,
        **others,
    )


def _error(pair: Rivals, kelvin: float) -> Floats:
    return np.array([np.full(pair.model.places.size, size) for size in (kelvin, 0.0)])


def test_extinction_is_that_of_the_slabs(tiny_scene: Scene) -> None:
    """The emissivity of a blob is 1 - exp(-depth): in each block, to the weights' float32."""
    fine = tiny_scene.with_(**{"spray.scatter.length_m": 1e-3})  # a block is a pixel
    pair = _rivals(fine, rival=_subject(fine, depth=2.5))
    thin, thick = (tiny_weights(fine, depth=depth).background for depth in (2.0, 2.5))
    seen = [
        image.reshape(12, 2, 16, 2).mean(axis=(1, 3)).ravel()[pair.model.places]
        for image in (thin, thick)
    ]
    expected = seen[0] - seen[1]
    assert pair.test(_BACKGROUNDS).change[:, 1] == pytest.approx(expected, abs=2e-6)


def test_an_amount_that_is_not_known_mimics_depth_but_not_temperature(tiny_scene: Scene) -> None:
    """The blob's depth has a prior of 10 %. A rival that is 20 % deeper is two of its deviations
    away, but for the curvature of 1 - exp(-depth), some 10 % of the change; one that is brighter
    keeps its distance by T_app."""
    unknowns = {"amount": _subject(tiny_scene, depth=2.2)}
    deeper = _rivals(tiny_scene, rival=_subject(tiny_scene, depth=2.4), unknowns=unknowns)
    test = deeper.test(_BACKGROUNDS)
    alone = SeparationTest(change=test.change, noise=test.noise, sources=test.sources[:1])
    assert alone.sources[0].name == "amount"
    # what is left across the image is the curvature: small next to what was there
    bare = alone.without().distance(1, ["emissivity"])
    assert 2.0 < alone.distance(1, ["emissivity"]) < 0.2 * bare
    brighter = _rivals(
        tiny_scene, rival=_subject(tiny_scene, brighter=0.4), unknowns=unknowns
    ).test(_BACKGROUNDS)
    kept = brighter.distance(1, ["T_app"]) / brighter.without("amount").distance(1, ["T_app"])
    assert kept > 0.95


def test_response_is_the_derivative_of_the_evaluation(tiny_scene: Scene) -> None:
    """Central differences of a fit with the same weights, to second order in a step of 1e-3."""
    subject = Subject.of(*_subject(tiny_scene), least_emissivity=0.2)
    response = subject.response(_BACKGROUNDS)
    lines, variance = subject._fitted(_BACKGROUNDS)
    bare, spray = subject.both(_BACKGROUNDS)
    source = subject.filter_boundary.leaving(_BACKGROUNDS)
    for number in range(3):
        shifted = []
        for way in (1e-3, -1e-3):
            moved = spray.copy()
            moved[number] *= 1.0 + way
            fitted = fit_pair(
                (source, source), (bare, moved), variance=(variance, variance),
                usable=np.ones(bare.shape, bool),
            )  # fmt: skip
            kelvin = subject.curve.temperature(apparent_radiance(fitted)[0])
            shifted.append(np.stack([kelvin, 1.0 - fitted.values[:, 2] / fitted.values[:, 0]]))
        slope = (shifted[0] - shifted[1]) / (2e-3 * spray[number])
        assert response[0, number] == pytest.approx(slope[0], rel=1e-3)
        largest = float(np.max(np.abs(slope[1])))
        assert response[1, number] == pytest.approx(slope[1], rel=1e-3, abs=1e-6 * largest)
    assert lines.values.shape == (subject.places.size, 4)


def test_the_fewest_shots(tiny_scene: Scene) -> None:
    """T_app is some 9 K apart, more than the setup errs: one shot less would not be enough."""
    pair = _rivals(tiny_scene, rival=_subject(tiny_scene, brighter=0.4))
    best = pair.best(_BLACKBODY, shot_s=0.2, counts=(2, 3))
    assert best.shots is not None and 1 < best.shots < MOST_SHOTS and best.time_s is not None
    test = pair.test(best.backgrounds_K)
    assert test.distance(best.shots) >= NEEDED > test.distance(best.shots - 1)
    assert best.shots == fewest(test)
    assert best.of_noise > best.distance > max(best.distances.values()) - 1e-9
    assert f"{best.shots} injections" in best.text and best.largest


def test_none_is_enough_where_the_simulations_err_as_much(tiny_scene: Scene) -> None:
    pair = _rivals(tiny_scene, rival=_subject(tiny_scene, brighter=0.005))
    pair = replace(pair, errors={"cells of the simulation": _error(pair, 10.0)})
    best = pair.best(_BLACKBODY, shot_s=0.2)
    assert best.shots is best.time_s is None and best.distance < 1.5
    assert best.text.startswith("undecided: 10000 injections")
    assert best.largest == "cells of the simulation"


def test_draws_leave_what_derivatives_explain(tiny_scene: Scene) -> None:
    """Draws that lie on the derivative leave nothing, to the curvature of a step of 1 % of it;
    those of the rival are about it."""
    unknowns = {"amount": _subject(tiny_scene, depth=2.01)}
    pair = _rivals(tiny_scene, rival=_subject(tiny_scene, depth=2.02), unknowns=unknowns)
    drawn, of_rival = (
        pair.model.of_model(*_subject(tiny_scene, depth=depth)) for depth in (1.98, 2.0)
    )
    for deviations, share in ((-2.0, 0.05), (2.0, 2.1)):
        test = replace(pair, draws=[(np.array([deviations]), drawn, of_rival)]).test(_BACKGROUNDS)
        moved = 2.0 * np.abs(test.sources[0].images[..., 1]).max()
        assert test.sources[0].name == "amount" and test.draws is not None
        for draws in test.draws[..., 1]:
            left = np.abs(draws).max()
            assert left < share * moved if share < 1.0 else left > 1.9 * moved


def test_one_background_is_refused(tiny_scene: Scene) -> None:
    pair = _rivals(tiny_scene, rival=_subject(tiny_scene, brighter=0.1))
    with pytest.raises(EvaluationError, match="440 K alone"):
        pair.best(replace(_BLACKBODY, limits_K=(440.0, 440.0)), shot_s=0.2)


def test_other_views_are_refused() -> None:
    gdi = load_scene("gdi-cone")
    with pytest.raises(EvaluationError, match=r"camera\.field_m: .*0\.0645.* in gdi-cone, .*0\.1"):
        check_rivals(gdi, gdi.with_(**{"camera.field_m": [0.1, 0.1]}))


def test_a_plan_names_the_filter_of_its_band(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The band that decides, or the scene's; none without bands, as of a rig without a wheel."""
    plan = Separation(
        delay_s=None, band="", backgrounds_K=(413.0, 450.0), shots=1, distance=4.5, distances={},
        of_noise=9.0, time_s=60.0, rms_K=1.0, rms_emissivity=0.1,
    )  # fmt: skip
    for band, bands, filters in (
        ("gdi-extinction", ["gdi-extinction"], ("gdi-extinction",)),
        ("", ["gdi-extinction"], ("gdi",)),
        ("", [], ()),
    ):
        found = [replace(plan, band=band)]
        monkeypatch.setattr("cldit.api.planning.separations_of", lambda *_, out=found, **__: out)
        folder = tmp_path / (band or str(len(bands)))
        folder.mkdir()
        planned = separate("gdi", "gdi", folder, bands=bands)
        assert planned.plan == load_plan(folder / "plan.yaml")
        assert planned.plan.filters == filters and planned.plan.shots == 1
    with pytest.raises(SceneError, match="'my gdi' is no name; allowed: up to 40 letters"):
        separate("gdi", "gdi", tmp_path, bands=[load_scene("gdi").with_(name="my gdi")])


@pytest.mark.slow
def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fuel 30 K colder is distinguished, the same scene never; the exit status reports it."""
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(
        "base: droplets-only\ncamera: {pixels: 24, rays_per_pixel: 1}\n"
        "domain: {leaf_edge_m: 4.0e-3}\nspray: {spacing_m: 4.0e-3}\n"
        "transport: {audit: false, directions: 8}\n"
    )
    Path("b.yaml").write_text("base: a.yaml\nspray: {fuel_temperature_K: 340.0}\n")
    Path("free.yaml").write_text("spray.injected_mass_kg: 5 %\n")
    words = ["plan", "--separate", "a.yaml", "b.yaml", "--unknowns", "free.yaml", "--out", "ab"]
    result = CliRunner().invoke(main, [*words, "--json"])
    assert result.exit_code == 0, result.output
    output = result.stdout  # with older versions of click after what is said of the progress
    data = json.loads(output[output.index("{") :])
    (plan,) = data["plans"]
    assert plan["shots"] >= 1 and plan["chosen"] and plan["distance"] >= NEEDED
    assert data["unknowns"] == ["spray.injected_mass_kg (5 %)"]
    assert load_plan(Path("ab/plan.yaml")).shots == plan["shots"]
    Path("none.yaml").write_text("{}\n")
    words = ["plan", "--separate", "a.yaml", "a.yaml", "--unknowns", "none.yaml", "--out", "aa"]
    same = CliRunner().invoke(main, words)
    assert same.exit_code == 3 and "the same T_app and" in same.stdout.replace("\n", " ")
    wrong = CliRunner().invoke(main, ["plan", "a.yaml", "--separate", "a.yaml", "b.yaml"])
    assert wrong.exit_code == 2
