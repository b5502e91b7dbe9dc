"""Radiance along lines of sight through a spray, and T_app from it.

This is an estimate, not a trace: lines are independent, and the light that droplets scatter towards
the camera is estimated from the probability of an unobstructed way into the spray.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import Filter
from cldit.optics.sightlines import Sightlines
from cldit.optics.spectral import Quadrature
from cldit.scene.schema import Scene

Groups = NDArray[np.intp]


def belongs(groups: Groups) -> Floats:
    """(S, K), 1 where a sample is in a group; `groups` (S,) has the number of its group."""
    return np.asarray(groups[:, None] == np.arange(int(groups.max()) + 1), float)


def emitted(depths: list[Floats] | tuple[Floats, ...]) -> tuple[Floats, list[Floats]]:
    """Transmission (L, S) of lines, and weights (L, Y, S) of the light from three processes.

    The optical depths (L, Y, S) are those of vapour absorption, droplet absorption and scattering.
    """
    total = depths[0] + depths[1] + depths[2]
    behind = np.cumsum(total, axis=1)
    reaching = np.exp(-(behind - total)) * -np.expm1(-total) / np.where(total > 0, total, 1.0)
    return np.exp(-behind[:, -1]), [reaching * depth for depth in depths]


def _escaping(total: Floats) -> Floats:
    """Probability (L, Y, S) that light from the middle of a slice leaves the spray directly.

    Plumes are about as wide as deep, so the mean over both directions along the line is taken.
    """
    front = np.cumsum(total, axis=1) - total / 2.0
    rear = total.sum(axis=1, keepdims=True) - front
    return np.asarray((np.exp(-front) + np.exp(-rear)) / 2.0)


@dataclass(frozen=True)
class Glow:
    """Black-body radiance in S samples or groups at the temperatures of the lines' fuel, of the
    walls, and of the coldest and hottest background: (L, Y, S), (L, Y, S), (1, S), (2, S)."""

    vapour: Floats
    droplets: Floats
    walls: Floats
    ends: Floats

    @classmethod
    def of(cls, scene: Scene, lines: Sightlines, fine: Quadrature) -> "Glow":
        """Radiances in a scene at the temperatures of `lines`; `fine` has one node per sample."""
        spline = fine.shares
        low, high = np.exp(spline.x[[0, -1]])

        def black(temperature_K: Floats) -> Floats:
            shares = spline(np.log(np.clip(temperature_K, low, high)))
            total = band_radiance(temperature_K, filter_um=fine.filter_um)
            return np.asarray(total[..., None] * shares)

        coldest, hottest = (f(scene.background.temperatures_K) for f in (min, max))
        if hottest <= coldest:  # a single background: assume a second one
            hottest = coldest + 50.0
        return cls(
            vapour=black(lines.vapour_K),
            droplets=black(lines.droplet_K),
            walls=black(np.array([scene.walls.temperature_K])),
            ends=black(np.array([coldest, hottest])),
        )

    def gathered(self, groups: Groups) -> "Glow":
        """Sums over the samples of each group, whose numbers are `groups` (S,)."""
        membership = belongs(groups)
        return Glow(*(x @ membership for x in (self.vapour, self.droplets, self.walls, self.ends)))

    def apparent(
        self, depths: tuple[Floats, Floats, Floats], filter_um: Filter
    ) -> tuple[Floats, Floats]:
        """T_app [K] and emissivity, (L,), of lines with optical depths as in `emitted`.

        Light Q that droplets scatter towards the camera comes from the walls with probability E;
        otherwise from fuel like that of its slice, which emits j and scatters the share a of
        incident light: Q = E W + (1 - E) (j + a Q).
        """
        cold, hot = self.ends
        through, (vapour, liquid, scattered) = emitted(depths)
        total = depths[0] + depths[1] + depths[2]
        free = _escaping(total)
        per = 1.0 / np.where(total > 0, total, 1.0)
        emitted_mean = (depths[0] * self.vapour + depths[1] * self.droplets) * per
        again = 1.0 - (1.0 - free) * depths[2] * per  # 0 only if nothing is absorbed or leaves
        turned = (free * self.walls + (1.0 - free) * emitted_mean) / np.maximum(again, 1e-12)
        sent = vapour * self.vapour + liquid * self.droplets + scattered * turned
        slope = through @ (hot - cold) / (hot.sum() - cold.sum())
        intercept = sent.sum(axis=(1, 2)) + through @ cold - slope * cold.sum()
        radiance = np.maximum(intercept, 0.0) / np.maximum(1.0 - slope, 1e-12)
        return np.asarray(temperature_of_radiance(radiance, filter_um=filter_um)), 1.0 - slope
