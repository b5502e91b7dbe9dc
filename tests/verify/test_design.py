"""The design of the experiment: what it promises is what the rig then measures.

Rationale: `cldit plan` predicts standard errors from the trace and the sensor alone. The plan that
it writes is run here on the simulated rig, evaluated, and compared: stated errors with predicted
ones, and the temperatures' spread about the truth with both.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cldit.acquisition.plan import load_plan
from cldit.acquisition.runner import acquire
from cldit.api.folder_evaluation import evaluate_folder
from cldit.cli import main
from cldit.dit.design import (
    BlackBody,
    Goal,
    chosen,
    designs,
    plan_of,
    shot_time_s,
)
from cldit.dit.subject import Subject, coldest_K, opaque_errors_K
from cldit.errors import EvaluationError
from cldit.optics.planck import band_radiance
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.radiance.weights import Weights
from cldit.rig.clock import SimulatedClock
from cldit.rig.load import open_rig
from cldit.rig.protocols import Stability
from cldit.rig.simulated import simulated_rig_data
from cldit.scene import Scene, dump_scene, load_scene, parse_scene
from tests.conftest import tiny_weights
from tests.small_scenes import WHOLE

SPRAY_K = 370.0  # of tiny_weights


def _scene(**changes: Any) -> Scene:
    """48 x 36 pixels of the sensor, all before the disc."""
    data: dict[str, Any] = {
        "name": "design",
        "spray": {"model": "none"},
        "camera": {
            "pixels": [48, 36],
            "field_m": [0.08, 0.06],
            "sensor": {"pixels": [48, 36], "bad_pixels": 0, "integration_time_s": 25e-6},
        },
        "background": {"temperatures_K": [360.0, 480.0], "radius_m": 0.06},
        "walls": {"temperature_K": 330.0},
        "rig": {"shot_scatter": 0.0},
    }
    for key, value in changes.items():
        data[key] = {**data.get(key, {}), **value}
    return parse_scene(data)


def _subject(scene: Scene, *, depth: float = 2.0, least: float = 0.2) -> Subject:
    quadrature = Quadrature.grey(
        scene_filter(scene), reference_K=reference_temperature_K(scene.background.temperatures_K)
    )
    spray, bare = (tiny_weights(scene, depth=d) for d in (depth, 0.0))
    return Subject.of(scene, quadrature, (spray,), bare, least_emissivity=least)


BLACKBODY = BlackBody(
    limits_K=(360.0, 480.0),
    start_K=295.0,
    time_constant_s=120.0,
    stability=Stability(),
)


@pytest.mark.parametrize("scatter", [pytest.param(0.0, marks=pytest.mark.slow), 0.04])
def test_the_rig_measures_what_was_promised(tmp_path: Path, scatter: float) -> None:
    """1728 pixels: stated over predicted quantile to 12 %; without scatter chi2 / N to 12 %.

    With scatter, pixels differ from the truth together (one injection has more fuel everywhere),
    so that their chi-square has few degrees of freedom; there the stated errors are held alone.
    """
    scene = _scene(rig={"shot_scatter": scatter, "shot_scatter_length_m": 1e-3})
    subject = _subject(scene)
    goal = Goal(error_K=2.0, emissivity_error=0.02)
    found = designs(subject, BLACKBODY, goal, shot_s=shot_time_s(scene), counts=(2, 3))
    design = chosen(found)
    assert len(design.backgrounds_K) >= 3 and design.time_s >= found[0].time_s
    assert design.error_K <= 2.0 and design.emissivity_error <= 0.02
    (tmp_path / "scene.yaml").write_text(dump_scene(scene), encoding="utf-8")
    for name, depth in (("weights", 2.0), ("weights_reference", 0.0)):
        tiny_weights(scene, depth=depth).save(tmp_path / name, pixel_m=(1e-3, 1e-3))
    clock = SimulatedClock()
    began_s = clock.now_s()
    with open_rig(simulated_rig_data(scene, tmp_path), clock=clock) as rig:
        record = acquire(rig, plan_of(design, scene), tmp_path / "acquisition")
        took_s = clock.now_s() - began_s
    assert record.complete
    assert took_s == pytest.approx(design.time_s, rel=0.15)
    maps = evaluate_folder(tmp_path / "acquisition").maps
    spray = tiny_weights(scene, depth=2.0).background
    here = 1.0 - spray >= 0.2
    error = maps.apparent_temperature_standard_error_K[here].astype(float)
    told = np.isfinite(error)
    assert told.mean() > 0.98
    stated = np.quantile(error[told], 0.9)
    assert stated == pytest.approx(design.error_K, rel=0.2 if scatter else 0.12)
    stated = np.quantile(maps.emissivity_standard_error[here], 0.9)
    assert stated == pytest.approx(design.emissivity_error, rel=0.2 if scatter else 0.12)
    if scatter == 0.0:
        off = maps.apparent_temperature_K[here].astype(float)[told] - SPRAY_K
        assert np.mean((off / error[told]) ** 2) == pytest.approx(1.0, abs=0.12)


def test_variances_are_those_of_brute_force() -> None:
    """T_app of 4000 noisy repetitions of one pixel, through the evaluation's own formulas."""
    from cldit.dit.solve import Signals, solve

    scene = _scene()
    subject = _subject(scene)
    backgrounds = (400.0, 440.0, 480.0)
    n, m = 7, 4
    variances = subject.variances(backgrounds)
    pixel = int(np.argmax(subject.signals(400.0)[0] - subject.signals(400.0)[1]))
    bare, spray = (
        np.array([subject.signals(k)[kind][pixel] for k in backgrounds]) for kind in (0, 1)
    )
    calibration = subject.exposure(480.0).calibration()

    def camera(seen: Any) -> Any:
        variance = calibration.variance_counts2(calibration.counts(seen))
        return variance / calibration.counts_per_radiance**2

    rng = np.random.default_rng(3)
    source = subject.filter_boundary.leaving(backgrounds)

    def signals(seen: Any, exposures: int) -> Signals:
        noise = np.sqrt(camera(seen) / exposures)[:, None] * rng.standard_normal((3, 4000))
        return Signals(source, seen[:, None] + noise, camera, np.full(3, float(exposures)))

    maps = solve(
        signals(bare, m), signals(spray, n), usable=np.ones((3, 4000), bool), curve=subject.curve
    )[0]
    expected = variances[:, 0, pixel] / n + variances[:, 1, pixel] / m
    # 4000 repetitions: 2.2 %; 4 of these
    assert np.var(maps.apparent_temperature_K) == pytest.approx(expected[0], rel=0.09)
    assert np.var(maps.emissivity) == pytest.approx(expected[1], rel=0.09)


def test_more_is_wanted_more_is_spent() -> None:
    """The time grows as the error shrinks."""
    subject = _subject(_scene())
    times, sums = [], []
    for error_K in (4.0, 0.8):
        goal = Goal(error_K=error_K, emissivity_error=1.0)
        best = designs(subject, BLACKBODY, goal, shot_s=1.0, counts=(3,))[0]
        times.append(best.time_s)
        sums.append(best.shots + best.references)
        assert best.error_K <= error_K
    assert times[0] < times[1] and sums[0] < sums[1]


def test_what_cannot_be_reached_is_said() -> None:
    with pytest.raises(EvaluationError, match=r"not reached .* smallest are .* K"):
        designs(_subject(_scene()), BLACKBODY, Goal(error_K=1e-3), shot_s=1.0, counts=(3,))
    with pytest.raises(EvaluationError, match=r"no pixel .* emissivity of 0.99"):
        _subject(_scene(), depth=0.5, least=0.99)


def test_the_papers_limit_comes_out() -> None:
    """Nothing below 340 K at 25 us through the C-H filter (paper, Section 3): the sensor says so.

    The paper evaluates one image before each of five to seven backgrounds. There an opaque spray is
    told to 3 K down to 343 K, and the error doubles every 20 K below; without the filter (2 to
    5 um) the limit is far lower, as the paper says. And a plan for a spray at 320 K needs
    backgrounds and shots that the one at 370 K does not.
    """
    backgrounds = (413.0, 443.0, 473.0, 503.0, 533.0, 563.0)
    subject = _subject(_scene())
    limit = coldest_K(subject, backgrounds, error_K=3.0, emissivity=1.0)
    assert limit == pytest.approx(340.0, abs=6.0)
    cold = opaque_errors_K(subject, np.array([300.0, 320.0, 340.0]), backgrounds, emissivity=1.0)
    assert cold[0] > 4 * cold[2] and cold[1] > 1.8 * cold[2]
    wide = parse_scene({**_scene().model_dump(mode="json"), "optics": {"filter_um": [2.0, 5.0]}})
    assert coldest_K(_subject(wide), backgrounds, error_K=3.0, emissivity=1.0) < limit - 30.0


def test_colder_sprays_take_more_shots() -> None:
    subject = _subject(_scene(), depth=4.0, least=0.5)
    goal = Goal(error_K=2.0, emissivity_error=1.0)
    taken = []
    for kelvin in (330.0, 370.0, 410.0):
        glow = band_radiance(kelvin, filter_um=(3.3, 3.5))
        parts = vars(subject.spray[0])
        gone = 1.0 - parts["background"]
        changed = Weights(
            background=parts["background"],
            wall=0 * gone,
            vapour=0 * gone,
            liquid=(gone * glow).astype(np.float32),
        )
        colder = replace(subject, spray=(changed,))
        best = designs(colder, BLACKBODY, goal, shot_s=1.0, counts=(3,))[0]
        taken.append(best.shots + best.references)
    assert taken[0] > 2 * taken[1] > 2 * taken[2] or taken[2] == 6


def test_black_body_takes_the_shorter_way() -> None:
    body = replace(BLACKBODY, start_K=500.0)
    held = 3 * 60.0
    down = body.time_s((400.0, 440.0, 480.0))
    expected = held + 120.0 * sum(math.log(step / 0.2) for step in (20.0, 40.0, 40.0))
    assert down == pytest.approx(expected)
    assert replace(body, time_constant_s=0.0).time_s((400.0, 440.0, 480.0)) == held


@pytest.mark.slow
def test_the_command_writes_what_the_rig_takes(tmp_path: Path) -> None:
    """`cldit plan` of a small scene: plan.yaml and rig.yaml open, design.png is there."""
    data = load_scene("droplets-only").model_dump(mode="json")
    data["camera"].update(WHOLE)
    data["camera"]["pixels"] = [40, 40]
    data["camera"]["sensor"] |= {"pixels": [40, 40], "bad_pixels": 0}
    data["domain"]["leaf_edge_m"] = 4e-3
    data["spray"]["spacing_m"] = 2e-3
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    out = tmp_path / "plan"
    asked = ["plan", str(tmp_path / "small.yaml"), "--error", "5K", "--out", str(out)]
    result = CliRunner().invoke(main, asked)
    assert result.exit_code == 0, result.output
    assert "K at 340 K" in " ".join(result.output.split())
    plan = load_plan(out / "plan.yaml")
    assert len(plan.backgrounds_K) >= 3 and plan.shots >= 3
    open_rig(out / "rig.yaml").close()
    assert (out / "design.png").stat().st_size > 10_000
    refused = CliRunner().invoke(main, [*asked[:3], "0K"])
    assert refused.exit_code != 0 and "more than 0" in refused.output
