"""Spectral response of a camera: its filter and its quantum efficiency.

A filter is either the two edges of a rectangle with a response of 1, or a `Response`. All radiances
"in the filter" are integrals of photon radiance times this response. A quantum efficiency given as
one number belongs to the sensor; a tabulated one is part of the response.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.errors import SceneError
from cldit.scene.curves import check_curve
from cldit.scene.schema import Scene


@dataclass(frozen=True)
class Response:
    """Values from 0 to 1 over rising wavelengths; linear in between, 0 beyond."""

    pairs: tuple[tuple[float, float], ...]  # wavelength_um, value

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", check_curve(self.pairs, source="filter_um"))

    def at(self, wavelength_um: ArrayLike) -> Floats:
        """The response at wavelengths [um], any shape; 0 outside the table."""
        wavelength, value = np.array(self.pairs).T
        return np.asarray(
            np.interp(np.asarray(wavelength_um, float), wavelength, value, left=0.0, right=0.0)
        )


Filter = tuple[float, float] | Response


def edges_um(filter_um: Filter) -> tuple[float, float]:
    """The lowest and highest wavelength of the filter."""
    if isinstance(filter_um, Response):
        values = [value for _, value in filter_um.pairs]
        transparent = np.flatnonzero(values)
        begin, end = max(int(transparent[0]) - 1, 0), min(int(transparent[-1]) + 1, len(values) - 1)
        return filter_um.pairs[begin][0], filter_um.pairs[end][0]
    low, high = filter_um
    if not 0.0 < low < high < np.inf:
        raise SceneError(
            f"filter_um: {low:g} to {high:g} is no filter; allowed: a lower and a higher "
            "wavelength, both above 0"
        )
    return low, high


def cut(filter_um: Filter, low_um: float, high_um: float) -> tuple[tuple[float, float], ...]:
    """Pairs (wavelength [um], value) of a response between two wavelengths, both included."""
    if not isinstance(filter_um, Response):
        return ((low_um, 1.0), (high_um, 1.0))
    inside = [pair for pair in filter_um.pairs if low_um < pair[0] < high_um]
    at_low, at_high = filter_um.at([low_um, high_um])
    return ((low_um, float(at_low)), *inside, (high_um, float(at_high)))


def values_at(filter_um: Filter, wavelength_um: ArrayLike) -> Floats:
    """The response of `filter_um` at `wavelength_um`, any shape; 0 outside the filter."""
    if isinstance(filter_um, Response):
        return filter_um.at(wavelength_um)
    wavelength = np.asarray(wavelength_um, float)
    low, high = filter_um
    return np.where((wavelength >= low) & (wavelength <= high), 1.0, 0.0)


def scene_filter(scene: Scene) -> Filter:
    """The response of the scene's camera."""
    response = from_plain(scene.optics.filter_um)
    efficiency = scene.camera.sensor.quantum_efficiency
    return response if isinstance(efficiency, float) else product(response, Response(efficiency))


def product(filter_um: Filter, factor: Response) -> Response:
    """`filter_um` times the response `factor`, with 8 linear pieces in each common piece.

    The product of two linear pieces is a parabola; eight chords leave 1/64 of its deviation.
    """
    (low, high), (start, end) = edges_um(filter_um), edges_um(factor)
    low, high = max(low, start), min(high, end)
    if not low < high:
        raise SceneError(
            f"camera.sensor.quantum_efficiency: covers {start:g} to {end:g} um, no part of "
            "optics.filter_um; allowed: a table that covers the filter"
        )
    wavelengths = [low, high, *(wavelength for wavelength, _ in factor.pairs)]
    if isinstance(filter_um, Response):
        wavelengths += [wavelength for wavelength, _ in filter_um.pairs]
    corners = np.unique(np.clip(wavelengths, low, high))
    points = np.interp(
        np.arange(8 * (len(corners) - 1) + 1) / 8.0, np.arange(len(corners)), corners
    )
    values = values_at(filter_um, points) * factor.at(points)
    return Response(tuple(zip(points.tolist(), values.tolist(), strict=True)))


def to_plain(filter_um: Filter) -> list[float] | list[list[float]]:
    """A filter for JSON and YAML; `from_plain` reads it."""
    if isinstance(filter_um, Response):
        return [list(pair) for pair in filter_um.pairs]
    return list(filter_um)


def from_plain(data: Any) -> Filter:
    """Reads the result of `to_plain`."""
    if isinstance(data, (list, tuple)) and data and isinstance(data[0], (list, tuple)):
        return Response(tuple((float(w), float(v)) for w, v in data))
    low, high = data
    filter_um = (float(low), float(high))
    edges_um(filter_um)
    return filter_um
