"""The image of an exposure: several times of the spray, or droplets smeared as they fly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.errors import SceneError
from cldit.gpu.device import Device
from cldit.medium.cloud import Kernel, smeared
from cldit.radiance.weights import mean
from cldit.run import Run
from cldit.spray.extent import Cloud
from cldit.spray.result import Parcels, Spray
from cldit.spray.spray_file import read_spray, write_spray

SPEED, EXPOSURE_S = 60.0, 100e-6


def flying(sigma_m: float, count: int = 4000) -> Parcels:
    """A round blob of droplets, all of which fly along x + z."""
    rng = np.random.default_rng(1)
    place = rng.normal(0.0, sigma_m, (count, 3))
    place -= place.mean(axis=0)
    one = np.ones(count)
    velocity = np.broadcast_to(SPEED * np.array([0.6, 0.0, 0.8]), place.shape).copy()
    droplets = 2e3 / count * one
    return Parcels(place, 1e-5 * one, droplets, 350.0 * one, 600.0 * one, velocity_m_s=velocity)


def run_of(parcels: Parcels, device: Device, tables: Path, tmp_path: Path, **camera: Any) -> Run:
    file = tmp_path / f"spray{sum(1 for _ in tmp_path.glob('*.npz'))}.npz"
    write_spray(file, Spray(parcels=parcels, fuel="n-heptane"))
    data = {
        "name": "flying",
        "domain": {"edge_m": 0.06, "leaf_edge_m": 0.0005},
        "spray": {"model": "cfd", "file": str(file), "deposit": "points"},
        "camera": {
            "model": "orthographic",
            "pixels": 64,  # one for each column of cells
            "field_m": [0.03, 0.03],
            "sensor": {"integration_time_s": EXPOSURE_S},
            **camera,
        },
        "background": {"shape": "enclosure", "temperatures_K": [400.0, 500.0]},
        "transport": {"audit": False, "order": 0, "accuracy_K": 5.0},
    }
    return cldit.simulate(cldit.Scene.from_dict(data), device=device, cache=tables)


def test_smear_is_the_mean_of_times(device: Device, tables: Path, tmp_path: Path) -> None:
    """Thin free flight: droplets smeared along their velocity, against the mean of 9 times.

    Both have the variance v^2 t^2 / 12; the cloud's triangle and the flight's box differ from the
    fourth moment on, which is a third of a fourth order beside the blob's own width.
    """
    parcels = flying(2e-3)
    smear = run_of(parcels, device, tables, tmp_path, exposure="smear")
    instant = run_of(parcels, device, tables, tmp_path)
    assert any("smeared along their velocity" in one for one in smear.info.remarks)
    assert any("droplets move by 6 mm" in one for one in instant.info.remarks)
    velocity = parcels.velocity_m_s
    assert velocity is not None
    times_s = ((np.arange(9) + 0.5) / 9 - 0.5) * EXPOSURE_S
    moved = [
        run_of(
            replace(parcels, position_m=parcels.position_m + velocity * time_s),
            device,
            tables,
            tmp_path,
        ).weights
        for time_s in times_s
    ]
    dark = {
        name: 1.0 - weights.background.astype(float)
        for name, weights in (
            ("smear", smear.weights),
            ("times", mean(moved)),
            ("instant", instant.weights),
        )
    }
    assert 0.005 < dark["instant"].max() < 0.1  # so that light is linear in the droplets
    place = (np.arange(64) + 0.5) * 0.03 / 64 - 0.015

    def variance(image: np.ndarray) -> float:
        x, z = np.meshgrid(place, -place)
        return float(np.sum(image * (0.6 * x + 0.8 * z) ** 2) / np.sum(image))

    grown = (SPEED * EXPOSURE_S) ** 2 / 12
    for name in ("smear", "times"):
        assert dark[name].sum() == pytest.approx(dark["instant"].sum(), rel=0.02)
        got = variance(dark[name]) - variance(dark["instant"])
        assert got == pytest.approx(grown, rel=0.06)

    def apart(one: str, other: str) -> float:
        return float(np.sqrt(np.mean((dark[one] - dark[other]) ** 2)))

    # 4,000 points in cells have noise, which either smear averages in its own way.
    assert apart("smear", "times") < 0.3 * apart("instant", "times")


def test_variance_of_a_smeared_parcel() -> None:
    """v v' t^2 / 12 beside what the parcel has; none without velocity or exposure."""
    parcels = flying(1e-3, 50)
    moved = smeared(parcels, EXPOSURE_S)
    assert isinstance(moved.extent, Cloud)
    along = SPEED * EXPOSURE_S * np.array([0.6, 0.0, 0.8])
    expected = np.outer(along, along) / 12
    np.testing.assert_allclose(moved.extent.covariance_m2, np.broadcast_to(expected, (50, 3, 3)))
    still, flown = (Kernel(exposure_s=one).spread(parcels).extent for one in (0.0, EXPOSURE_S))
    assert isinstance(still, Cloud) and isinstance(flown, Cloud)
    more = flown.covariance_m2 - still.covariance_m2
    np.testing.assert_allclose(more, np.broadcast_to(expected, (50, 3, 3)), atol=1e-18)
    assert smeared(parcels, 0.0) is parcels
    unknown = replace(parcels, velocity_m_s=None)
    assert smeared(unknown, EXPOSURE_S) is unknown


def test_velocities_are_kept_in_files(tmp_path: Path) -> None:
    parcels = flying(1e-3, 20)
    write_spray(tmp_path / "a.npz", Spray(parcels=parcels))
    write_spray(tmp_path / "b.npz", Spray(parcels=replace(parcels, velocity_m_s=None)))
    known, unknown = (read_spray(tmp_path / f"{name}.npz").parcels for name in "ab")
    assert known is not None and unknown is not None and unknown.velocity_m_s is None
    np.testing.assert_array_equal(known.velocity_m_s, parcels.velocity_m_s)
    half = known.take(np.arange(20) < 7)
    np.testing.assert_array_equal(half.velocity_m_s, parcels.velocity_m_s[:7])  # type: ignore[index]


@pytest.mark.slow
def test_cone_by_times(device: Device, tables: Path) -> None:
    """Three Gauss nodes, by runs of their own; the change grows with the square of the time."""

    def run(exposure: str, exposed_s: float, time_s: float = 0.5e-3) -> Run:
        scene = cldit.load_scene("gdi-cone").with_(
            **{
                "spray.time_s": time_s,
                "camera.pixels": [40, 40],
                "camera.exposure": exposure,
                "camera.sensor.integration_time_s": exposed_s,
                "transport.audit": False,
                "transport.accuracy_K": 10.0,
                "transport.order": 0,
                "domain.leaf_edge_m": 0.002,
            }
        )
        return cldit.simulate(scene, device=device, cache=tables)

    got = run("times", 40e-6)
    shift_s = 20e-6 * 0.6**0.5
    three = [run("instant", 40e-6, 0.5e-3 + way * shift_s).weights for way in (-1, 0, 1)]
    expected = mean(three, [5.0, 8.0, 5.0])
    for name, image in got.weights.images.items():
        scale = float(np.abs(image).max())
        np.testing.assert_allclose(image, expected.images[name], atol=1e-5 * scale)
    assert any("mean light of 3 times within 40 us" in one for one in got.info.remarks)
    assert np.abs(three[1].background - got.weights.background).max() > 1e-3


@pytest.mark.parametrize(
    ("spray", "exposure", "message"),
    [
        ({"model": "none"}, "times", r"neither times nor velocities; allowed: instant"),
        ({"model": "none"}, "smear", r"neither times nor velocities; allowed: instant"),
        ({"model": "cone"}, "smear", r"model cone, which has no velocities; allowed: times"),
        ({"model": "cfd", "file": "x"}, "times", r"no times between .* files; allowed: smear"),
    ],
)
def test_refused(spray: dict[str, Any], exposure: str, message: str) -> None:
    scene = cldit.Scene.from_dict({"name": "a", "spray": spray, "camera": {"exposure": exposure}})
    with pytest.raises(SceneError, match=message):
        cldit.simulate(scene)
