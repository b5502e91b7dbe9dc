"""Functions of the final gather against NumPy; tests/verify holds whole paths to method `path`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from cldit.transport.discrete_ordinates.quadrature import NEAREST_SIDE, focused, isotropic, nearest
from cldit.transport.discrete_ordinates.segments import Segments
from cldit.transport.final_gather.gather import neyman_allocation
from cldit.transport.sobol import DIMENSIONS, points

DEFINES = f"""
#define EMITTERS 1
#define HAS_SCATTERING 1
#define PENDING_READS 2
#define SIMD_WIDTH 8
#define NEAREST_SIDE {NEAREST_SIDE}
"""


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_nearest_direction(apply: Any, real: type[np.floating]) -> None:
    """The table's entry is the nearest direction of the same octant, or one that is as near but for
    the size of an entry: 1 / NEAREST_SIDE across a face of the octahedron, at most 4 times that on
    the sphere. None crosses a face in the other sense: not where a component is tiny, nor at the
    borders of entries. Components of 0 cross no face; sweeps count them as downwards."""
    directions = isotropic(64, np.random.default_rng(3))
    rng = np.random.default_rng(4)
    wanted = rng.normal(size=(20000, 3))
    wanted[:8000] *= 10.0 ** rng.uniform(-30, 0, (8000, 3))
    wanted[8000:9000] = rng.integers(-NEAREST_SIDE, NEAREST_SIDE + 1, (1000, 3)) / NEAREST_SIDE
    wanted[9000:10000] *= rng.integers(0, 2, (1000, 3))
    wanted = wanted[np.any(wanted != 0, axis=1)]
    wanted /= np.linalg.norm(wanted, axis=1)[:, None]
    wanted = wanted.astype(real).astype(float)
    one_lane = DEFINES.replace("SIMD_WIDTH 8", "SIMD_WIDTH 1")
    entry = apply(
        "gather.cl",
        "(real)direction_near((real3)(a, b, c))",
        list(wanted.T),
        defines=("" if real is np.float32 else "#define USE_FLOAT64\n") + one_lane,
    )
    number = nearest(directions).reshape(-1)[entry.astype(int)]
    found = directions.unit[number]
    assert np.count_nonzero((found > 0) != (wanted > 0)) == 0
    cosine = wanted @ directions.unit.T
    there = np.all((wanted > 0)[:, None] == (directions.unit > 0), axis=2)
    best = np.where(there, cosine, -1).max(axis=1)
    away, least = (np.arccos(np.clip(c, -1, 1)) for c in ((found * wanted).sum(axis=1), best))
    assert np.all(away <= least + 2 * 4 / NEAREST_SIDE)
    assert np.mean(away > least + 1e-6) < 0.1


def test_place_of_a_share(apply: Any) -> None:
    """Length at which a ray has lost a part of its loss in the cell: Beer-Lambert, inverted."""
    parts, depths = np.meshgrid(np.linspace(0.01, 0.99, 9), [1e-3, 0.3, 5.0])
    part, depth = (values.reshape(-1).astype(np.float32) for values in (parts, depths))
    got = apply("attenuation.h", "length_at(a, absorbed(b), b)", [part, depth])
    lost = -np.expm1(-got.astype(float) * depth) / -np.expm1(-depth.astype(float))
    np.testing.assert_allclose(lost, part, rtol=1e-5)


def test_depth_of_a_share(apply: Any) -> None:
    """-log(1 - share): to 3e-7 of it, from shares as small as single precision has them."""
    share = np.concatenate(
        [
            np.geomspace(1e-30, 0.5, 400),
            np.linspace(0.25, 0.35, 400),
            1 - np.geomspace(1e-7, 0.5, 400),
        ]
    ).astype(np.float32)
    share[0] = 0.0
    got = apply("attenuation.h", "depth_of(a)", [share])
    np.testing.assert_allclose(got, -np.log1p(-share.astype(float)), rtol=3e-7, atol=0)


def test_balanced_directions() -> None:
    """A first moment of 0, the same sum of weights, and small changes of each."""
    rng = np.random.default_rng(8)
    axis = np.array([0.0, 1.0, 0.0])
    uneven = focused(16, rng, axis=axis, half_angle_rad=0.5, share=0.25)
    even = uneven.balanced()
    assert np.abs(uneven.weight @ uneven.unit).max() > 1e-3
    np.testing.assert_allclose(even.weight @ even.unit, 0.0, atol=1e-15)
    assert even.weight.sum() == pytest.approx(1.0, abs=1e-14)
    assert np.all(np.abs(even.weight / uneven.weight - 1) < 0.2)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.37, -0.81), (-1.0, 1.0), (1e-9, 0.5)])
def test_segments_of_an_ordinate(slopes: tuple[float, float], backwards: bool) -> None:
    """Segments make up every layer, and each lies in one cell; those of an ordinate among several
    are the same as alone."""
    start = np.array([0.21, 0.64])
    others = np.array([[0.9, 0.4], [0.0, -0.3]])
    several = Segments.of(
        np.array([others[0], slopes, others[1]]),
        np.array([others[0], start, others[0]]),
        layers=40,
        backwards=np.array([True, backwards, False]),
    )
    alone = Segments.of(np.array([slopes]), start[None], layers=40, backwards=np.array([backwards]))
    for name in ("layer_share", "layer", "shift", "midpoint", "exits", "basis"):
        here = getattr(several, name)[several.ordinate == 1]
        np.testing.assert_array_equal(here, getattr(alone, name))
    np.testing.assert_array_equal(several.shifts()[several.ordinate == 1], alone.shifts())
    np.testing.assert_allclose(np.bincount(alone.layer, alone.layer_share), 1.0, atol=1e-5)
    end = np.cumsum(alone.layer_share)[:, None]
    for share in (0.999, 0.001):
        along = end - share * alone.layer_share[:, None]
        np.testing.assert_array_equal(np.floor(start + np.array(slopes) * along), alone.shift)
    assert np.all(np.abs(np.diff(alone.shift, axis=0)) <= 1)
    assert np.all((alone.midpoint >= 0) & (alone.midpoint <= 1))


@pytest.mark.parametrize("slope", [-1.0, -0.6, 0.31, 0.9])
def test_zero_mean_basis(slope: float) -> None:
    """Uniform radiance contributes nothing in any layer. On average over where rays start, a linear
    field contributes as if they were uniform in the cell; less where they hardly move sideways."""
    starts = (np.arange(400) + 0.5) / 400
    found = np.zeros((3, 3))
    places = np.column_stack([starts, np.random.default_rng(2).permutation(starts)])
    slopes = np.tile([slope, 0.73 * slope], (len(starts), 1))
    rays = Segments.of(slopes, places, layers=1, backwards=np.zeros(len(starts), bool))
    for number in range(len(starts)):
        its = rays.ordinate == number
        basis, part, midpoint = rays.basis[its], rays.layer_share[its], rays.midpoint[its]
        np.testing.assert_allclose(part @ basis, 0.0, atol=1e-6)
        along = np.array([slope, 0.73 * slope, 1.0]) * part[:, None]
        middles = np.einsum("si,sj,s->ij", basis, midpoint - 0.5, part)
        inside = np.einsum("si,sj,s->ij", rays.basis_scale[number] * along, along, part) / 12
        found += (middles + inside) / len(starts)
    moved = np.abs([slope, 0.73 * slope, 1.0])
    expected = np.minimum(2 * (1 - (1 - moved) ** 2), 1.0) / 12
    # Midpoints of 400 places: a kink each; v goes with u by chance, as 1 / root of so many.
    np.testing.assert_allclose(np.diag(found), expected, rtol=2e-3)
    np.testing.assert_allclose(found - np.diag(np.diag(found)), 0.0, atol=0.01)


@pytest.mark.parametrize("count", [1, 7, 64])
def test_direction_at_a_share(apply: Any, count: int) -> None:
    """The first direction whose cumulative share is above u, wherever the search starts."""
    rng = np.random.default_rng(5)
    weight = rng.exponential(size=count) ** 3 + 1e-9
    share = (np.cumsum(weight) / weight.sum()).astype(np.float32)
    u = rng.random(400).astype(np.float32)
    wanted = np.minimum(np.searchsorted(share, u, "right"), count - 1)
    even = np.arange(count) / count
    start = np.minimum(np.searchsorted(share, even, "right"), count - 1).astype(np.int32)
    start[::3] = np.minimum(start[::3] + 1, count - 1)  # as rounding might have it
    table = np.zeros((400, 4), np.float32)
    table[:count, 3] = share
    starts = np.zeros(400, np.int32)
    starts[:count] = start
    got = apply(
        "gather.cl",
        f"(real)direction_at(a, (__global const real4 *)b_, (__global const int *)c_, {count})",
        [u, table.reshape(-1), starts.view(np.float32)],
        defines=DEFINES,
    )
    np.testing.assert_array_equal(got, wanted)


def test_points_are_sobols() -> None:
    """Any part of the sequence, against SciPy's, whose order is that of Gray's code."""
    expected = qmc.Sobol(DIMENSIONS, scramble=False, bits=30).random(2**12)
    index = np.arange(2**12)
    gray = np.empty_like(expected)
    gray[index ^ (index >> 1)] = expected
    got = np.concatenate([points(0, 1), points(1, 2046), points(2047, 2049)])
    np.testing.assert_array_equal(got / 2.0**32, gray)


def test_neyman_allocation() -> None:
    """No other allocation of as many samples has less variance, but for powers of two. The bound is
    nearly reached, or one tile goes on."""
    rng = np.random.default_rng(2)
    variance, size = rng.exponential(size=200) ** 4, rng.integers(1, 145, 200)
    had = 1 << rng.integers(3, 8, 200)
    got = neyman_allocation(variance * size / had, had, size, allowed=0.3)
    assert np.all(np.log2(got) % 1 == 0)
    left = (variance * size / got).sum()
    assert 0.3 / 2 < left < 0.3 * 2
    spent = (got * size).sum()
    for other in (np.ones(200), variance, variance**0.25):
        even = spent * other / (other * size).sum()
        assert (variance * size / even).sum() > 1.1 * left
    reached = neyman_allocation(
        np.array([1.0, 2.0]), np.array([64, 64]), np.array([9, 9]), allowed=2.9
    )
    assert reached[1] == 128 and reached[0] <= 64
