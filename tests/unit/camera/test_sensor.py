"""The sensor: photon budget by hand, noise against its own calibration, saturation, bad pixels."""

import numpy as np
import pytest
from scipy import stats

from cldit.camera.calibration import Calibration
from cldit.camera.sensor import SensorModel
from cldit.camera.view import SensorView
from cldit.errors import EvaluationError, SceneError, TransportError
from cldit.optics.planck import band_radiance
from cldit.scene.camera import Camera, Sensor
from cldit.scene.schema import Scene
from cldit.scene.spray import EmptySpray


def _model(**sensor: object) -> SensorModel:
    values = {"pixels": (200, 150), "bad_pixels": 0, **sensor}
    camera = Camera(sensor=Sensor.model_validate(values))
    return SensorModel.from_scene(Scene(name="t", spray=EmptySpray(), camera=camera))


def test_photon_budget_by_hand() -> None:
    """15 um pitch, F/2.5, QE 0.8, 25 us before a black body at 560 K through 3.3 to 3.5 um.

    B_q(3.4 um) = 2 c / lambda^4 / (e^7.5566 - 1) = 2.345e27, times 0.2 um = 4.69e20;
    times 2.25e-10 m2 * pi / 26 * 0.8 * 25 us = 5.44e-16: 2.55e5 electrons.
    """
    model = _model()
    radiance = band_radiance(560.0, filter_um=(3.3, 3.5))
    # one wavelength for the whole filter is 0.5 % off
    assert model.mean_electrons(radiance) == pytest.approx(2.55e5, rel=0.01)


@pytest.mark.parametrize(
    ("electrons", "per_count", "read"),
    [
        *((electrons, 3.0, 20.0) for electrons in (0.0, 3.0, 5e3, 9.9e3, 1.1e4)),
        (2.5e5, 40.0, 200.0),
        (10_050.0, 200.0, 0.0),  # noise of half a count: a quarter of the variance is rounding
    ],
)
def test_mean_and_variance_are_the_calibrations(
    electrons: float, per_count: float, read: float
) -> None:
    model = _model(
        electrons_per_count=per_count, bits=16, read_noise_electrons=read, well_electrons=1e9
    )
    radiance = np.full((150, 200), electrons / model.electrons_per_radiance)
    image = model.expose(radiance, np.random.default_rng(5)).astype(float)
    calibration = model.calibration()
    mean = model.offset_counts + electrons / model.electrons_per_count
    variance = calibration.variance_counts2(mean)
    count = image.size
    # 4.5 sigma: one false alarm in 150000
    assert abs(image.mean() - mean) < 4.5 * np.sqrt(variance / count)
    assert abs(image.var() / variance - 1) < 4.5 * np.sqrt(2 / count)
    # The mean also inverts: radiance -> counts -> radiance
    np.testing.assert_allclose(calibration.radiance(calibration.counts(radiance)), radiance)
    np.testing.assert_allclose(calibration.counts(radiance), mean)


def test_few_photons_are_poisson() -> None:
    """At 3 electrons, a count an electron and no read noise, the histogram is Poisson's."""
    model = _model(electrons_per_count=1.0, read_noise_electrons=0.0, offset_counts=0.0, bits=16)
    radiance = np.full((150, 200), 3.0 / model.electrons_per_radiance)
    image = model.expose(radiance, np.random.default_rng(2))
    seen = np.bincount(np.minimum(image.ravel(), 9), minlength=10)
    share = np.append(stats.poisson.pmf(np.arange(9), 3.0), stats.poisson.sf(8, 3.0))
    assert stats.chisquare(seen, share * image.size).pvalue > 1e-4


def test_saturation_of_converter_and_well() -> None:
    bright = np.full((150, 200), 1e30)
    rng = np.random.default_rng(1)
    assert np.all(_model().expose(bright, rng) == 2**14 - 1)
    shallow = _model(well_electrons=1e5)
    assert np.all(shallow.expose(bright, rng) == 200 + 1e5 / 40)
    assert shallow.calibration().saturation_counts == 2700
    assert np.all(_model(offset_counts=0.0).expose(-bright, rng) < 40)  # read noise only


def test_bad_pixels_are_fixed_and_stuck() -> None:
    model = _model(bad_pixels=300)
    mask = model.bad_pixels()
    assert mask.shape == (150, 200) and mask.sum() == 300
    radiance = np.full((150, 200), 1e20)
    first = model.expose(radiance, np.random.default_rng(1))
    second = model.expose(radiance, np.random.default_rng(2))
    np.testing.assert_array_equal(first[mask], second[mask])
    assert set(np.unique(first[mask])) == {0, 2**14 - 1}
    assert first[~mask].min() > 0 and first[~mask].max() < 2**14 - 1
    assert _model(bad_pixels=0).bad_pixels().sum() == 0
    assert np.array_equal(model.bad_pixels(), mask)


def test_refuses() -> None:
    with pytest.raises(SceneError, match=r"bad_pixels: 5 is outside 0..4"):
        _model(pixels=(2, 2), bad_pixels=5)
    with pytest.raises(SceneError, match="offset_counts: 300"):
        _model(bits=8, offset_counts=300.0)
    model = _model()
    with pytest.raises(TransportError, match="shape"):
        model.expose(np.zeros((200, 150)), np.random.default_rng(1))
    broken = np.zeros((150, 200))
    broken[3, 4] = np.nan
    with pytest.raises(TransportError, match="not finite in 1 "):
        model.expose(broken, np.random.default_rng(1))


def test_calibration_as_plain_data() -> None:
    calibration = _model().calibration()
    data = calibration.to_dict()
    assert Calibration.from_dict(data) == calibration
    assert Calibration.from_dict({**data, "camera": "more"}) == calibration
    data.pop("offset_counts")
    with pytest.raises(EvaluationError, match="offset_counts missing"):
        Calibration.from_dict(data)
    for name, value in (
        ("offset_counts", "dark"),
        ("filter_um", [3.3]),
        ("counts_per_radiance", 0.0),
        ("read_noise_electrons", float("nan")),
        ("filter_um", [3.5, 3.3]),
        ("offset_counts", float("inf")),
    ):
        with pytest.raises(EvaluationError, match="calibration"):
            Calibration.from_dict({**calibration.to_dict(), name: value})


def _view(
    pixels: tuple[int, int] = (640, 512), field_m: tuple[float, float] = (0.16, 0.16)
) -> SensorView:
    return SensorView(field_m=field_m, centre_m=(0.0, 0.0), pixels=pixels)


def test_footprint_is_the_largest_rectangle() -> None:
    assert _view().pixel_m == (0.16 / 640, 0.16 / 640)  # the width limits
    assert _view(field_m=(0.16, 0.064)).pixel_m == (0.064 / 512, 0.064 / 512)
    assert _view(pixels=(10, 40)).pixel_m == (0.16 / 40, 0.16 / 40)


@pytest.mark.parametrize("traced", [(1000, 1000), (333, 77), (1, 1), (512, 640), (40, 3000)])
def test_constant_and_ramp_are_exact(traced: tuple[int, int]) -> None:
    """A sampled ramp is a staircase; its area means are differences of its integral."""
    view = _view(pixels=(64, 48))
    columns = traced[1]
    flat = view.image(np.full(traced, 7.25))
    np.testing.assert_allclose(flat, 7.25, rtol=1e-14)
    steps = np.arange(columns) + 0.5
    ramp = np.broadcast_to(steps, traced)
    edges = columns * np.arange(65) / 64  # the width is used whole
    staircase = np.concatenate([[0.0], np.cumsum(steps)])  # its integral, linear in between
    integral = np.interp(edges, np.arange(columns + 1), staircase)
    expected = np.diff(integral) / np.diff(edges)
    np.testing.assert_allclose(view.image(ramp), np.broadcast_to(expected, (48, 64)), rtol=1e-12)


def test_centred() -> None:
    """A picture that is even about its middle has an even image; one point stays in its place."""
    traced = np.zeros((101, 101))
    traced[50, 50] = 1.0
    got = _view(pixels=(25, 21)).image(traced)
    np.testing.assert_allclose(got, got[::-1, ::-1], atol=1e-15)
    assert np.argmax(got) == 10 * 25 + 12
    traced = np.zeros((100, 100))
    traced[12, 90] = 1.0  # up and to the right
    assert np.argmax(_view(pixels=(10, 8)).image(traced)) == 9  # row 0, last column


def test_nan_spreads_only_where_it_lies() -> None:
    traced = np.ones((80, 80))
    traced[0, 0] = np.nan
    got = _view(pixels=(20, 20)).image(traced)
    assert np.isnan(got).sum() == 1 and np.isnan(got[0, 0])


def test_from_scene_and_refusals() -> None:
    camera = Camera(sensor=Sensor(pixels=(32, 16)), target_m=(0.01, 0.0, -0.03))
    view = SensorView.from_scene(Scene(name="t", spray=EmptySpray(), camera=camera))
    assert view.centre_m == (0.01, -0.03) and view.pixel_m == (0.005, 0.005)
    for shape in ((0, 3), (3,), (2, 2, 2)):
        with pytest.raises(TransportError, match="traced image"):
            view.image(np.zeros(shape))
