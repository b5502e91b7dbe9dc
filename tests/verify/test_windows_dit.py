"""The measurement equation: what windows, a grey background and the walls do, and its inverse.

Rationale: with everything at one temperature the camera sees that black body through any windows
(second law). DIT divides out what windows and a grey background do, so without noise emissivity
and apparent temperature come back exactly; float32 weights leave 1e-6 of emissivity.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cldit.acquisition import plan_from_scene
from cldit.acquisition.record import open_acquisition
from cldit.acquisition.runner import acquire
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.recorded import evaluate_shots
from cldit.optics.planck import band_radiance
from cldit.optics.response import Filter, Response
from cldit.optics.spectral import Quadrature
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance
from cldit.radiance.weights import Weights
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.scene import Scene, dump_scene, parse_scene
from cldit.scene.vessel import Window
from tests.conftest import tiny_weights

FILTERS: list[Filter] = [(3.3, 3.5), Response(((3.2, 0.0), (3.35, 0.8), (3.5, 0.7), (3.6, 0.0)))]
BOTH = (
    Window(side="rear", material="CaF2", thickness_m=0.01, temperature_K=400.0),
    Window(side="front", material="sapphire", thickness_m=0.02, temperature_K=380.0),
)
RIG = Surroundings(
    wall_temperature_K=450.0,
    background_emissivity=0.92,
    background_surroundings_K=310.0,
    camera_surroundings_K=296.0,
    windows=BOTH,
)


def at_one_temperature(kelvin: float) -> Surroundings:
    return replace(
        RIG,
        wall_temperature_K=kelvin,
        background_surroundings_K=None,
        camera_surroundings_K=kelvin,
        windows=tuple(window.model_copy(update={"temperature_K": kelvin}) for window in BOTH),
    )


def image(value: object) -> Any:
    return np.array(value, np.float32, ndmin=2)


@pytest.mark.parametrize("filter_um", FILTERS)
@pytest.mark.parametrize("kelvin", [250.0, 450.0, 1500.0])
def test_cavity_with_windows_is_flat(filter_um: Filter, kelvin: float) -> None:
    own = float(band_radiance(kelvin, filter_um=filter_um))
    boundary = Boundary.in_filter(at_one_temperature(kelvin), filter_um, reference_K=450.0)
    weights = Weights(
        background=image([0.0, 0.3, 1.0]),
        wall=image([1.0, 0.2, 0.0]),
        vapour=image([0.0, 0.1 * own, 0.0]),
        liquid=image([0.0, 0.4 * own, 0.0]),
    )
    seen = camera_radiance([weights], [boundary], background_K=kelvin)
    np.testing.assert_allclose(seen / own, 1.0, atol=1e-6)  # weights are float32
    assert float(boundary.leaving(kelvin)) == pytest.approx(own, rel=1e-12)


@pytest.mark.parametrize("filter_um", FILTERS)
@pytest.mark.parametrize("windows", [(), BOTH[:1], BOTH[1:], BOTH])
def test_dit_inverts_windows(filter_um: Filter, windows: tuple[Window, ...]) -> None:
    """An absorbing spray at 400 to 540 K before a grey background."""
    emissivity = np.array([[0.02, 0.1, 0.5, 0.9, 0.999]])
    kelvin = np.array([[400.0, 430.0, 470.0, 510.0, 540.0]])
    glow = emissivity * band_radiance(kelvin, filter_um=filter_um)
    spray = Weights(image(1 - emissivity), image(0 * kelvin), image(0.3 * glow), image(0.7 * glow))
    bare = Weights(*(image(np.full((1, 5), value)) for value in (1.0, 0.0, 0.0, 0.0)))
    maps = evaluate_radiance(
        spray,
        bare,
        background_temperatures_K=[413.0, 443.0, 503.0, 563.0],
        surroundings=replace(RIG, windows=windows),
        filter_um=filter_um,
        sensor=None,
        shots=1,
        references=1,
    )
    np.testing.assert_allclose(maps.emissivity, emissivity, atol=1e-6)
    # 1 - emissivity is stored as float32: 3e-8 of 1, which at 2 % emissivity is 1.5e-6 of T_app's
    # radiance, 5e-5 K; the emission likewise.
    np.testing.assert_allclose(maps.apparent_temperature_K, kelvin, atol=1e-3)


def test_front_window_by_hand() -> None:
    """t L + e B + r B, the terms written out for one number each."""
    filter_um = (3.3, 3.5)
    boundary = Boundary.in_filter(RIG, filter_um, reference_K=480.0)
    front, rear = boundary.front, boundary.rear

    def black(kelvin: float) -> float:
        return float(band_radiance(kelvin, filter_um=filter_um))

    leaving = (
        rear.transmission * (0.92 * black(500.0) + 0.08 * black(310.0))
        + rear.emission * black(400.0)
        + rear.reflection * black(450.0)
    )
    assert float(boundary.leaving(500.0)) == pytest.approx(leaving, rel=1e-12)
    inside = np.array([[leaving]])
    seen = front.transmission * leaving + front.emission * black(380.0)
    seen += front.reflection * black(296.0)
    assert float(boundary.seen(inside)[0, 0]) == pytest.approx(seen, rel=1e-12)
    assert boundary.inside(boundary.seen(inside)) == pytest.approx(inside)


def test_nodes_of_a_grey_spray_are_one() -> None:
    """Three nodes with equal weights give what one gives; 1e-4 for their windows' means."""
    filter_um = (3.3, 3.5)
    split = Quadrature(
        filter_um,
        (3.3, 3.36, 3.42, 3.5),
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        480.0,
    )
    through = image([[0.9, 0.5, 0.1]])
    glow = [(1 - through) * node.radiance(430.0) for node in split.nodes]
    traces = [Weights(through, 0 * through, image(g), 0 * through) for g in glow]
    bare = Weights(through * 0 + 1, 0 * through, 0 * through, 0 * through)
    common: dict[str, Any] = {
        "background_temperatures_K": [413.0, 488.0, 563.0],
        "surroundings": RIG,
        "filter_um": filter_um,
        "sensor": None,
        "shots": 1,
        "references": 1,
    }
    three = evaluate_radiance(traces, bare, nodes=split.nodes, **common)
    turned = evaluate_radiance(traces[::-1], bare, nodes=split.nodes[::-1], **common)
    np.testing.assert_allclose(three.emissivity, 1 - through, atol=1e-4)
    np.testing.assert_allclose(three.apparent_temperature_K, 430.0, atol=0.01)
    np.testing.assert_allclose(
        turned.apparent_temperature_K, three.apparent_temperature_K, atol=1e-4
    )


def test_the_rig_sees_through_its_windows(tiny_scene: Scene, tmp_path: Any) -> None:
    """Simulated rig with two windows and a grey background, evaluated from its recorded files."""
    data = tiny_scene.model_dump(mode="json")
    data["windows"] = [window.model_dump(mode="json") for window in BOTH]
    data["background"] |= {"emissivity": 0.92, "temperatures_K": [440.0, 500.0, 560.0]}
    data["background"]["surroundings_K"] = 310.0
    data["spray"]["scatter"]["optical_depth"] = 0.0
    data["plan"] = {"shots": 4, "references": 4}
    scene = parse_scene(data)
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "scene.yaml").write_text(dump_scene(scene), encoding="utf-8")
    for name, depth in (("weights", 2.0), ("weights_reference", 0.0)):
        tiny_weights(scene, depth=depth).save(folder / name, pixel_m=(5e-3, 5e-3))
    with open_rig(simulated_rig_data(scene, folder)) as rig:
        acquire(rig, plan_from_scene(scene), tmp_path / "shots")
    maps = evaluate_shots(open_acquisition(tmp_path / "shots")).maps
    middle = maps.emissivity > 0.5
    assert middle.sum() > 20
    off = (maps.apparent_temperature_K - 370.0) / maps.apparent_temperature_standard_error_K
    # Mean of n independent pixels: 4 / sqrt(n); without the windows in the evaluation it is -5.
    assert abs(float(np.mean(off[middle]))) < 4 / np.sqrt(middle.sum())
