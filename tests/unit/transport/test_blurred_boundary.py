"""The boundary blurred by the forward peak, against Legendre series of peak and disc."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import eval_legendre

from cldit.gpu.device import Device
from cldit.transport.boundary import NONE
from cldit.transport.cells import SweptBox
from cldit.transport.discrete_ordinates import blurred_boundary
from cldit.transport.discrete_ordinates.blurred_boundary import ForwardPeak, blurred_maps
from cldit.transport.discrete_ordinates.quadrature import Ordinates, isotropic
from cldit.transport.phase import ScatteringTable
from cldit.transport.view import View
from tests.phase_tables import henyey_greenstein

DEGREES = 80
PHASE = henyey_greenstein(0.8)


def peak_of(phase: ScatteringTable) -> ForwardPeak:
    peak = ForwardPeak.of(phase)
    assert peak is not None
    return peak


def view_of(disc: tuple[float, ...], device: Device) -> View:
    return View(
        disc=np.array(disc),
        patches=NONE,
        middle=np.zeros(4),
        pitch=(1.0, 1.0),
        distance=100.0,
        pixels=(1, 1),
        device=device,
    )


def test_peak_has_the_moments_that_three_leave() -> None:
    """Of the moments l of Henyey-Greenstein, g^l, over g^3 beyond the third; 1 up to it."""
    peak = peak_of(PHASE)
    assert peak.weight.sum() == pytest.approx(1.0, abs=1e-12)
    degrees = np.arange(7)
    found = np.array([peak.weight @ eval_legendre(n, peak.cosine) for n in degrees])
    expected = np.where(degrees < 4, 1.0, 0.8**degrees / 0.8**3)
    # A bin's place is good to half of it, 1/32 in the sine s of half the angle; the error of P_n,
    # whose second derivative by s is -2 n (n + 1) at most, averages over a bin to its square / 12.
    np.testing.assert_allclose(found, expected, atol=7 * 8 * 2 / 16**2 / 6)


def test_no_peak_without_a_third_moment() -> None:
    assert ForwardPeak.of(henyey_greenstein(0.0)) is None
    assert ForwardPeak.of(henyey_greenstein(-0.4)) is None


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.6, -0.8, 0.0), (-0.48, 0.6, 0.64)])
def test_directions_lie_about_the_ray(axis: tuple[float, float, float]) -> None:
    peak, ray = peak_of(PHASE), np.array(axis)
    unit, weight = peak.about(ray)
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(weight @ unit, (peak.weight @ peak.cosine) * ray, atol=1e-12)


def _by_series(cosine: NDArray[np.float64], edge: float) -> NDArray[np.float64]:
    """G times a disc whose edge is at this cosine from its middle, at cosines from the middle."""
    degrees = np.arange(DEGREES)
    peak = np.where(degrees < 4, 1.0, PHASE.moments(DEGREES) / PHASE.moments(4)[3])
    lower = np.where(degrees > 0, eval_legendre(np.maximum(degrees - 1, 0), edge), 1.0)
    disc = (lower - eval_legendre(degrees + 1, edge)) / 2
    return np.asarray((peak * disc) @ eval_legendre(degrees[:, None], cosine))


@pytest.mark.parametrize(("angles", "turns"), [(16, 8), (64, 32)])
def test_maps_against_legendre_series(
    device: Device, monkeypatch: pytest.MonkeyPatch, angles: int, turns: int
) -> None:
    """A box that is small beside its distance to the disc: every place of a map is the same."""
    monkeypatch.setattr(blurred_boundary, "_ANGLES", angles)
    monkeypatch.setattr(blurred_boundary, "_TURNS", turns)
    radius, away = 30.0, 40.0
    box = SweptBox(low=(8, 16, 24), shape=(1, 1, 1))
    disc = (8.5, 16.5 + away, 24.5, radius**2)
    angle = np.linspace(0.0, np.pi, 13)
    unit = np.column_stack([np.sin(angle), np.cos(angle), 0 * angle])
    directions = Ordinates(unit, np.full(13, 1 / 13))
    maps, _ = blurred_maps(view_of(disc, device), box, directions, peak_of(PHASE))
    expected = _by_series(np.cos(angle), away / np.hypot(radius, away))
    assert 0.05 < expected.max() - 0.5 and abs(expected[-1]) < 0.05
    # Turns about the ray are in the disc one by one: each ring errs by half a turn of its weight.
    most = float(np.abs(peak_of(PHASE).weight).sum()) / (2 * turns)
    np.testing.assert_allclose(maps[:, 0].mean(axis=(1, 2)), expected, atol=most)


def test_a_boundary_that_is_all_alike_stays_so(device: Device) -> None:
    directions = isotropic(7, np.random.default_rng(1))
    view = view_of((0.0, 0.0, 0.0, np.inf), device)
    maps, _ = blurred_maps(view, SweptBox((0, 0, 0), (9, 5, 7)), directions, peak_of(PHASE))
    np.testing.assert_allclose(maps, 1.0, atol=1e-12)


def test_frames_place_the_box_on_the_map(device: Device) -> None:
    """Its middle in the middle of the map, and all corners within."""
    directions = isotropic(20, np.random.default_rng(2))
    shape = np.array([9, 5, 7])
    view = view_of((4.0, 60.0, 4.0, 100.0), device)
    maps, frames = blurred_maps(view, SweptBox((0, 0, 0), (9, 5, 7)), directions, peak_of(PHASE))
    side = maps.shape[-1]
    at = np.einsum("nij,j->ni", frames[..., :3], shape / 2) + frames[..., 3]
    np.testing.assert_allclose(at, (side - 1) / 2, atol=1e-12)
    corners = np.stack(np.meshgrid(*([0, n] for n in shape), indexing="ij"), -1).reshape(-1, 3)
    at = np.einsum("nij,kj->nki", frames[..., :3], corners) + frames[:, None, :, 3]
    np.testing.assert_allclose(at.min(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(at.max(axis=1), side - 1, atol=1e-12)
    along = np.einsum("nij,nj->ni", frames[..., :3], directions.unit)
    np.testing.assert_allclose(along, 0.0, atol=1e-12)  # a ray has one place
