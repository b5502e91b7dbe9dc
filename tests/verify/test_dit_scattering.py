"""The evaluation that knows about scattering, against closed sets of weights and a trace.

Rationale: transfer is linear, so walls' light is a share of what a pixel shows, and with that share
known, or measured by two wall temperatures, the temperature of what emits comes back exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
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
    enclosure,
    medium_of_enclosures,
    medium_temperature,
    scattered_by,
)
from cldit.errors import EvaluationError
from cldit.gpu.device import Device
from cldit.io.images import read_image
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.run import simulate
from cldit.scene import load_scene, parse_scene
from cldit.scene.schema import Scene
from cldit.scene.spray import EmptySpray
from cldit.scene.vessel import Patch
from tests.small_scenes import WHOLE

FILTER = (3.3, 3.5)
CURVE = Curve(filter_um=FILTER)
_NONE: Mapping[str, float] = {}
_DARK = {name: np.zeros((3, 3)) for name in ("vapour", "liquid")}
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


def _walls(kelvin: float, **patches_K: float) -> Surroundings:
    """Walls, and patches of emissivity 0.9 that reflect them."""
    patches = tuple(
        Patch(
            name=name,
            centre_m=(0.0, 0.0, 0.0),
            facing=(1.0, 0.0, 0.0),
            radius_m=0.1,
            temperature_K=patch_K,
            emissivity=0.9,
        )
        for name, patch_K in patches_K.items()
    )
    return Surroundings(wall_temperature_K=kelvin, patches=patches)


def _light(kelvin: float, **patches_K: float) -> dict[str, float]:
    return enclosure(_walls(kelvin, **patches_K), CURVE)


def _maps(
    wall_K: float, patches_K: Mapping[str, float] = _NONE, *, shots: int | None = None
) -> Maps:
    spray, bare = _patched() if patches_K else _spray()[:2]
    sensor = None
    if shots is not None:
        sensor = SensorModel.from_scene(Scene(name="t", spray=EmptySpray()))
    return evaluate_radiance(
        spray,
        bare,
        background_temperatures_K=(400.0, 440.0, 480.0, 520.0),
        surroundings=_walls(wall_K, **patches_K),
        filter_um=FILTER,
        sensor=sensor,
        shots=shots or 1,
        references=shots or 1,
    )


def _patched() -> tuple[Weights, Weights]:
    """The same, its walls' light in parts from a window and a flange, which the bare background
    does not see all of: a tenth of the window stands before it."""
    spray, bare, _, _ = _spray()
    part = np.linspace(0.1, 0.6, 30, dtype=np.float32)
    images, before = dict(spray.images), dict(bare.images)
    images |= {"window": part * images["wall"], "flange": np.float32(0.3) * images["wall"]}
    images["wall"] = images["wall"] - images["window"] - images["flange"]
    before |= {"window": 0.1 * before["background"], "flange": 0.0 * before["wall"]}
    before["background"] = 0.9 * before["background"]
    # What still comes straight through comes in the same parts.
    images["window"] = images["window"] + np.float32(0.1) * images["background"]
    images["background"] = np.float32(0.9) * images["background"]
    return Weights.of(images), Weights.of(before)


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
        scattered = scattered_by(spray, bare, _light(wall_K))
        _same(medium_temperature(_maps(wall_K), scattered, CURVE))
    # Plain DIT is off by tens of kelvin there.
    assert np.std(_maps(300.0).apparent_temperature_K - _truth_K()) > 10.0


def test_two_walls_need_no_model() -> None:
    maps = [_maps(kelvin) for kelvin in (450.0, 400.0)]
    light = [_light(kelvin) for kelvin in (450.0, 400.0)]
    share = medium_of_enclosures(maps, light, CURVE).share
    spray, bare, _, _ = _spray()
    np.testing.assert_allclose(share, scattered_by(spray, bare, light[0])[0], atol=2e-4)
    _same(medium_of_enclosures(maps, light, CURVE))
    with pytest.raises(EvaluationError, match="do not differ"):
        medium_of_enclosures(maps, [light[0]] * 2, CURVE)


PATCHES = (
    (450.0, {"window": 300.0, "flange": 500.0}),
    (400.0, {"window": 300.0, "flange": 500.0}),
    (450.0, {"window": 360.0, "flange": 500.0}),
    (450.0, {"window": 300.0, "flange": 430.0}),
)


def test_patches_are_parts_of_the_enclosure() -> None:
    """A window and a flange of their own temperatures: with a model's shares of each, and with
    three changes and no model, what emits comes back as it does before walls alone."""
    light = [_light(wall_K, **patches_K) for wall_K, patches_K in PATCHES]
    maps = [_maps(wall_K, patches_K) for wall_K, patches_K in PATCHES]
    # Taken for walls of one temperature they would leave some kelvin.
    as_walls = medium_temperature(maps[0], scattered_by(*_spray()[:2], _light(450.0)), CURVE)
    told = np.isfinite(as_walls.temperature_K)
    assert np.std((as_walls.temperature_K - _truth_K())[told]) > 2.0
    _same(medium_temperature(maps[0], scattered_by(*_patched(), light[0]), CURVE))
    _same(medium_of_enclosures(maps, light, CURVE), least=0.85)


def test_parts_that_cannot_be_told_apart_are_named() -> None:
    light = [_light(wall_K, **patches_K) for wall_K, patches_K in PATCHES]
    maps = [_maps(wall_K, patches_K) for wall_K, patches_K in PATCHES]
    with pytest.raises(EvaluationError, match="2 do not separate wall, window, flange"):
        medium_of_enclosures(maps[:2], light[:2], CURVE)  # the patches reflect the walls
    with pytest.raises(EvaluationError, match="flange has one temperature only"):
        black = [{**one, "flange": light[0]["flange"]} for one in light[:3]]
        medium_of_enclosures(maps[:3], black, CURVE)
    with pytest.raises(EvaluationError, match="not all have the parts wall"):
        medium_of_enclosures(maps[:2], [_light(450.0), light[0]], CURVE)
    with pytest.raises(EvaluationError, match=r"patches are none, those of the .* window, flange"):
        scattered_by(*_spray()[:2], light[0])


@pytest.mark.parametrize("walls", [(450.0, 400.0), (450.0, 350.0)])
def test_errors_of_two_walls_by_brute_force(walls: tuple[float, float]) -> None:
    """T_app of both walls drawn 2000 times with their stated errors: spread as stated to 15 %."""
    maps = [_maps(kelvin, shots=50) for kelvin in walls]
    light = [_light(kelvin) for kelvin in walls]
    stated = medium_of_enclosures(maps, light, CURVE)
    rng = np.random.default_rng(2)
    row = 5
    drawn = []
    for one in maps:
        kelvin = one.apparent_temperature_K[row].astype(float)
        error = one.apparent_temperature_standard_error_K[row].astype(float)
        image = (kelvin + error * rng.standard_normal((2000, kelvin.size))).astype(np.float32)
        empty = np.zeros_like(image)
        codes = empty.astype(np.uint8)
        drawn.append(Maps(empty, image, empty, empty, codes, empty, empty, empty))
    found = medium_of_enclosures(drawn, light, CURVE).temperature_K
    error = stated.standard_error_K[row]
    good = np.isfinite(error) & (error < 3.0) & np.isfinite(found).all(axis=0)
    assert good.sum() > 5
    # 2000 draws: 1.6 % of a standard deviation; the rest is second order at errors of some kelvin
    np.testing.assert_allclose(np.std(found[:, good], axis=0), error[good], rtol=0.15)


def test_shapes_must_agree() -> None:
    small = _weights(**{name: np.ones((3, 3)) for name in ("background", "wall")} | _DARK)
    scattered = scattered_by(small, small, _light(450.0))
    with pytest.raises(EvaluationError, match=r"\(3, 3\) pixels, the maps have \(20, 30\)"):
        medium_temperature(_maps(450.0), scattered, CURVE)


def _with_patch(scene: Scene, **patch: object) -> Scene:
    """A disc in the side wall."""
    data = scene.model_dump(mode="json")
    data["patches"] = [{"centre_m": [0.1, 0.0, -0.05], "radius_m": 0.06, **patch}]
    return parse_scene(data)


def _small(name: str = "droplets-only", *, accuracy_K: float = 1.0) -> Scene:
    data = load_scene(name).model_dump(mode="json")
    data["camera"].update(WHOLE)
    data["transport"]["accuracy_K"] = accuracy_K
    data["camera"]["pixels"] = [40, 40]
    data["camera"]["sensor"] |= {"pixels": [40, 40], "bad_pixels": 0}
    data["domain"]["leaf_edge_m"] = 4e-3
    data["spray"]["spacing_m"] = 2e-3
    data["plan"] = {"shots": 3, "references": 3}
    data["spray"]["scatter"]["optical_depth"] = 0.0
    data["background"]["temperatures_K"] = [413.0, 473.0, 533.0]
    return parse_scene(data)


@pytest.mark.slow
def test_a_model_makes_droplets_their_own_temperature(device: Device, tmp_path: Path) -> None:
    """Droplets at 370 K before walls at 450 K with a hot flange, recorded by the rig; `cldit
    evaluate --model`.

    Plain DIT shows them too warm by what they scatter of both; with the model, 370 K within the
    noise.
    """
    scene = _with_patch(_small(), name="flange", facing=[-1, 0, 0], temperature_K=500.0)
    run = simulate(scene, tmp_path / "run", device=device)
    with open_rig(simulated_rig_data(scene, tmp_path / "run")) as rig:
        plan = plan_from_scene(scene, integration_time_s=run.info.integration_time_s)
        acquire(rig, plan, tmp_path / "shots")
    result = CliRunner().invoke(
        main, ["evaluate", str(tmp_path / "shots"), "--model", str(tmp_path / "run")]
    )
    assert result.exit_code == 0, result.output
    assert "temperature of the medium" in result.output
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
