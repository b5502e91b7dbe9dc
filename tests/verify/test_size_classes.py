"""Droplets of two sizes in different places: both methods against a Monte Carlo in plain NumPy.

That shares nothing with cldit: Mie's phase functions are miepython's, collisions are found by
Woodcock's method (delta tracking) in two half boxes, and no cell is known to it.
"""

from __future__ import annotations

from dataclasses import replace

import miepython
import numpy as np
import pytest

from cldit.arrays import Floats
from cldit.errors import TransportError
from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.octree import Octree, PointSource, build_octree
from cldit.scene import Scene, parse_scene
from cldit.transport.mie_phase import SizeBins
from cldit.transport.phase import ScatteringTable, SizeClasses
from cldit.transport.size_classes import in_size_classes
from cldit.transport.trace import Trace, settings_for, trace

UM, N, K = 3.4, 1.338, 0.0341
SMALL, LARGE = 2e-6, 18e-6
EDGE, CELLS = 0.064, 32
HALF = EDGE / 4  # of the box
# Extinction per metre and albedo on the side of small and of large droplets.
BETA, ALBEDO = np.array([120.0, 70.0]), np.array([0.97, 0.85])
DISC_Y, DISC_RADIUS = 0.04, 0.02
PIXELS = 6
SAMPLES = 8192


def scene(**transport: object) -> Scene:
    return parse_scene(
        {
            "name": "two sizes",
            "spray": {"model": "none"},
            "camera": {
                "model": "orthographic",
                "pixels": [PIXELS, 1],
                "field_m": [1.8 * HALF, 0.3 * HALF],
                "target_m": [0.0, 0.0, 0.0],
            },
            "background": {
                "centre_m": [0.0, DISC_Y, 0.0],
                "radius_m": DISC_RADIUS,
                "temperatures_K": [400.0, 500.0],
            },
            "domain": {"centre_m": [0.0, 0.0, 0.0], "edge_m": EDGE},
            "transport": {"audit": False, **transport},
        }
    )


def places() -> Floats:
    """Middles (N, 3) of the cells of the box."""
    along = (np.arange(CELLS // 2) + 0.5) * EDGE / CELLS - HALF
    return np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)


def tree_of(points: PointSource) -> Octree:
    edge_m = 1.01 * EDGE / CELLS
    frame = Cube.around(centre_m=(0.0, 0.0, 0.0), edge_m=EDGE, leaf_edge_m=edge_m)
    return build_octree(frame, points, [], optical_depth_split=1.0)


def medium(denser: float = 1.0) -> tuple[Octree, ScatteringTable]:
    """A parcel in the middle of each cell of the box, and the phase functions of both sizes."""
    cell, place = EDGE / CELLS, places()
    side = (place[:, 0] > 0).astype(int)
    extinction = denser * BETA[side] * cell**3
    scattering = ALBEDO[side] * extinction
    diameter = np.where(side, LARGE, SMALL)
    bins = SizeBins.of(diameter, scattering, wavelength_um=UM, n=N, k=K)
    phase = in_size_classes(
        bins.mean(),
        bins,
        position_m=place,
        diameter_m=diameter,
        scattering_m2=scattering,
        sampled=True,
    )
    assert phase.classes is not None
    number = phase.classes.number(diameter)
    np.testing.assert_array_equal(number, side)
    none = np.zeros(len(place))
    points = PointSource(
        place,
        extinction - scattering,
        scattering,
        none,
        class_scattering_m2=(np.where(number == 1, scattering, 0.0),),
    )
    return tree_of(points), phase


def traced(
    device: Device, *, one_phase: bool, transport: dict[str, object], denser: float = 1.0
) -> Trace:
    tree, phase = medium(denser)
    if one_phase:
        phase = replace(phase, classes=None)
    asked = scene(**transport)
    return trace(tree, asked, device, settings_for(asked, phase))


def inverse(diameter_m: float) -> tuple[Floats, Floats]:
    """Share that is scattered into larger cosines, and the cosines; miepython's intensities."""
    cosine = np.cos(np.linspace(0.0, np.pi, 4001))
    x = np.pi * diameter_m / (UM * 1e-6)
    light = miepython.i_unpolarized(complex(N, -K), x, cosine, norm="one")
    share = np.append(0.0, np.cumsum((light[1:] + light[:-1]) / 2 * -np.diff(cosine)))
    return share / share[-1], cosine


def monte_carlo(paths: int, seed: int) -> tuple[Floats, Floats]:
    """Weights of background and wall (2, PIXELS), and their standard errors."""
    rng = np.random.default_rng(seed)
    tables = [inverse(SMALL), inverse(LARGE)]
    weights, errors = np.zeros((2, PIXELS)), np.zeros((2, PIXELS))
    for pixel in range(PIXELS):
        p = np.zeros((paths, 3))
        p[:, 0] = ((pixel + 0.5) / PIXELS - 0.5) * 1.8 * HALF
        p[:, 1] = -HALF
        d = np.tile([0.0, 1.0, 0.0], (paths, 1))
        weight, score = np.ones(paths), np.zeros((2, paths))
        alive = np.arange(paths)
        while len(alive):
            p[alive] += d[alive] * (rng.exponential(1 / BETA.max(), len(alive)))[:, None]
            out = np.any(np.abs(p[alive]) > HALF, axis=1)
            gone = alive[out]
            toward = d[gone]
            with np.errstate(divide="ignore", invalid="ignore"):
                far = (DISC_Y - p[gone, 1]) / toward[:, 1]
                across = np.hypot(*(p[gone] + far[:, None] * toward)[:, [0, 2]].T)
            seen = (toward[:, 1] > 0) & (across < DISC_RADIUS)
            score[0, gone[seen]] = weight[gone[seen]]
            score[1, gone[~seen]] = weight[gone[~seen]]
            alive = alive[~out]
            side = (p[alive, 0] > 0).astype(int)
            hit = rng.random(len(alive)) * BETA.max() < BETA[side]
            some, side = alive[hit], side[hit]
            weight[some] *= ALBEDO[side]
            u = rng.random(len(some))
            cosine = np.where(side == 0, np.interp(u, *tables[0]), np.interp(u, *tables[1]))
            d[some] = _turned(d[some], cosine, 2 * np.pi * rng.random(len(some)))
        weights[:, pixel] = score.mean(axis=1)
        errors[:, pixel] = score.std(axis=1, ddof=1) / paths**0.5
    return weights, errors


def _turned(d: Floats, cosine: Floats, angle: Floats) -> Floats:
    other = np.where(np.abs(d[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    first = np.cross(d, other)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(d, first)
    sine = np.sqrt(1 - cosine**2)
    side = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    turned = cosine[:, None] * d + sine[:, None] * side
    return np.asarray(turned / np.linalg.norm(turned, axis=1)[:, None])


@pytest.fixture(scope="module")
def truth() -> tuple[Floats, Floats]:
    return monte_carlo(40_000, 5)


def _weights(result: Trace) -> Floats:
    return np.stack([result.weights.background[0], result.weights.wall[0]]).astype(float)


def _noise(result: Trace) -> Floats:
    """Standard error (2, 1) of either weight, from the halves of the samples of all pixels."""
    halves = result.weights_difference
    assert halves is not None
    apart = np.stack([halves.background[0], halves.wall[0]]).astype(float)
    return np.asarray(np.sqrt(np.mean(apart**2, axis=1, keepdims=True)))


@pytest.mark.slow
def test_path_by_two_classes(device: Device, truth: tuple[Floats, Floats]) -> None:
    """Twelve weights: each within four standard errors of both (4e-4 by chance for all of them),
    their mean squares as those of such errors, whose 99.9th percentile is 2.7. One phase function
    for all cells is further off than ten."""

    def by_path(*, one_phase: bool) -> Trace:
        asked = {"method": "path", "accuracy_K": 1e-3, "max_samples": SAMPLES, "seed": 1}
        return traced(device, one_phase=one_phase, transport=asked)

    both = by_path(one_phase=False)
    assert both.counts["samples"] == SAMPLES
    error = np.hypot(_noise(both), truth[1])
    apart = (_weights(both) - truth[0]) / error
    assert np.abs(apart).max() < 4 and np.mean(apart**2) < 2.7
    one = by_path(one_phase=True)
    assert np.abs((_weights(one) - truth[0]) / error).max() > 10


def test_light_that_goes_straight_on_is_not_scattered(device: Device) -> None:
    """Behind droplets that scatter isotropically are others that scatter within 0.8 degrees: paths
    by both classes see what they see without the latter, within four standard errors."""
    isotropic = ScatteringTable.of(lambda cosine: 1 - cosine)
    forward = ScatteringTable.of(lambda cosine: np.minimum((1 - cosine) / 1e-4, 1.0))
    phase = replace(isotropic, classes=SizeClasses(np.array([1e-5]), (isotropic, forward), 0.0))
    asked = scene(method="path", accuracy_K=1e-3, max_samples=1024)
    place = places()
    behind = place[:, 1] > 0
    results = []
    for denser in (0.0, 1.0):
        scattering = np.where(behind, denser, 1.0) * BETA[0] * (EDGE / CELLS) ** 3
        none = np.zeros(len(place))
        straight = np.where(behind, scattering, 0.0)
        points = PointSource(place, none, scattering, none, class_scattering_m2=(straight,))
        results.append(trace(tree_of(points), asked, device, settings_for(asked, phase)))
    without, both = (_weights(result).mean(axis=1) for result in results)
    error = np.hypot(*(_noise(result)[:, 0] for result in results)) / PIXELS**0.5
    assert np.all(np.abs(both - without) < 4 * error)
    assert np.all(4 * error < 0.1 * without)


@pytest.mark.slow
@pytest.mark.parametrize("denser", [1.0, 10.0])
def test_source_by_two_classes(device: Device, denser: float) -> None:
    """Against `path`, in cells of optical depth 0.2 and in deep ones, where paths of the gather
    draw a class too. Left are what `source` simplifies, and ordinates: 0.3 at most of what one
    phase function for all cells errs by. Energy is conserved as with one."""
    by_path = {"method": "path", "accuracy_K": 1e-3, "max_samples": SAMPLES}
    truth = traced(device, one_phase=False, transport=by_path, denser=denser)
    both, one = (
        traced(device, one_phase=one, transport={"accuracy_K": 0.05}, denser=denser)
        for one in (False, True)
    )
    left, before = (
        float(np.mean((_weights(result) - _weights(truth)) ** 2 - _noise(truth) ** 2))
        for result in (both, one)
    )
    assert before > 0 and left < 0.3**2 * before
    assert both.closure is not None and abs(both.closure.largest) < 1e-3


def test_other_classes_than_the_medium_has(device: Device) -> None:
    tree, phase = medium()
    asked = scene(method="path")
    with pytest.raises(
        TransportError, match=r"has 2 classes of droplet size and the octree 1; allowed"
    ):
        trace(replace(tree, shares=None), asked, device, settings_for(asked, phase))
