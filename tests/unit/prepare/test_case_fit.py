"""A scene that does not fit a CFD case is told so, and one that is written for it fits."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.to_spray import read_cfd
from cldit.prepare.case_fit import Fuel, misfits, seen_m
from cldit.prepare.fitted_scene import fitted_scene
from cldit.scene import Scene, load_scene
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Parcels, Spray
from tests.unit.cfd.seriescases import NOZZLE, write_times


def spray_of(
    low: float, high: float, *, width: float = 5e-3, y: float = 0.0, **notes: float
) -> Spray:
    """Droplets evenly from depth `low` to `high`."""
    z = -np.linspace(low, high, 1001)
    x = np.where(np.arange(1001) % 2, width, -width)
    ones = np.ones(1001)
    place = np.stack([x, y * ones, z], axis=1)
    parcels = Parcels(place, 1e-5 * ones, 1e3 * ones, 370.0 * ones, 600.0 * ones)
    return Spray(parcels=parcels, notes=notes)


def scene_of(**changes: object) -> Scene:
    """A picture of 100 mm x 80 mm about a depth of 40 mm, before walls of 600 K."""
    return load_scene("gdi-cone").with_(
        **{
            "camera.field_m": [0.1, 0.08],
            "camera.target_m": [0.0, 0.0, -0.04],
            "camera.model": "orthographic",
            "walls.temperature_K": 600.0,
            **changes,
        }
    )


def test_what_fits_is_not_spoken_of() -> None:
    assert misfits(scene_of(), spray_of(0.0, 0.075, ambient_temperature_K=603.0)) == ()
    assert misfits(scene_of(), Spray()) == ()
    walls = spray_of(0.0, 0.07, ambient_temperature_K=800.0, wall_temperature_K=602.0)
    assert misfits(scene_of(), walls) == ()


@pytest.mark.parametrize(
    ("long_m", "keys", "notes", "words"),
    [
        (0.1, {}, {}, "100 mm x 80 mm, excludes 20 % of the fuel"),
        (0.09, {"camera.field_m": [0.1, 0.1]}, {}, "100 mm x 80 mm"),  # of a sensor of 5 to 4
        (0.02, {}, {}, "the sensor's field is 100 mm x 80 mm, the spray 10 mm x 20 mm"),
        (0.07, {}, {"ambient_temperature_K": 800.0},
         "walls.temperature_K is 600 K, the case's gas outside the jet has 800 K"),
    ],
)  # fmt: skip
def test_a_scene_that_does_not_fit(
    long_m: float, keys: dict[str, object], notes: dict[str, float], words: str
) -> None:
    (line,) = misfits(scene_of(**keys), spray_of(0.0, long_m, **notes))
    assert words in line and "`cldit import CASE --fit`" in line


def test_a_pinhole_sees_near_things_larger() -> None:
    scene = scene_of(**{"camera.model": "pinhole", "camera.distance_m": 1.0})
    place = np.array([[0.01, -0.2, -0.04], [0.01, 0.25, -0.04]])
    np.testing.assert_allclose(seen_m(scene, place)[:, 0], [0.01 / 0.8, 0.01 / 1.25])
    np.testing.assert_allclose(seen_m(scene_of(), place)[:, 0], [0.01, 0.01])


@pytest.mark.parametrize("low_m", [0.0, 3e-3])
def test_a_fitted_scene_fits(tmp_path: Path, low_m: float) -> None:
    """It is read, shows the whole spray, and the cube holds all that the octree must."""
    case = write_times(tmp_path / "case", {"0.0001": 1e-4})
    spec = CfdSpray(file=case, axis="-y", nozzle_m=(0.0, NOZZLE[1] + low_m, 0.0))
    spray = read_cfd(spec)
    text = fitted_scene(spec, spray, name="fitted")
    (tmp_path / "fitted.yaml").write_text(text)
    scene = load_scene(tmp_path / "fitted.yaml")
    assert misfits(scene, spray) == ()
    assert isinstance(scene.spray, CfdSpray)
    assert scene.spray.file == case
    assert scene.spray.nozzle_m == pytest.approx(spec.nozzle_m)
    assert scene.spray.time_s == 1e-4
    assert scene.walls.temperature_K == pytest.approx(570.0)
    assert min(scene.background.temperatures_K) == 370.0
    assert max(scene.background.temperatures_K) == 570.0
    assert spray.vapour is not None
    half, middle = scene.domain.edge_m / 2, np.array(scene.domain.centre_m)
    assert np.all(spray.vapour.cells.lower_m >= middle - half)
    assert np.all(spray.vapour.cells.upper_m <= middle + half)
    width, height = scene.camera.field_m
    columns, rows = scene.camera.sensor.pixels
    assert width / height == pytest.approx(columns / rows, rel=1e-6)
    assert width / scene.camera.pixels[0] == pytest.approx(
        height / scene.camera.pixels[1], rel=2e-3
    )
    # Every ray of the pinhole ends on the background's disc.
    target, disc = np.array(scene.target_m), np.array(scene.background_centre_m)
    camera = target - np.array([0.0, scene.camera.distance_m, 0.0])
    for side_x, side_z in product((-0.5, 0.5), repeat=2):
        corner = target + np.array([side_x * width, 0.0, side_z * height])
        along = (disc[1] - camera[1]) / (corner[1] - camera[1])
        there = camera + along * (corner - camera)
        assert np.linalg.norm(there - disc) <= scene.background.radius_m
    for key in ("edge_m", "field_m", "target_m", "radius_m", "temperatures_K", "temperature_K"):
        assert any(f" {key}: " in line and "  # " in line for line in text.splitlines()), key


def test_extent_leaves_single_parcels_out() -> None:
    spray = spray_of(0.0, 0.05)
    assert spray.parcels is not None
    far = spray.parcels.position_m.copy()
    far[0] = (0.0, 0.0, -0.9)  # one of 1001
    parcels = replace(spray.parcels, position_m=far)
    low, high = Fuel.of(Spray(parcels=parcels)).extent_m(share=2e-3)
    assert low[2] == pytest.approx(-0.05, abs=2e-4)
    assert high[2] == pytest.approx(0.0, abs=2e-4)


def walls_of(tmp_path: Path, entry: str) -> float | None:
    case = write_times(tmp_path / "case", {"0.0001": 1e-4})
    field = case / "0.0001" / "T"
    text = field.read_text()
    assert "walls { type zeroGradient; }" in text
    field.write_text(text.replace("walls { type zeroGradient; }", entry))
    spray = read_cfd(CfdSpray(file=case, axis="-y", nozzle_m=NOZZLE))
    return spray.notes.get("wall_temperature_K")


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("walls { type fixedValue; value uniform 450; }", 450.0),
        ('".*" { type fixedValue; value uniform 450; }', 450.0),
        ("walls { type zeroGradient; }", None),
        ("walls { type fixedValue; value nonuniform List<scalar> 2(450 460); }", None),
        ("other { type fixedValue; value uniform 450; }", None),
        ("walls { type fixedValue; value uniform $hot; }", None),
        ("walls { type fixedValue; value uniform 450; ", None),
    ],
)
def test_walls_that_a_case_holds(tmp_path: Path, entry: str, expected: float | None) -> None:
    assert walls_of(tmp_path, entry) == expected
