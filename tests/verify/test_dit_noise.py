"""Standard errors of DIT are right: chi-square of many equal pixels, recorded by the sensor model.

Set-up: 64 x 64 pixels see the same spray before five backgrounds, some shots each, through the
simulated sensor (shot noise, read noise, rounding). Expected: the spread of the 4096 results is
what each of them states. With camera noise alone, and with shots that differ in optical depth or
temperature beyond it.
"""

from __future__ import annotations

import numpy as np
import pytest

from cldit.camera.sensor import SensorModel
from cldit.dit.maps import Maps
from cldit.dit.recorded import evaluate_shots
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from cldit.scene.camera import Camera, Sensor
from cldit.scene.schema import Scene
from cldit.scene.spray import EmptySpray
from tests.verify.evaluation_bias import BACKGROUNDS_K, BARE, CAMERA, Recorded, Shot

AROUND = Surroundings(wall_temperature_K=300.0)
FILTER = (3.3, 3.5)
SIDE = 64
SPRAY_K = 430.0


def _evaluated(
    *, shots: int, depth: float, depth_scatter: float = 0.0, temperature_scatter_K: float = 0.0
) -> Maps:
    camera = Camera(sensor=Sensor(pixels=(SIDE, SIDE), bad_pixels=0))
    model = SensorModel.from_scene(Scene(name="t", spray=EmptySpray(), camera=camera))
    rng = np.random.default_rng(21)
    recorded = Recorded([], AROUND, model.calibration().to_dict())
    for kelvin in (400.0, 440.0, 480.0, 520.0, 560.0):
        for kind in ("reference", "injection"):
            for number in range(shots):
                radiance = np.full((SIDE, SIDE), band_radiance(kelvin, filter_um=FILTER))
                if kind == "injection":
                    there = depth * (1 + depth_scatter * rng.standard_normal((SIDE, SIDE)))
                    warm = SPRAY_K + temperature_scatter_K * rng.standard_normal((SIDE, SIDE))
                    own = band_radiance(warm, filter_um=FILTER)
                    radiance = own + (radiance - own) * np.exp(-there)
                name = f"{kind}-{kelvin:g}-{number}"
                image = model.expose(radiance, rng)
                recorded.shots.append(Shot(name, kind, kelvin, kelvin, image))
    return evaluate_shots(recorded).maps


def _ratios(maps: Maps) -> tuple[float, float]:
    """Observed over stated variance of emissivity and apparent temperature, about the truth.

    Where shots scatter, the mean of exp(-depth) is not exp(-mean depth): there the spread is taken
    about the pixels' mean, which 4096 pixels know to 1.6 % of a standard error.
    """
    found = []
    for value, error in (
        (maps.emissivity, maps.emissivity_standard_error),
        (maps.apparent_temperature_K, maps.apparent_temperature_standard_error_K),
    ):
        assert np.isfinite(value).all()
        found.append(float(np.var(value, dtype=float) / np.mean(error.astype(float) ** 2)))
    return found[0], found[1]


@pytest.mark.parametrize("depth", [0.1, 1.0, 4.0])
def test_one_shot_camera_noise(depth: float) -> None:
    """One shot a background: no scatter to see, the errors are the calibration's alone.

    chi2 / N of 4096 pixels has a standard deviation of sqrt(2 / 4096) = 2.2 %; 4 of them, plus 2 %
    for weights that come from noisy counts.
    """
    maps = _evaluated(shots=1, depth=depth)
    emissivity, temperature = _ratios(maps)
    assert emissivity == pytest.approx(1.0, abs=0.11)
    assert temperature == pytest.approx(1.0, abs=0.11 if depth > 0.5 else 0.2)  # 2nd order: 8 K
    error = maps.emissivity_standard_error
    # No bias: the mean of 4096 is good to 1.6 % of a standard error; 5 of these, and the weights'.
    truth = -np.expm1(-depth)
    assert abs(np.mean((maps.emissivity - truth) / error)) < 0.1
    # Residuals of the fit: mean of 4096 reduced chi2 with 3 degrees: sqrt(2 / 3 / 4096) = 1.3 %.
    assert np.mean(maps.reduced_chi2) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize(
    ("shots", "tolerance"),
    # An estimated scatter is never negative, so without any the errors come out too large: by the
    # positive half of sqrt(2 / 20), 13 % of the injections' variance, with 5 shots; 7 % with 19.
    [(5, 0.25), (19, 0.15)],
)
@pytest.mark.parametrize(
    ("depth", "depth_scatter", "temperature_scatter_K"),
    [(1.0, 0.0, 0.0), (1.0, 0.03, 0.0), (0.1, 0.1, 0.0), (4.0, 0.0, 2.0), (1.0, 0.03, 1.0)],
)
def test_scatter_between_shots(
    shots: int,
    tolerance: float,
    depth: float,
    depth_scatter: float,
    temperature_scatter_K: float,
) -> None:
    maps = _evaluated(
        shots=shots,
        depth=depth,
        depth_scatter=depth_scatter,
        temperature_scatter_K=temperature_scatter_K,
    )
    for ratio in _ratios(maps):
        assert ratio == pytest.approx(1.0, abs=tolerance)


def test_scatter_of_dense_spray_beside_thin() -> None:
    """Columns of emissivity 0.3, 0.7 and 0.999 in turns; patches of 6 x 6 pixels scatter by 5 %.

    The amount of spray changes the opaque columns least, though their Delta I is largest: with
    scatter in proportion to Delta I reduced chi-square is 1.4 in the second and 0.65 in the last.
    """
    rng = np.random.default_rng(1)
    emissivity = np.tile([0.3, 0.3, 0.7, 0.7, 0.999, 0.999], (48, 10))
    own = float(band_radiance(SPRAY_K, filter_um=FILTER))
    recorded = Recorded([], BARE)
    for kelvin in BACKGROUNDS_K:
        for kind in ("reference", "injection") * 5:
            light = np.full(emissivity.shape, float(band_radiance(kelvin, filter_um=FILTER)))
            if kind == "injection":
                amount = np.exp(0.05 * np.kron(rng.standard_normal((8, 10)), np.ones((6, 6))))
                through = (1.0 - emissivity) ** amount
                light = through * light + (1.0 - through) * own
            counts = CAMERA.counts(light)
            counts = rng.normal(counts, np.sqrt(CAMERA.variance_counts2(counts)))
            name = str(len(recorded.shots))
            image = np.rint(counts).astype(np.uint16)
            recorded.shots.append(Shot(name, kind, kelvin, kelvin, image))
    found = evaluate_shots(recorded).maps.reduced_chi2
    for one in (0.3, 0.7, 0.999):
        # Six degrees of freedom in 960 pixels, in some 30 patches: 0.1.
        assert np.mean(found[emissivity == one]) == pytest.approx(1.0, abs=0.2), one
