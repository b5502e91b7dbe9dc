"""Quadrature of the discrete ordinates method: directions and weights over the sphere.

Quadratures are Fibonacci spheres (Gonzalez, Math. Geosci. 42, 2010), denser towards the background
disc or where the phase function scatters to the camera. All sweeps of `trace_source` (stages 1 to
3) use them; the final gather samples those of the final sweeps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.transport.phase import ScatteringTable

_GOLDEN = (1 + 5**0.5) / 2
_CURVE_BITS = 10  # of either coordinate on the square of the Hilbert curve
NEAREST_SIDE = 32  # entries of the table of nearest ordinates along a side of an octant


@dataclass(frozen=True)
class Ordinates:
    """Quadrature: unit vectors (N, 3) to where light comes from, and weights (N,) of sum 1."""

    unit: Floats
    weight: Floats

    @classmethod
    def joined(cls, sets: "Sequence[Ordinates]") -> "Ordinates":
        """Union of several quadratures, with equal shares."""
        return cls(
            unit=np.concatenate([quadrature.unit for quadrature in sets]),
            weight=np.concatenate([quadrature.weight for quadrature in sets]) / len(sets),
        )

    def __len__(self) -> int:
        return len(self.weight)

    def halves(self) -> "tuple[Ordinates, Ordinates]":
        """Two quadratures: every other ordinate, and the rest.

        Together they integrate better than two independent sets.
        """
        even, odd = (
            Ordinates(unit=self.unit[offset::2], weight=2 * self.weight[offset::2])
            for offset in (0, 1)
        )
        return even, odd

    def by_axis(self) -> "Ordinates":
        """Same ordinates, sorted by their closest axis, by which they are swept."""
        order = np.argsort(np.argmax(np.abs(self.unit), axis=1), kind="stable")
        return Ordinates(unit=self.unit[order], weight=self.weight[order])

    def balanced(self) -> "Ordinates":
        """Same directions, with weights of first moment 0: sum of weight x unit = 0.

        In thick cells light would drift by the first moment, far more than it diffuses.
        """
        moments = np.column_stack([np.ones(len(self)), self.unit])
        matrix = moments.T @ (self.weight[:, None] * moments)
        share = np.linalg.lstsq(matrix, np.array([1.0, 0.0, 0.0, 0.0]), rcond=None)[0]
        return Ordinates(unit=self.unit, weight=self.weight * (moments @ share))


def _band(count: int, low: float, high: float, turn: float, lean: float = 0.0) -> Floats:
    """Fibonacci points (count, 3) between two heights z of the unit sphere, rotated about z.

    Their density is proportional to 1 - lean x z, |lean| < 1.
    """
    ends = np.array([low, high])
    begin, end = ends - lean / 2 * ends**2  # of the integral of the density
    share = begin + (end - begin) * (np.arange(count) + 0.5) / count
    z = 2 * share / (1 + np.sqrt(1 - 2 * lean * share))
    angle = 2 * np.pi * (np.arange(count) / _GOLDEN + turn)
    r = np.sqrt(np.maximum(0.0, 1 - z * z))
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def _rotation(rng: np.random.Generator) -> Floats:
    """Random rotation matrix, uniform over all rotations (QR of a normal matrix)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))


def _frame_about(axis: Floats) -> Floats:
    """Matrix whose columns are two directions across `axis`, and `axis`."""
    across = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, across)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def isotropic(count: int, rng: np.random.Generator) -> Ordinates:
    """Fibonacci sphere of `count` equal weights, randomly rotated by `rng`."""
    return Ordinates(
        unit=_band(count, -1.0, 1.0, 0.0) @ _rotation(rng).T, weight=np.full(count, 1 / count)
    )


def focused(
    count: int,
    rng: np.random.Generator,
    *,
    axis: Floats,
    half_angle_rad: float,
    share: float,
    lean: float = 0.0,
) -> Ordinates:
    """Ordinates in two strata: in a cone about `axis` (3,), and around it.

    The weights of a stratum sum to its solid angle. So smooth functions are integrated as well as
    by `isotropic`, and the cone is sampled more finely. `share` of the ordinates are in the cone;
    the density around it is proportional to 1 - lean x the cosine to the axis. `rng` rotates
    either stratum about the axis.
    """
    edge = np.cos(half_angle_rad)
    solid = (1 - edge) / 2
    inside = int(np.clip(round(share * count), 1, count - 1))
    turn = rng.random(2)
    parts = [
        _band(inside, edge, 1.0, turn[0]),
        _band(count - inside, -1.0, edge, turn[1], lean),
    ]
    density = 1 / (1 - lean * parts[1][:, 2])
    weight = np.concatenate(
        [np.full(inside, solid / inside), (1 - solid) * density / density.sum()]
    )
    frame = _frame_about(axis / np.linalg.norm(axis))
    return Ordinates(unit=np.concatenate(parts) @ frame.T, weight=weight)


def about_camera(count: int, rng: np.random.Generator, phase: ScatteringTable) -> Ordinates:
    """Importance sampling of the phase function for scattering to a camera that looks along +y.

    Half of the ordinates are isotropic, for cells off the middle of the image. Weights are
    1 / (4 pi x density): each cell multiplies them by the phase function at its own angle. `rng`
    shifts the ordinates along the polar angle and rotates them.
    """
    density = phase.density * -np.diff(phase.cosine)
    mixed = 0.5 * np.concatenate([[0.0], np.cumsum(density)]) + 0.25 * (1 - phase.cosine)
    place = (np.arange(count) + rng.random()) / count
    cosine = np.interp(place, mixed, phase.cosine)
    bin_ = np.clip(np.searchsorted(mixed, place, "right") - 1, 0, phase.bins - 1)
    per_cosine = np.diff(mixed)[bin_] / -np.diff(phase.cosine)[bin_]
    angle = 2 * np.pi * (np.arange(count) / _GOLDEN + rng.random())
    sine = np.sqrt(np.maximum(0.0, 1 - cosine**2))
    unit = np.stack([sine * np.cos(angle), cosine, sine * np.sin(angle)], axis=1)
    return Ordinates(unit=unit, weight=1.0 / (count * per_cosine))


def for_boundary(
    count: int,
    rng: np.random.Generator,
    *,
    low: Floats,
    high: Floats,
    disc_centre: Floats,
    disc_radius: float,
    lean: float = 0.0,
) -> Ordinates:
    """Ordinates for a box low..high (3,) in front of the background disc (lengths in one unit).

    They are `focused` on the cone of all directions from the box to the disc, or `isotropic` if
    that is a large part of the sphere, or if the radius is infinite. Radiance has edges, so
    the error of n ordinates over a share s of the sphere is s / n^0.75. The sum of squares, of cone
    and rest, is smallest if the odds of an ordinate for the cone are (odds of s)^0.8.
    """
    middle = (low + high) / 2
    axis = disc_centre - middle
    if np.isinf(disc_radius) or axis[1] <= 0:
        return isotropic(count, rng)
    reach = disc_radius + float(np.linalg.norm((high - low)[[0, 2]])) / 2
    gap = disc_centre[1] - high[1]
    half = float(np.arctan2(reach, max(gap + (high[1] - low[1]) / 2, 1e-9)))
    solid = (1 - np.cos(half)) / 2
    if solid > 0.25 or count < 8:
        return isotropic(count, rng)
    odds = (solid / (1 - solid)) ** 0.8
    share = odds / (1 + odds)
    return focused(count, rng, axis=axis, half_angle_rad=half, share=share, lean=lean)


def unfolded(unit: Floats) -> Floats:
    """Octahedral map (2, N) of unit vectors (N, 3) to the square -1..1, as kernels/directions.h.

    See Cigolle et al., J. Computer Graphics Techniques 3, 2014.
    """
    x, y, z = (unit / np.abs(unit).sum(axis=1, keepdims=True)).T
    below = z < 0
    return np.stack(
        [
            np.where(below, (1 - np.abs(y)) * np.copysign(1.0, x), x),
            np.where(below, (1 - np.abs(x)) * np.copysign(1.0, y), y),
        ]
    )


def hilbert_order(unit: Floats) -> NDArray[np.int32]:
    """Order (N,) of unit vectors (N, 3) along the Hilbert curve on the octahedral map.

    Neighbours on the curve are close on the sphere, so that stratified samples of the order are
    stratified over the sphere (Sagan, Space-Filling Curves, 1994, ch. 2).
    """
    side = 1 << _CURVE_BITS
    i, j = np.clip((unfolded(unit) + 1) * (side / 2), 0, side - 1).astype(np.int64)
    place = np.zeros(len(unit), np.int64)
    for bit in reversed(range(_CURVE_BITS)):
        right, up = i >> bit & 1, j >> bit & 1
        place += (3 * right ^ up) << 2 * bit
        mirrored = (up == 0) & (right == 1)
        i, j = np.where(mirrored, side - 1 - i, i), np.where(mirrored, side - 1 - j, j)
        i, j = np.where(up == 0, j, i), np.where(up == 0, i, j)
    return np.argsort(place, kind="stable").astype(np.int32)


def nearest(directions: Ordinates) -> NDArray[np.int32]:
    """Table (8, NEAREST_SIDE, NEAREST_SIDE) of the nearest ordinate of the same octant.

    See kernels/directions.h; -1 if the octant has no ordinate. The octant matters, because the
    radiance on an interface is stored along ordinates that cross it in one sense only.
    """
    middle = (np.arange(NEAREST_SIDE) + 0.5) / NEAREST_SIDE
    y, x = np.meshgrid(middle, middle, indexing="ij")
    points = np.stack([x, y, np.maximum(1 - x - y, 0)], axis=2).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    octant = (directions.unit > 0) @ [1, 2, 4]
    table = np.full((8, len(points)), -1, np.int32)
    for number in np.unique(octant):
        listed = np.flatnonzero(octant == number)
        mirrored = np.abs(directions.unit[listed])
        # Not by BLAS, as in temperature_error.py.
        cosines = np.einsum("pk,dk->pd", points, mirrored)
        table[number] = listed[np.argmax(cosines, axis=1)]
    return table.reshape(8, NEAREST_SIDE, NEAREST_SIDE)
