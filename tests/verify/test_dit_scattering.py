"""The evaluation that knows about scattering, against closed sets of weights and a trace.

Rationale: transfer is linear, so walls' light is a share of what a pixel shows, and with that share
known, or measured by two wall temperatures, the temperature of what emits comes back exactly.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.acquisition.plan import plan_from_scene
from cldit.acquisition.runner import acquire
from cldit.camera.curve import Curve
from cldit.camera.sensor import SensorModel
from cldit.cli import main
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps
from cldit.dit.scattering import (
    Medium,
    droplet_radiance,
    measured_share,
    medium_of_two_walls,
    medium_temperature,
    wall_share,
)
from cldit.errors import EvaluationError
from cldit.gpu.device import Device
from cldit.images import read_image
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from cldit.report.scattering_page import scattering_picture, scattering_table
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.run import simulate
from cldit.scattering_study import scattering_study, wrong_models
from cldit.scene import load_scene, parse_scene
from cldit.scene.schema import Scene
from cldit.scene.spray import EmptySpray

FILTER = (3.3, 3.5)
CURVE = Curve(filter_um=FILTER)
VAPOUR_K, DROPLETS_K = 470.0, 380.0


def _weights(**parts: object) -> Weights:
    return Weights.of({name: np.asarray(part, np.float32) for name, part in parts.items()})


def _spray() -> tuple[Weights, Weights, np.ndarray, np.ndarray]:
    """Spray, reference, and the shares of either phase: any closed set of weights."""
    rng = np.random.default_rng(7)
    share = rng.dirichlet([1.0, 1.0, 1.0, 1.0], (20, 30))
    hot, cold = band_radiance([VAPOUR_K, DROPLETS_K], filter_um=FILTER)
    spray = _weights(
        background=share[..., 0],
        wall=share[..., 1],
        vapour=share[..., 2] * hot,
        liquid=share[..., 3] * cold,
    )
    one, none = np.ones((20, 30)), np.zeros((20, 30))
    bare = _weights(background=one, wall=none, vapour=none, liquid=none)
    return spray, bare, share[..., 2], share[..., 3]


def _maps(wall_K: float, *, shots: int | None = None) -> Maps:
    spray, bare, _, _ = _spray()
    sensor = None
    if shots is not None:
        sensor = SensorModel.from_scene(Scene(name="t", spray=EmptySpray()))
    return evaluate_radiance(
        spray,
        bare,
        background_temperatures_K=(400.0, 440.0, 480.0, 520.0),
        surroundings=Surroundings(wall_temperature_K=wall_K),
        filter_um=FILTER,
        sensor=sensor,
        shots=shots or 1,
        references=shots or 1,
    )


def _truth_K() -> np.ndarray:
    spray, _, vapour, liquid = _spray()
    total = spray.vapour.astype(float) + spray.liquid
    return np.asarray(CURVE.temperature(total / (vapour + liquid)))


def _same(medium: Medium, *, least: float = 0.9) -> None:
    told = np.isfinite(medium.temperature_K)
    assert told.mean() > least
    # float32 weights and maps: 1e-7 and 3e-5 K, over an own share of 0.1 at the least
    np.testing.assert_allclose(medium.temperature_K[told], _truth_K()[told], atol=5e-3)


def test_with_the_models_share_what_emits_comes_back() -> None:
    spray, bare, _, _ = _spray()
    for wall_K in (0.0, 300.0, 450.0, 600.0):
        share = wall_share(spray, bare)
        _same(medium_temperature(_maps(wall_K), share, wall_temperature_K=wall_K, curve=CURVE))
    # Plain DIT is off by tens of kelvin there.
    assert np.std(_maps(300.0).apparent_temperature_K - _truth_K()) > 10.0


def test_two_walls_need_no_model() -> None:
    maps = [_maps(kelvin) for kelvin in (450.0, 400.0)]
    share, _ = measured_share(*maps, wall_temperatures_K=(450.0, 400.0), curve=CURVE)
    spray, bare, _, _ = _spray()
    np.testing.assert_allclose(share, wall_share(spray, bare), atol=2e-4)
    _same(medium_of_two_walls(*maps, wall_temperatures_K=(450.0, 400.0), curve=CURVE))
    with pytest.raises(EvaluationError, match="do not differ"):
        medium_of_two_walls(*maps, wall_temperatures_K=(450.0, 450.0), curve=CURVE)


def test_droplets_are_told_from_vapour_by_the_model_alone() -> None:
    spray, _, _, liquid = _spray()
    radiance = droplet_radiance(_maps(450.0), spray, liquid, wall_temperature_K=450.0, curve=CURVE)
    kelvin = CURVE.temperature(radiance)
    told = np.isfinite(kelvin)
    assert told.mean() > 0.7
    np.testing.assert_allclose(kelvin[told], DROPLETS_K, atol=0.05)


@pytest.mark.parametrize("walls", [(450.0, 400.0), (450.0, 350.0)])
def test_errors_of_two_walls_by_brute_force(walls: tuple[float, float]) -> None:
    """T_app of both walls drawn 2000 times with their stated errors: spread as stated to 15 %."""
    maps = [_maps(kelvin, shots=50) for kelvin in walls]
    stated = medium_of_two_walls(*maps, wall_temperatures_K=walls, curve=CURVE)
    rng = np.random.default_rng(2)
    row = 5
    drawn = []
    for one in maps:
        kelvin = one.apparent_temperature_K[row].astype(float)
        error = one.apparent_temperature_standard_error_K[row].astype(float)
        image = (kelvin + error * rng.standard_normal((2000, kelvin.size))).astype(np.float32)
        empty = np.zeros_like(image)
        drawn.append(Maps(empty, image, empty, empty, empty.astype(np.uint8), empty, empty))
    found = medium_of_two_walls(*drawn, wall_temperatures_K=walls, curve=CURVE).temperature_K
    error = stated.standard_error_K[row]
    good = np.isfinite(error) & (error < 3.0) & np.isfinite(found).all(axis=0)
    assert good.sum() > 5
    # 2000 draws: 1.6 % of a standard deviation; the rest is second order at errors of some kelvin
    np.testing.assert_allclose(np.std(found[:, good], axis=0), error[good], rtol=0.15)


def test_shapes_must_agree() -> None:
    with pytest.raises(EvaluationError, match=r"\(3, 3\) pixels, the maps have \(20, 30\)"):
        medium_temperature(_maps(450.0), np.zeros((3, 3)), wall_temperature_K=450.0, curve=CURVE)


def _small(name: str = "droplets-only") -> Scene:
    data = load_scene(name).model_dump(mode="json")
    data["camera"]["pixels"] = [40, 40]
    data["camera"]["sensor"] |= {"pixels": [40, 40], "bad_pixels": 0}
    data["domain"]["leaf_edge_m"] = 4e-3
    data["spray"]["spacing_m"] = 2e-3
    data["plan"] = {"shots": 3, "references": 3}
    data["rig"]["shot_scatter"] = 0.0
    data["background"]["temperatures_K"] = [413.0, 473.0, 533.0]
    return parse_scene(data)


def test_a_model_makes_droplets_their_own_temperature(device: Device, tmp_path: Path) -> None:
    """Droplets at 370 K before walls at 450 K, recorded by the rig; `cldit evaluate --model`.

    Plain DIT shows them too warm by what they scatter of the walls; with the model, 370 K within
    the noise.
    """
    scene = _small()
    run = simulate(scene, tmp_path / "run", device=device)
    with open_rig(simulated_rig_data(scene, tmp_path / "run")) as rig:
        plan = plan_from_scene(scene, integration_time_s=run.info.integration_time_s)
        acquire(rig, plan, tmp_path / "shots")
    result = CliRunner().invoke(
        main, ["evaluate", str(tmp_path / "shots"), "--model", str(tmp_path / "run")]
    )
    assert result.exit_code == 0, result.output
    assert "temperature of what emits" in result.output
    maps = Maps.load(tmp_path / "shots" / "maps")
    medium, error = (
        read_image(tmp_path / "shots" / "maps" / f"medium_temperature{end}_K.tif")[0]
        for end in ("", "_standard_error")
    )
    sure = np.isfinite(medium) & (maps.emissivity > 0.2)
    assert sure.sum() > 20
    assert np.median(maps.apparent_temperature_K[sure]) > 380.0
    pull = ((medium - 370.0) / error)[sure]
    # As many as there are pixels; the model itself is traced to 0.1 K.
    assert abs(np.mean(pull)) < 4.0 / np.sqrt(sure.sum()) + 0.2
    assert np.mean(pull**2) == pytest.approx(1.0, abs=0.6)


@pytest.mark.slow
def test_the_study_says_what_is_gained(device: Device, tmp_path: Path) -> None:
    """Droplets alone: a model 20 % off still leaves less than half of plain DIT's error."""
    study = scattering_study(_small(), device, cache=tmp_path)
    rows = {(row.method, row.model): row for row in study.rows}
    plain = rows["plain DIT", "none"]
    assert plain.droplets_rms_K > 10.0 and study.wet == 1.0
    for model in wrong_models(_small()):
        known = rows["scattered share", model]
        # 0.1 K: accuracy of the trace
        assert known.droplets_rms_K < (0.2 if model == "right" else 0.5 * plain.droplets_rms_K)
    walls = [row for row in study.rows if row.method == "two walls"]
    assert walls[0].medium_rms_K < 0.2 < walls[1].medium_rms_K
    assert scattering_table(study).count("\n") == len(study.rows) + 2
    assert scattering_picture(study).startswith(b"\x89PNG")


def test_the_study_refuses_what_it_cannot_vary() -> None:
    with pytest.raises(EvaluationError, match="needs one with plumes"):
        wrong_models(Scene(name="t", spray=EmptySpray()))
