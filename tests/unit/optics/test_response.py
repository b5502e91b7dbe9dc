"""Filters and quantum efficiencies as curves: what is refused, and radiance through them.

References: direct quadrature (scipy) of Planck's law times the straight lines between the points,
and the rectangular filter's own functions, which are verified against mpmath elsewhere.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.integrate import quad

from cldit.camera.sensor import SensorModel
from cldit.constants import LIGHT_SPEED_m_s, SECOND_RADIATION_CONSTANT_m_K
from cldit.errors import SceneError
from cldit.optics.planck import (
    band_radiance,
    band_radiance_slope,
    part_radiance,
    temperature_of_radiance,
    temperature_slope_of_radiance,
)
from cldit.optics.response import (
    Response,
    cut,
    edges_um,
    from_plain,
    product,
    scene_filter,
    to_plain,
)
from cldit.scene import dump_scene, load_scene, parse_scene

TRAPEZE = Response(((3.2, 0.0), (3.3, 0.9), (3.45, 0.85), (3.6, 0.1)))
WIDE = Response(((2.0, 0.2), (3.0, 0.9), (5.5, 0.6)))


def _reference(kelvin: float, response: Response, *, slope: bool = False) -> float:
    def integrand(um: float) -> float:
        x = SECOND_RADIATION_CONSTANT_m_K / (um * 1e-6 * kelvin)
        photons = 2.0 * LIGHT_SPEED_m_s / (um * 1e-6) ** 4 / np.expm1(x)
        rise = x / kelvin / -np.expm1(-x) if slope else 1.0
        return float(photons * rise * response.at(um) * 1e-6)

    points = [um for um, _ in response.pairs]
    parts = pairwise(points)
    return sum(quad(integrand, low, high, epsrel=1e-13)[0] for low, high in parts)


@pytest.mark.parametrize("response", [TRAPEZE, WIDE])
@pytest.mark.parametrize("kelvin", [30.0, 77.0, 300.0, 450.0, 1000.0, 5000.0])
def test_against_quadrature(response: Response, kelvin: float) -> None:
    """quad promises 1e-13; cancellation in its own sum leaves some 1e-12."""
    assert band_radiance(kelvin, filter_um=response) == pytest.approx(
        _reference(kelvin, response), rel=1e-11
    )
    assert band_radiance_slope(kelvin, filter_um=response) == pytest.approx(
        _reference(kelvin, response, slope=True), rel=1e-11
    )


@pytest.mark.parametrize("response", [TRAPEZE, WIDE])
def test_calibration_curve_and_back(response: Response) -> None:
    kelvin = np.geomspace(20.0, 5000.0, 4000)
    radiance = band_radiance(kelvin, filter_um=response)
    np.testing.assert_allclose(
        temperature_of_radiance(radiance, filter_um=response), kelvin, rtol=1e-11
    )
    product_of_slopes = temperature_slope_of_radiance(
        radiance, filter_um=response
    ) * band_radiance_slope(kelvin, filter_um=response)
    np.testing.assert_allclose(product_of_slopes, 1.0, rtol=1e-6)


def test_parts_add_up() -> None:
    kelvin = np.array([100.0, 450.0, 3000.0])
    edges = np.linspace(3.2, 3.6, 8)
    parts = sum(
        part_radiance(kelvin, filter_um=TRAPEZE, low_um=float(a), high_um=float(b))
        for a, b in pairwise(edges)
    )
    np.testing.assert_allclose(parts, band_radiance(kelvin, filter_um=TRAPEZE), rtol=1e-12)


def test_zeros_at_the_ends_are_not_part_of_the_filter() -> None:
    padded = Response(((1.0, 0.0), (3.2, 0.0), (3.3, 0.5), (3.4, 0.0), (9.0, 0.0)))
    assert edges_um(padded) == (3.2, 3.4)
    np.testing.assert_allclose(cut(padded, 3.25, 3.3), [[3.25, 0.25], [3.3, 0.5]], rtol=1e-9)


def test_product_with_a_quantum_efficiency() -> None:
    efficiency = Response(((3.0, 0.5), (4.0, 1.0)))
    both = product(TRAPEZE, efficiency)
    um = np.linspace(3.2, 3.6, 101)
    # A chord over h leaves a b h^2 / 4 of the product of slopes a, b: 5, 0.5 per um, 0.15 um / 8.
    np.testing.assert_allclose(both.at(um), TRAPEZE.at(um) * efficiency.at(um), atol=2.3e-4)
    assert edges_um(both) == (3.2, 3.6)
    with pytest.raises(SceneError, match="no part of"):
        product(TRAPEZE, Response(((5.0, 0.5), (6.0, 1.0))))


@pytest.mark.parametrize("given", [(3.3, 3.5), TRAPEZE])
def test_plain_form(given: Any) -> None:
    assert from_plain(to_plain(given)) == given


BASE: dict[str, Any] = {"name": "a", "spray": {"model": "none"}}

BAD = [
    ([[3300, 0.1], [3400, 0.2]], "wavelength 3300 .* looks like nanometres"),
    ([[3.3, 0.1], [3.4, -0.2]], r"value -0\.2 at 3\.4 um is outside 0\.\.1"),
    ([[3.3, 80], [3.4, 90]], "percent"),
    ([[3.3, 0.0], [3.4, 0.0]], "is empty"),
    ([[3.3, float("nan")], [3.4, 0.5]], "not finite"),
    ([[3.3, 0.5]], "1 pairs are no curve"),
    ([[3.3, 0.5], [3.3, 0.6]], "given twice"),
    ([[3.3, 0.5, 1.0], [3.4, 0.5]], "expected pairs"),
]


@pytest.mark.parametrize(("curve", "message"), BAD)
@pytest.mark.parametrize("key", ["optics.filter_um", "camera.sensor.quantum_efficiency"])
def test_bad_curves_are_refused(curve: object, message: str, key: str) -> None:
    data: dict[str, Any] = {}
    place = data
    *sections, name = key.split(".")
    for section in sections:
        place = place.setdefault(section, {})
    place[name] = curve
    with pytest.raises(SceneError, match=f"{re.escape(key)}: .*{message}"):
        parse_scene({**BASE, **data})


def test_bad_and_missing_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "filter.csv"
    for text, message in (
        ("3300,0.1\n3400,0.2\n", "wavelength 3300 .* looks like nanometres"),
        ("wavelength_um, transmission\n3.3, 0.5\n3.4, much\n", r"line 3: '3\.4, much'"),
    ):
        path.write_text(text)
        with pytest.raises(SceneError, match=rf"filter\.csv: {message}"):
            parse_scene({**BASE, "optics": {"filter_um": str(path)}})
    with pytest.raises(SceneError, match="cannot be read"):
        parse_scene({**BASE, "optics": {"filter_um": str(tmp_path / "none.csv")}})


def test_a_file_beside_the_scene_becomes_part_of_it(tmp_path: Path) -> None:
    """Falling wavelengths, a header, semicolons and comments are all usual."""
    (tmp_path / "ch.csv").write_text("# CH filter\nlambda; T\n3.5; 0.1 # edge\n3.4; 0.8\n3.3; 0\n")
    (tmp_path / "scene.yaml").write_text(
        yaml.safe_dump({**BASE, "optics": {"filter_um": "ch.csv"}})
    )
    scene = load_scene(tmp_path / "scene.yaml")
    assert scene.optics.filter_um == ((3.3, 0.0), (3.4, 0.8), (3.5, 0.1))
    assert parse_scene(yaml.safe_load(dump_scene(scene))) == scene


def test_quantum_efficiency_counts_once() -> None:
    """A constant, as a number and as a curve: the same electrons from the same black body."""
    number = parse_scene({**BASE, "camera": {"sensor": {"quantum_efficiency": 0.7}}})
    curve = parse_scene(
        {**BASE, "camera": {"sensor": {"quantum_efficiency": [[3.0, 0.7], [4.0, 0.7]]}}}
    )
    electrons = [
        SensorModel.from_scene(scene).mean_electrons(
            band_radiance(450.0, filter_um=scene_filter(scene))
        )
        for scene in (number, curve)
    ]
    assert electrons[0] == pytest.approx(electrons[1], rel=1e-12)
    assert scene_filter(number) == (3.3, 3.5)


def test_table_for_many_temperatures() -> None:
    """More than a few thousand temperatures are looked up: cubic Hermite, 1e-12."""
    kelvin = np.geomspace(2.0, 5000.0, 20_000)
    many = band_radiance(kelvin, filter_um=TRAPEZE)
    few = np.concatenate([band_radiance(part, filter_um=TRAPEZE) for part in np.split(kelvin, 20)])
    normal = few > 1e-280
    np.testing.assert_allclose(many[normal], few[normal], rtol=1e-10)
    hot = np.full(5000, 1e14)  # beyond the table: proportional to T
    assert band_radiance(hot, filter_um=TRAPEZE)[0] == pytest.approx(
        float(band_radiance(1e14, filter_um=TRAPEZE)), rel=1e-8
    )
    cold = band_radiance(np.full(5000, 1e-3), filter_um=TRAPEZE)
    assert np.all(cold == 0.0)
