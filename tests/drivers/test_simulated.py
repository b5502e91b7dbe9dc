"""The simulated instruments show the physics that they stand for."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cldit.errors import RunFolderError
from cldit.optics.planck import band_radiance
from cldit.optics.response import scene_filter
from cldit.radiance.weights import Weights
from cldit.rig.clock import SimulatedClock
from cldit.rig.drivers import RigContext
from cldit.rig.load import Rig, open_rig
from cldit.rig.protocols import (
    Background,
    Burst,
    Camera,
    Roi,
    TriggerGenerator,
    TriggerInfo,
    TriggerMode,
)
from cldit.rig.simulated import simulated_rig_data
from cldit.run.ensemble import member_folder
from cldit.scene import Scene, dump_scene
from cldit.scene.scatter import member
from tests.conftest import tiny_weights

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.simulated_blackbody import open_blackbody
    from drivers.simulated_camera import open_camera
    from drivers.simulated_injector import open_injector
    from drivers.simulated_scene import Pulse, SimulatedScene, open_bench
else:
    from cldit.drivers.simulated_blackbody import open_blackbody
    from cldit.drivers.simulated_camera import open_camera
    from cldit.drivers.simulated_injector import open_injector
    from cldit.drivers.simulated_scene import Pulse, open_bench

# mypy checks here that the drivers meet the Protocols.
CAMERA: Callable[[dict[str, Any], RigContext], Camera] = open_camera
BACKGROUND: Callable[[dict[str, Any], RigContext], Background] = open_blackbody
TRIGGER: Callable[[dict[str, Any], RigContext], TriggerGenerator] = open_injector


def bench_before(run: Path, *, seed: int = 1) -> SimulatedScene:
    context = RigContext(SimulatedClock(), None, Path(), seed)
    return open_bench({"run": str(run)}, context)


def varied(scene: Scene, folder: Path, run: Path, **scatter: float) -> Path:
    """The tiny run under a scene with other scatter between injections."""
    scene = scene.with_(**{f"spray.scatter.{key}": value for key, value in scatter.items()})
    folder.mkdir(exist_ok=True)
    for name in ("weights", "weights_reference"):
        Weights.load(run / name).save(folder / name, pixel_m=(5e-3, 5e-3))
    (folder / "scene.yaml").write_text(dump_scene(scene))
    return folder


def spray(number: int) -> Pulse:
    return Pulse(float(number), True, number)


def test_without_injection_it_is_the_empty_scene(tiny_run: Path, tiny_scene: Scene) -> None:
    """Disc pixels show the black body's Planck radiance, the others the wall's: float32."""
    bench = bench_before(tiny_run)
    bench.attach_blackbody(lambda time_s: 480.0)
    image = bench.radiance(Pulse(0.0, False, 1))
    disc, wall = (
        float(band_radiance(kelvin, filter_um=scene_filter(tiny_scene)))
        for kelvin in (480.0, tiny_scene.walls.temperature_K)
    )
    assert image[6, 8] == pytest.approx(disc, rel=1e-6)
    assert image[0, 0] == pytest.approx(wall, rel=1e-6)


def test_no_scatter_is_the_trace(tiny_scene: Scene, tiny_run: Path, tmp_path: Path) -> None:
    bench = bench_before(varied(tiny_scene, tmp_path, tiny_run, optical_depth=0.0))
    bench.attach_blackbody(lambda time_s: 480.0)
    first, second = (bench.radiance(spray(number)) for number in (1, 2))
    assert np.array_equal(first, second)
    assert first[6, 8] < 0.8 * bench.radiance(Pulse(0.0, False, 1))[6, 8]


@pytest.mark.parametrize("length_m", [1e-4, 0.02, 1.0])
def test_scatter_of_the_optical_depth(
    length_m: float, tiny_scene: Scene, tiny_run: Path, tmp_path: Path
) -> None:
    """ln tau scatters with sigma from the smooth field and sigma from the global factor.

    The black body is so hot that w_bg alone is seen; 400 shots give the standard deviation of
    ln tau, sqrt(2) sigma, to 1/sqrt(2 N) = 3.5 %; allowed are 4 of these. Neighbours agree (the
    length is long) or only through the global factor (it is short): correlation 1 or 1/2, to
    4 (1 - rho^2) / sqrt(N).
    """
    sigma, shots = 0.05, 400
    folder = varied(tiny_scene, tmp_path, tiny_run, optical_depth=sigma, length_m=length_m)
    bench = bench_before(folder)
    bench.attach_blackbody(lambda time_s: 5000.0)
    bare = bench.radiance(Pulse(0.0, False, 1))
    depth = np.log([-np.log(bench.radiance(spray(n))[6, 7:9] / bare[6, 7:9]) for n in range(shots)])
    assert np.std(depth[:, 0]) == pytest.approx(math.sqrt(2.0) * sigma, rel=4 * 0.035)
    # Pixels are 10 mm apart: the field's correlation is exp(-(r / L)^2).
    expected = (1.0 + math.exp(-((0.01 / length_m) ** 2))) / 2.0
    found = np.corrcoef(depth.T)[0, 1]
    assert abs(found - expected) <= 4.0 * (1.0 - expected**2) / math.sqrt(shots) + 1e-3


def test_scatter_keeps_the_mean_optical_depth(
    tiny_scene: Scene, tiny_run: Path, tmp_path: Path
) -> None:
    """The factor on tau is lognormal, mean 1, variance exp(2 sigma^2) - 1: 4 sigma of 400 shots."""
    sigma, shots = 0.5, 400
    bench = bench_before(varied(tiny_scene, tmp_path, tiny_run, optical_depth=sigma))
    exact = bench_before(varied(tiny_scene, tmp_path / "exact", tiny_run, optical_depth=0.0))
    for each in (bench, exact):
        each.attach_blackbody(lambda time_s: 5000.0)
    bare = bench.radiance(Pulse(0.0, False, 1))[6, 8]
    depths = [-math.log(bench.radiance(spray(n))[6, 8] / bare) for n in range(shots)]
    depth = -math.log(exact.radiance(spray(1))[6, 8] / bare)
    allowed = 4.0 * math.sqrt(math.expm1(2.0 * sigma**2) / shots)
    assert np.mean(depths) / depth == pytest.approx(1.0, abs=allowed)


def test_scatter_keeps_a_cavity_flat(tiny_scene: Scene, tiny_run: Path, tmp_path: Path) -> None:
    """Background, walls and spray at 370 K: every shot is flat to float32, however it scatters."""
    scene = tiny_scene.model_copy(
        update={"walls": tiny_scene.walls.model_copy(update={"temperature_K": 370.0})}
    )
    bench = bench_before(varied(scene, tmp_path, tiny_run, optical_depth=0.5))
    bench.attach_blackbody(lambda time_s: 370.0)
    flat = float(band_radiance(370.0, filter_um=scene_filter(scene)))
    for number in range(5):
        assert bench.radiance(spray(number)) == pytest.approx(flat, rel=1e-5)


def test_opaque_and_empty_pixels(tiny_scene: Scene, tiny_run: Path, tmp_path: Path) -> None:
    """0/0: where nothing is, nothing changes; where nothing comes through, nothing changes."""
    folder = varied(tiny_scene, tmp_path, tiny_run, optical_depth=0.3)
    reference = Weights.load(folder / "weights_reference")
    zero = np.zeros_like(reference.wall)
    left = np.arange(zero.shape[1]) < zero.shape[1] // 2
    glow = np.where(left, np.float32(1e20), zero)
    Weights(
        np.where(left, zero, reference.background), np.where(left, zero, reference.wall), glow, zero
    ).save(folder / "weights", pixel_m=(5e-3, 5e-3))
    bench = bench_before(folder)
    image, bare = bench.radiance(spray(1)), bench.radiance(Pulse(1.0, False, 1))
    assert np.array_equal(image[:, 8:], bare[:, 8:])
    assert image[:, :8] == pytest.approx(1e20, rel=1e-6)


def test_every_injection_is_another_member(tiny_scene: Scene, tmp_path: Path) -> None:
    """Four members of different depth: any four injections in a row show each of them once, and
    references in between count for nothing."""
    depths = (0.5, 1.0, 2.0, 3.0)
    keys = {"members": 4, "mass": 0.1, "optical_depth": 0.0}
    scene = tiny_scene.with_(spray={"model": "cone", "scatter": keys})
    folders: dict[Path, float] = {tmp_path: 1.5}
    folders |= {member_folder(tmp_path, n): d for n, d in enumerate(depths, 1)}
    for number, (folder, depth) in enumerate(folders.items()):
        folder.mkdir(parents=True, exist_ok=True)
        one = member(scene, number) if number else scene
        (folder / "scene.yaml").write_text(dump_scene(one))
        for name, part in (("weights", depth), ("weights_reference", 0.0)):
            tiny_weights(scene, depth=part).save(folder / name, pixel_m=(5e-3, 5e-3))
    data = simulated_rig_data(scene, tmp_path)
    data["background"]["settings"]["time_constant_s"] = 0.0
    with open_rig(data) as rig:
        rig.connect()
        rig.background.set_setpoint(480.0)
        seen = []
        for inject in (True, True, False, True, False, True, True, True):
            image = shoot(rig, Burst(camera_delay_s=1e-3, inject=inject))
            seen += [float(image[5:7, 7:9].mean())] if inject else []
    order = [int(np.argmin(np.abs(np.array(seen[:4]) - one))) for one in seen]
    assert order[:4] == [0, 1, 2, 3] and order[4:] == [0, 1]
    assert np.ptp(seen[:4]) > 100


def test_same_seed_same_shots(tiny_run: Path) -> None:
    one, two, other = bench_before(tiny_run), bench_before(tiny_run), bench_before(tiny_run, seed=2)
    assert np.array_equal(one.radiance(spray(3)), two.radiance(spray(3)))
    assert not np.array_equal(one.radiance(spray(3)), other.radiance(spray(3)))
    assert not np.array_equal(one.radiance(spray(3)), one.radiance(spray(4)))


@pytest.mark.parametrize("fault", ["missing", "shape", "nan"])
def test_damaged_run(fault: str, tiny_scene: Scene, tiny_run: Path, tmp_path: Path) -> None:
    folder = varied(tiny_scene, tmp_path, tiny_run)
    weights = Weights.load(folder / "weights")
    if fault == "missing":
        (folder / "weights_reference" / "wall.tif").unlink()
        message = r"weights_reference.wall\.tif"
    else:
        image = weights.wall[1:] if fault == "shape" else weights.wall * np.float32(np.nan)
        changed = Weights(weights.background, image, weights.vapour, weights.liquid)
        changed.save(folder / "weights", pixel_m=(5e-3, 5e-3))
        message = r"wall\.tif: (shape|contains values that are not finite)"
    with pytest.raises(RunFolderError, match=message):
        bench_before(folder).open()


def test_blackbody_is_first_order(tiny_rig: dict[str, Any]) -> None:
    """T = T1 + (T0 - T1) exp(-t / tau), also from a set point that is changed on the way."""
    tiny_rig["background"]["settings"].update(noise_K=0.0, time_constant_s=100.0, start_K=300.0)
    rig = open_rig(tiny_rig)
    rig.connect()
    rig.background.set_setpoint(400.0)
    rig.clock.sleep(100.0)
    half = 400.0 - 100.0 * math.exp(-1.0)
    assert rig.background.read_temperature() == pytest.approx(half, abs=1e-9)
    rig.background.set_setpoint(350.0)
    rig.clock.sleep(50.0)
    expected = 350.0 + (half - 350.0) * math.exp(-0.5)
    assert rig.background.read_temperature() == pytest.approx(expected, abs=1e-9)


def test_blackbody_reading_noise(tiny_rig: dict[str, Any]) -> None:
    """2000 readings: the mean to 4 sigma / sqrt(N), the deviation to 4 / sqrt(2 N) of itself."""
    tiny_rig["background"]["settings"].update(noise_K=0.1, time_constant_s=0.0)
    rig = open_rig(tiny_rig)
    rig.connect()
    rig.background.set_setpoint(500.0)
    readings = np.array([rig.background.read_temperature() for _ in range(2000)])
    assert abs(readings.mean() - 500.0) < 4 * 0.1 / math.sqrt(2000)
    assert readings.std() == pytest.approx(0.1, rel=4 / math.sqrt(4000))


def shoot(rig: Rig, burst: Burst) -> Any:
    rig.trigger.configure(burst)
    rig.camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))
    rig.camera.arm()
    rig.trigger.fire()
    (frame,) = rig.camera.read_frames(1, 1.0)
    rig.camera.disarm()
    rig.trigger.wait_done(1.0)
    rig.clock.sleep(0.1)  # a full frame takes 7 ms
    return frame.data


def test_what_the_camera_sees(tiny_rig: dict[str, Any]) -> None:
    """Spray only after an injection, and only if the camera's edge does not come first."""
    tiny_rig["background"]["settings"]["time_constant_s"] = 0.0
    with open_rig(tiny_rig) as rig:
        rig.connect()
        rig.background.set_setpoint(480.0)
        late = Burst(camera_delay_s=1e-3, inject=True)
        early = Burst(camera_delay_s=0.0, injector_delay_s=1e-3, inject=True)
        with_spray, without, too_early = (
            float(shoot(rig, burst)[5:7, 7:9].mean()) for burst in (late, Burst(), early)
        )
        assert with_spray < 0.5 * without
        # Shot noise of about 2000 counts at 40 electrons a count, 4 pixels, 6 sigma: 30 counts.
        assert abs(without - too_early) < 30.0


def test_roi_is_that_part_of_the_sensor(tiny_rig: dict[str, Any]) -> None:
    with open_rig(tiny_rig) as rig:
        rig.connect()
        settings = rig.camera.configure(25e-6, Roi(4, 3, 8, 6))
        assert settings.roi == Roi(4, 3, 8, 6) and shoot(rig, Burst()).shape == (6, 8)


def test_bad_pixels_are_counted_from_the_region_of_interest(tiny_rig: dict[str, Any]) -> None:
    with open_rig(tiny_rig) as rig:
        rig.connect()
        rig.camera.configure(25e-6)
        bad = np.array(rig.camera.read_configuration()["bad_pixels"])
        row, column = bad.min(axis=0)
        assert row + column > 0
        rig.camera.configure(25e-6, Roi(int(column), int(row), int(16 - column), int(12 - row)))
        moved = rig.camera.read_configuration()["bad_pixels"]
        assert np.array_equal(moved, bad - [row, column])


def test_pulse_log_counts_what_left_the_device(tiny_rig: dict[str, Any]) -> None:
    log = Path(tiny_rig["trigger"]["settings"]["pulse_log"])
    for _ in range(2):  # a second rig on the same injector goes on counting
        with open_rig(tiny_rig) as rig:
            rig.connect()
            rig.trigger.configure(Burst(n=5, period_s=0.1, inject=True))
            rig.trigger.fire()
            rig.clock.sleep(0.15)
            rig.trigger.abort()
    entries = [json.loads(line) for line in log.read_text().splitlines()]
    assert [entry["pulses"] for entry in entries] == [5, -3, 5, -3]
