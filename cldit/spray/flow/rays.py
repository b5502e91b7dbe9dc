"""Grid of the gas along the rays from the injector's tip: cells that grow with the jets.

A free jet widens in proportion to the distance from its hole. So do the cells of spherical
coordinates about the tip: they resolve a jet equally well everywhere, and every plume flows along a
line of the grid. The coordinates are radius, polar angle and azimuth about an axis that depends on
the injector:

- one plume: its own axis, one cell of azimuth, since the mean flow is the same all around;
- equal plumes at equal angles: the injector's axis, and half of the sector of one plume, between
  planes of symmetry;
- other plumes, all inclined: the injector's axis, and a full circle of azimuth;
- any others: an axis across the injector's, so that the poles are in gas at rest; all plumes.

Walls are planes or cones of rays, the tip, and a sphere far away. All of them slip. Arrays have the
shape (azimuth, polar angle, radius).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cldit.arrays import Floats, Ints


@dataclass(frozen=True)
class RayGrid:
    """Faces of the cells: `radius_m`, `polar` and `azimuth` (rad), each ascending.

    frame: (3, 3), rows are the local axes, the last one that of the polar angle. symmetry: number
    of equal plumes about it, 1 without symmetry, 0 for a round one.
    """

    frame: Floats
    radius_m: Floats
    polar: Floats
    azimuth: Floats
    symmetry: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of cells in azimuth, polar angle and radius."""
        return len(self.azimuth) - 1, len(self.polar) - 1, len(self.radius_m) - 1

    @property
    def ring(self) -> bool:
        """True if the cells close in a full circle of azimuth."""
        return self.symmetry == 1 and bool(
            np.isclose(self.azimuth[-1] - self.azimuth[0], 2 * np.pi, rtol=1e-9)
        )

    @property
    def copies(self) -> float:
        """Number of copies of the cells around the axis."""
        if self.symmetry == 0:
            return float(2 * np.pi / (self.azimuth[-1] - self.azimuth[0]))
        return 1.0 if self.symmetry == 1 else 2.0 * self.symmetry

    @cached_property
    def volume_m3(self) -> Floats:
        """Volume of each cell, once (not of its copies)."""
        angles = np.diff(self.azimuth)[:, None] * -np.diff(np.cos(self.polar))
        return np.asarray(angles[:, :, None] * np.diff(self.radius_m**3) / 3)

    @cached_property
    def areas(self) -> tuple[Floats, Floats, Floats]:
        """Vector areas of the lower faces (azimuth, polar, radius), of unit radius; (A, P, 3).

        They have one entry more along their own axis. Those of a cell add to zero.
        """
        p, a = self.polar, self.azimuth
        across, along = np.diff(np.sin(a)), -np.diff(np.cos(a))  # integrals of cos and sin
        round_ = np.diff(a)
        square = 0.5 * np.diff(p - np.sin(p) * np.cos(p))
        outward = np.stack(
            [
                across[:, None] * square,
                along[:, None] * square,
                round_[:, None] * 0.5 * np.diff(np.sin(p) ** 2),
            ],
            axis=-1,
        )
        down = (
            np.stack(
                [
                    across[:, None] * np.cos(p),
                    along[:, None] * np.cos(p),
                    -round_[:, None] * np.sin(p),
                ],
                axis=-1,
            )
            * np.sin(p)[None, :, None]
        )
        normal = np.stack([-np.sin(a), np.cos(a), np.zeros_like(a)], axis=-1)
        azimuthal = normal[:, None, :] * np.diff(p)[None, :, None]
        return np.asarray(azimuthal), np.asarray(down), np.asarray(outward)

    @cached_property
    def strip_m2(self) -> Floats:
        """Integral of the radius over each cell, (R,): area of side faces of unit angle."""
        return np.asarray(np.diff(self.radius_m**2) / 2)

    @cached_property
    def middle(self) -> tuple[Floats, Floats, Floats]:
        """Middles of the cells: azimuth, polar angle, radius."""
        faces = (self.azimuth, self.polar, self.radius_m)
        return tuple(0.5 * (edges[1:] + edges[:-1]) for edges in faces)  # type: ignore[return-value]

    @cached_property
    def conductance(self) -> tuple[Floats, Floats, Floats]:
        """Area over distance of the middles, of the lower faces along each axis; walls have 0.

        Azimuth and polar angle: (A, P), times the cell's length; radius: (R,), times the angle.
        """
        azimuth, polar, radius = self.middle
        azimuthal = np.zeros(self.shape[:2])
        if self.ring:
            closing = azimuth[0] - (azimuth[-1] - 2 * np.pi)
            azimuthal[0] = np.diff(self.polar) / (np.sin(polar) * closing)
        azimuthal[1:] = np.diff(self.polar) / (np.sin(polar) * np.diff(azimuth)[:, None])
        down = np.zeros(self.shape[:2])
        down[:, 1:] = np.diff(self.azimuth)[:, None] * np.sin(self.polar[1:-1]) / np.diff(polar)
        outward = np.zeros(self.shape[2])
        outward[1:] = self.radius_m[1:-1] ** 2 / np.diff(radius)
        return azimuthal, down, outward

    @property
    def directions(self) -> Floats:
        """Unit vectors of the rays (A, P, 3), not in the grid's frame."""
        azimuth, polar, _ = self.middle
        across = np.sin(polar)
        local = np.stack(
            [
                np.cos(azimuth)[:, None] * across,
                np.sin(azimuth)[:, None] * across,
                np.broadcast_to(np.cos(polar), self.shape[:2]),
            ],
            axis=-1,
        )
        return np.asarray(local @ self.frame)

    def beside(self, amount: Floats) -> float:
        """Sum of an amount (azimuth, polar, radius) in the cells beside walls that are rays."""
        side = np.zeros(self.shape[:2], dtype=bool)
        side[:, -1] = True
        if self.symmetry == 1:
            side[:, 0] |= self.polar[0] > 0
            if not self.ring:
                side[0] = side[-1] = True
        return float(np.sum(amount[side])) * self.copies

    def nearest(self, axes: Floats) -> Ints:
        """Index (A, P) of the one of `axes` (H, 3) that is closest to each ray."""
        return np.asarray(np.argmax(self.directions @ axes.T, axis=2))

    @property
    def angle(self) -> Floats:
        """Solid angle of each ray (A, P)."""
        return np.asarray(np.diff(self.azimuth)[:, None] * -np.diff(np.cos(self.polar)))
