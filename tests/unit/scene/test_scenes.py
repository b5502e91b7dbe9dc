"""Scenes: those that are shipped, the way to YAML and back, and what a wrong one is told."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cldit.acquisition.journal import parse_entry
from cldit.errors import SceneError
from cldit.gpu.device import Device
from cldit.io.plain_data import parse_yaml
from cldit.optics.liquid import liquid
from cldit.optics.vapour import vapour_band
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.medium import prepare
from cldit.prepare.preview import previewed
from cldit.prepare.stages import Stages
from cldit.scene import Scene, dump_scene, load_scene, parse_scene, shipped_scenes
from cldit.scene.curves import check_curve
from cldit.scene.load import chosen_scene
from cldit.scene.sizes import Histogram, LogNormal, Monodisperse, NukiyamaTanasawa, RosinRammler
from cldit.scene.spray import ConeSpray

SHIPPED = (
    "droplets-only",
    "empty",
    "gdi-cold",
    "gdi-cone",
    "gdi-extinction",
    "gdi",
    "methane-jet",
)


def _scene(**sections: Any) -> Scene:
    return parse_scene({"name": "test", "spray": {"model": "cone"}, **sections})


def _complaint(**sections: Any) -> str:
    with pytest.raises(SceneError) as caught:
        _scene(**sections)
    first, *lines = str(caught.value).splitlines()
    assert first == "scene:"
    return "\n".join(lines)


def test_shipped_scenes_are_described() -> None:
    shipped = shipped_scenes()
    assert tuple(shipped) == SHIPPED
    assert all(len(text) > 10 and "\n" not in text for text in shipped.values())


@pytest.mark.parametrize("name", SHIPPED)
def test_there_and_back(name: str) -> None:
    scene = load_scene(name)
    assert scene.name == name
    again = parse_scene(yaml.safe_load(dump_scene(scene)))
    assert again == scene
    assert dump_scene(again) == dump_scene(scene)


def test_extinction_is_seen_where_vapour_is_transparent() -> None:
    """The scene's constants are those of the shipped spectra.

    n and k: mean of the filter at 370 K, to their digits. The vapour's table ends at 3.92 um and
    falls to there, so that its value at 3.9 um is more than any in the filter; it is 300 times less
    than in the C-H band, and k 100 times less than at 3.4 um.
    """
    scene, band = load_scene("gdi-extinction"), load_scene("gdi").optics
    assert scene.spray == load_scene("gdi").spray
    optics, filter_um = scene.optics, np.linspace(3.9, 4.0, 101)
    n, k = liquid("n-heptane").index(filter_um, 370.0)
    assert (optics.n, optics.k) == pytest.approx((n.mean(), k.mean()), rel=5e-3)
    vapour = vapour_band("n-heptane")
    number = 1e4 / np.linspace(3.9, 1e4 / vapour.wavenumber_per_cm[0], 20)
    table = vapour.absorption_m2_mol(number, 490.0)
    assert optics.vapour_m2_mol == pytest.approx(table[0], rel=0.02)
    assert np.all(np.diff(table) < 0.0)
    in_band = vapour.absorption_m2_mol(1e4 / np.linspace(3.3, 3.5, 200), 490.0).mean()
    assert in_band > 300.0 * optics.vapour_m2_mol
    assert liquid("n-heptane").index(3.4, 370.0)[1] > 100.0 * optics.k and band.k > 90.0 * optics.k


@pytest.mark.parametrize(
    ("droplets", "kind"),
    [
        ({"diameter_um": 9.0}, Monodisperse),
        ({"m_um": 3.21, "n": 1.28822, "p": 2.0}, NukiyamaTanasawa),
        ({"median_um": 6.0, "sigma": 1.6}, LogNormal),
        ({"d_um": 10.0, "q": 1.8}, RosinRammler),
        ({"edges_um": [0.0, 4.0, 8.0], "number": [3.0, 0.0]}, Histogram),
        ({}, NukiyamaTanasawa),
    ],
)
def test_sizes_there_and_back(droplets: dict[str, object] | None, kind: type) -> None:
    scene = _scene(spray={"model": "cone", "droplets": droplets})
    assert isinstance(scene.spray, ConeSpray)
    assert type(scene.spray.droplets) is kind
    assert parse_scene(yaml.safe_load(dump_scene(scene))) == scene


def test_keys_that_runs_of_older_versions_store() -> None:
    box = {"spacing_m": 1e-3, "above_m": 5e-3, "width_m": None}
    scene = _scene(spray={"model": "lagrangian", "box": box})
    assert scene == _scene(spray={"model": "lagrangian", "box": {"spacing_m": 1e-3}})


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"camera": {"pixels": 0}}, "camera.pixels: 0 is outside 1..16384"),
        (
            {"camera": {"pixel": 3}},
            "camera.pixel: unknown key; did you mean pixels?; allowed: model, distance_m, "
            "field_m, pixels, "
            "rays_per_pixel, target_m, surroundings_K, sensor",
        ),
        ({"camera": {"sensor": {"bits": 17}}}, "camera.sensor.bits: 17 is outside 8..16"),
        ({"camera": {"field_m": [0.1]}}, "camera.field_m: a value is missing"),
        (
            {"walls": {"temperature_K": "450 K"}},
            "walls.temperature_K: '450 K' is not a number; allowed: 0..5000 without a unit",
        ),
        ({"walls": {"temperature_K": True}}, "walls.temperature_K: True is not a number; "),
        ({"walls": {"temperature_K": float("nan")}}, "walls.temperature_K: nan is outside 0..5000"),
        ({"walls": {"temperature_K": -1}}, "walls.temperature_K: -1 is outside 0..5000"),
        (
            {"optics": {"filter_um": [3.5, 3.3]}},
            "optics: filter_um: 3.5 to 3.3 is empty; allowed: a lower and a higher wavelength",
        ),
        ({"name": ""}, "name: "),
        (
            {"domain": {"leaf_edge_m": 1e-5}},
            "domain: leaf_edge_m: 1e-05 is finer than edge_m / 4096 = 4.88281e-05",
        ),
        (
            {"background": {"temperatures_K": []}},
            "background.temperatures_K: 0 temperatures; allowed: 1..1000",
        ),
        (
            {"spray": {"model": "fog"}},
            "spray.model: fog is unknown; allowed: cone, lagrangian, grid, cfd, none",
        ),
        ({"spray": {}}, "spray.model: is missing; allowed: cone, lagrangian, grid, cfd, none"),
        ({"spray": {"model": "grid"}}, "spray.file: is missing"),
        (
            {"spray": {"model": "none", "file": "x.npz"}},
            "spray.file: unknown key; allowed: model",
        ),
        # An unknown key that is called like the member of a union is still an unknown key.
        ({"spray": {"model": "none", "cone": 1}}, "spray.cone: unknown key; allowed: model"),
        (
            {"spray": {"model": "cone", "plumes": [{"inclination_deg": 99, "azimuth_deg": 0}]}},
            "spray.plumes[0].inclination_deg: 99 is outside 0..89",
        ),
        (
            {"spray": {"model": "cone", "droplets": {"edges_um": [1, 2, 3], "number": [1]}}},
            "spray.droplets: number: 1 values for 3 edges; allowed: 1..1000 values, one less",
        ),
        (
            {"spray": {"model": "cone", "droplets": {"edges_um": [1, 3, 2], "number": [1, 1]}}},
            "spray.droplets: edges_um: must rise",
        ),
        (
            {"spray": {"model": "cone", "droplets": {"edges_um": [1, 2], "number": [0]}}},
            "spray.droplets: number: all bins are empty",
        ),
        (
            {"spray": {"model": "cone", "droplets": 9}},
            "spray.droplets: is no size distribution; allowed: {m_um, n, p}, {diameter_um}, "
            "{median_um, sigma}, {d_um, q}, {edges_um, number} or null",
        ),
        (
            {"spray": {"model": "lagrangian", "box": {"width_m": 0.08}}},
            "spray.box: width_m: no key of this version; use depth_m, half of it or more",
        ),
    ],
)
def test_what_a_wrong_scene_is_told(sections: dict[str, Any], message: str) -> None:
    complaint = _complaint(**sections)
    assert complaint.startswith(message)
    assert complaint.count("\n") == 0, "one mistake, one line"


def test_stored_scenes_have_the_keys_of_their_version() -> None:
    """Values that older versions store by themselves, and forms that are shorter now."""
    patch = {"name": "a", "centre_m": [0.1, 0, 0], "facing": "-x", "temperature_K": 300}
    patch["radius_m"] = 0.01
    new = {
        "spray": {"model": "lagrangian"},
        "patches": [patch],
        "transport": {"phase": 0.8},
    }
    old = {
        "spray": {"model": "lagrangian", "rate": {"ramp_s": 5e-5, "table": None}},
        "patches": [{**patch, "shape": "disc"}],
        "transport": {"phase": {"henyey_greenstein": 0.8}},
        "camera": {"exposure_times": 3, "lens": None},
        "rig": {"background_start_K": 295.0},
    }
    assert _scene(**old) == _scene(**new)


def test_every_mistake_is_told_at_once() -> None:
    lines = _complaint(camera={"pixels": 0}, walls={"temperature": 3}, rig={"seed": -1})
    assert [line.split(":")[0] for line in lines.splitlines()] == [
        "camera.pixels",
        "walls.temperature",
        "rig.seed",
    ]


def test_name_and_spray_are_needed() -> None:
    with pytest.raises(SceneError, match=r"name: is missing\nspray: is missing"):
        parse_scene({})


def test_unknown_scene_names_what_there_is() -> None:
    assert load_scene("gdi-flow") == load_scene("gdi")  # its former name
    with pytest.raises(SceneError, match=r"gdi-colt: no such scene; did you mean gdi-cold\?"):
        load_scene("gdi-colt")
    with pytest.raises(SceneError, match=r"no such scene.*allowed: droplets-only, empty, gdi"):
        load_scene("qqqqqq")


def test_scene_files(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\nspray: {model: grid, file: data/a.npz}\n", encoding="utf-8")
    spray = load_scene(path).spray
    assert getattr(spray, "file") == tmp_path / "data" / "a.npz"  # noqa: B009
    for text, message in (
        ("- 1\n", "contains list"),
        ("a: [", "is not valid YAML"),
        ("", "NoneType"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(SceneError, match=message):
            load_scene(path)
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(tmp_path / "none.yaml")


@pytest.mark.parametrize("phase", ["isotropic", "mie", -0.3, {"henyey_greenstein": -0.3}])
def test_phase_functions_there_and_back(phase: Any) -> None:
    scene = _scene(transport={"phase": phase, "method": "path"})
    assert parse_scene(yaml.safe_load(dump_scene(scene))) == scene


@pytest.mark.parametrize(
    ("phase", "said"),
    [
        ("rayleigh", "allowed: isotropic, mie, or the g of Henyey"),
        (1, "1 is outside -0.999..0.999"),
        ({"henyey_greenstein": 1.0}, "1 is outside -0.999..0.999"),
        ({"g": 0.5}, "allowed: isotropic, mie, or the g of Henyey"),
    ],
)
def test_wrong_phase_functions_are_refused(phase: Any, said: str) -> None:
    assert said in _complaint(transport={"phase": phase})


@pytest.mark.parametrize("text", ["1e6", "1.0e6", "2.e6", "1e+6"])
def test_an_exponent_needs_neither_point_nor_sign(text: str, tmp_path: Path) -> None:
    scene = f"name: 1e5x\nspray: {{model: cone, ambient: {{pressure_Pa: {text}}}}}\n"
    (tmp_path / "a.yaml").write_text(scene, encoding="utf-8")
    found = load_scene(tmp_path / "a.yaml")
    assert found.spray.ambient.pressure_Pa == float(text)  # type: ignore[union-attr]
    named = found.with_(name="1e5")
    assert parse_scene(parse_yaml(dump_scene(named), source="x")) == named


HEAD = "name: a\nspray: {model: cone}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: 0x" + "f" * 10_000 + "\n", "name: a number of more than 4300 digits is not text"),
        ("base: " + "a" * 5_000 + "\n", "aaa...: no such scene"),
        (
            HEAD + f"windows: [{{reflection: [[3, 0.1], [4, {10**400}]]}}]\n",
            "expected pairs of",
        ),
        (
            HEAD + "optics: {filter_um: [[3.3, true], [3.5, 1]]}\n",
            "curve: expected pairs",
        ),
        (HEAD + "".join(f"k{i}: 1\n" for i in range(3_000)), "and 2950 errors more"),
        (HEAD + "? " + "k" * 1_000_000 + "\n: 1\n", "kkk...: unknown key"),
    ],
)
def test_a_scene_is_refused_briefly(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text, encoding="utf-8")
    start_s = time.process_time()
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 20_000
    assert time.process_time() - start_s < 10.0  # 3,000 keys took 14 s


def test_curves_take_numbers_from_iterators() -> None:
    assert check_curve(zip((3.3, 3.5), (0.5, 1.0), strict=True), source="x")[0] == (3.3, 0.5)


@pytest.mark.parametrize("time", ["2026-01-01T10:00:00", "9999-01-01T10:00:00+00:00"])
def test_times_of_a_journal_have_a_zone_and_a_century(time: str) -> None:
    line = f'{{"seq": 0, "event": "stopped", "time": "{time}"}}\n'.encode()
    assert "without a zone or of another century" in parse_entry(line, 0)[0]


_COARSE_GAS = {"spray.box.spacing_m": 3e-3, "spray.droplets_per_parcel": 3e4}
_COARSE_CONE = {"spray.spacing_m": 2e-3, "spray.size_classes": 2}


@pytest.mark.parametrize(
    ("name", "coarse"),
    [
        pytest.param("gdi", _COARSE_GAS, marks=pytest.mark.slow),
        pytest.param("methane-jet", _COARSE_GAS, marks=pytest.mark.slow),
        ("gdi-cone", _COARSE_CONE),
        ("gdi-cold", _COARSE_CONE),
        ("droplets-only", _COARSE_CONE),
    ],
)
def test_the_spray_fills_the_frame(
    name: str, coarse: dict[str, float], device: Device, tables: Path
) -> None:
    """By absorption and scattering on coarse cells, without light that is scattered.

    gdi-extinction has the camera of gdi, with which it is compared; its droplets fill less.
    """
    scene = chosen_scene(name, pixels=64).with_(**{"optics.wavelengths": 1, **coarse})
    emissivity = previewed(prepare(scene, device, Stages(None), tables))[1]
    visible = emissivity > VISIBLE_EMISSIVITY
    assert np.mean(visible) >= 0.3
    assert not visible[[0, -1]].any() and not visible[:, [0, -1]].any()


@pytest.mark.parametrize("name", ["gdi", "methane-jet"])
def test_traced_and_recorded_images_show_the_same_part(name: str) -> None:
    """Pixels are square, and the sensor covers the field."""
    camera = load_scene(name).camera
    for columns, rows in (camera.pixels, camera.sensor.pixels):
        sizes = (camera.field_m[0] / columns, camera.field_m[1] / rows)
        assert sizes[0] == pytest.approx(sizes[1], rel=1e-6)
