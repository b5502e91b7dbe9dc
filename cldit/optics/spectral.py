"""Spectral quadrature: the filter as a sum over a few nodes, each traced separately.

A node consists of parts of the filter, adjacent or not, in which the optical properties of the
spray are similar. The filter is divided into narrow intervals; the light of an interval belongs to
one node, or is shared among several by a k-distribution where spectral lines are narrower. The
black body radiance of a node is the sum over its parts at every temperature, so the nodes'
radiances add up to that of the filter exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import SceneError
from cldit.optics.planck import band_radiance, part_radiance
from cldit.optics.response import Filter, edges_um, from_plain, to_plain
from cldit.optics.windows import Pane, mean_pane
from cldit.scene.vessel import Window

_KNOTS_K = np.geomspace(50.0, 5000.0, 256)  # shares are smooth; constant below 50 K


def reference_temperature_K(background_temperatures_K: Sequence[float]) -> float:
    """Median background temperature, for whose light means over the filter are taken."""
    rising = sorted(background_temperatures_K)  # np.median loads numpy.ma
    return float(rising[(len(rising) - 1) // 2] + rising[len(rising) // 2]) / 2.0


@dataclass(frozen=True)
class Quadrature:
    """Assignment of the light of a filter to nodes.

    edges_um: J + 1 rising wavelengths that divide the filter. members: (K, J), share of interval j
    that belongs to node k; columns add up to 1. reference_K: temperature of the light for which
    means over a node are taken.
    """

    filter_um: Filter
    edges_um: tuple[float, ...]
    members: tuple[tuple[float, ...], ...]
    reference_K: float

    def __post_init__(self) -> None:
        shares, edges = np.array(self.members, float), np.array(self.edges_um)
        ends = edges_um(self.filter_um)
        if shares.ndim != 2 or shares.shape[1] != len(edges) - 1 or np.any(np.diff(edges) <= 0):
            raise SceneError(f"quadrature: {len(edges)} edges, shares of shape {shares.shape}")
        if not np.allclose((edges[0], edges[-1]), ends, rtol=1e-12):
            raise SceneError(
                f"quadrature: reaches from {edges[0]:g} to {edges[-1]:g} um, the filter from "
                f"{ends[0]:g} to {ends[1]:g} um"
            )
        if not (np.all(shares >= 0.0) and np.allclose(shares.sum(axis=0), 1.0, atol=1e-9)):
            raise SceneError("quadrature: shares of an interval do not add up to 1")

    @classmethod
    def grey(cls, filter_um: Filter, *, reference_K: float) -> "Quadrature":
        """One node for all of `filter_um`, with means at `reference_K`."""
        return cls(filter_um, edges_um(filter_um), ((1.0,),), reference_K)

    @property
    def nodes(self) -> "tuple[SpectralNode, ...]":
        """The nodes, in order."""
        return tuple(SpectralNode(self, number) for number in range(len(self.members)))

    @cached_property
    def middles_um(self) -> Floats:
        """(I,) middles of the intervals."""
        edges = np.array(self.edges_um)
        return np.asarray((edges[1:] + edges[:-1]) / 2.0)

    @cached_property
    def light(self) -> Floats:
        """(J,) light of a black body at `reference_K` in every interval."""
        return np.asarray(self._parts(np.array([self.reference_K]))[:, 0])

    @cached_property
    def shares(self) -> "scipy.interpolate.CubicSpline":
        """(K,) shares of the filter's black-body radiance over ln T; they add up to 1."""
        parts = np.array(self.members) @ self._parts(_KNOTS_K)
        return scipy.interpolate.CubicSpline(np.log(_KNOTS_K), (parts / parts.sum(axis=0)).T)

    def _parts(self, temperature_K: Floats) -> Floats:
        return np.array(
            [
                part_radiance(temperature_K, filter_um=self.filter_um, low_um=low, high_um=high)
                for low, high in zip(self.edges_um[:-1], self.edges_um[1:], strict=True)
            ]
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; `from_dict` reads it."""
        return {
            "filter_um": to_plain(self.filter_um),
            "edges_um": list(self.edges_um),
            "members": [list(row) for row in self.members],
            "reference_K": self.reference_K,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Quadrature":
        """Reads the result of `to_dict`."""
        return cls(
            from_plain(data["filter_um"]),
            tuple(float(edge) for edge in data["edges_um"]),
            tuple(tuple(float(share) for share in row) for row in data["members"]),
            float(data["reference_K"]),
        )


@dataclass(frozen=True)
class SpectralNode:
    """One term of a quadrature."""

    quadrature: Quadrature
    number: int

    @property
    def _light(self) -> Floats:
        return np.array(self.quadrature.members[self.number]) * self.quadrature.light

    @property
    def wavelength_um(self) -> float:
        """Mean wavelength of its light."""
        light = self._light
        return float(light @ self.quadrature.middles_um / light.sum())

    def share(self, temperature_K: ArrayLike) -> Floats:
        """Share of the filter's black-body radiance, any shape; over the nodes they add up to 1."""
        given_K = np.asarray(temperature_K, float)
        if len(self.quadrature.members) == 1:
            return np.ones_like(given_K)
        spline = self.quadrature.shares
        spline_of_node = scipy.interpolate.CubicSpline.construct_fast(
            spline.c[..., self.number], spline.x
        )
        with np.errstate(divide="ignore"):
            place = np.log(np.maximum(given_K, 0.0))
        return np.asarray(spline_of_node(np.clip(place, spline.x[0], spline.x[-1])))

    def radiance(self, temperature_K: ArrayLike) -> Floats:
        """Black-body photon radiance in the node, photons s-1 m-2 sr-1, any shape."""
        total = band_radiance(temperature_K, filter_um=self.quadrature.filter_um)
        return np.asarray(total * self.share(temperature_K))

    def pane(self, window: Window) -> Pane:
        """The window's mean transmission and reflection in the node."""
        return mean_pane(window, self.quadrature.middles_um, self._light)
