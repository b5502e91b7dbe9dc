"""Item of a page: plain data, and arrays by name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.optics.planck import (
    band_radiance,
    band_radiance_slope,
    temperature_of_radiance,
    temperature_slope_of_radiance,
)
from cldit.optics.response import Filter

_KNOTS_K = np.geomspace(6.5, 6000.0, 2048)  # colder, the radiance at 3.4 um leaves float64
_INVERSE = 4096  # steps of 0.16 in ln B: cubic Hermite, 5e-9 of T


@dataclass(frozen=True)
class Item:
    """A run or a measurement on a page.

    head: plain data for JSON; its kind is `run`, whose maps the page computes, or `measurement`,
    whose maps are given. arrays: of any shape, by name.
    """

    head: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]


def place_of(
    shape: Sequence[int], pixel_m: tuple[float, float], centre_m: tuple[float, float]
) -> dict[str, Any]:
    """Position of an image for the head of an item: rows, columns, pixel size and centre in mm."""
    return {
        "rows": int(shape[0]),
        "columns": int(shape[1]),
        "pixel_mm": [1e3 * edge for edge in pixel_m],
        "centre_mm": [1e3 * coordinate for coordinate in centre_m],
    }


@lru_cache(maxsize=8)
def planck_tables(filter_um: Filter) -> Mapping[str, NDArray[np.float64]]:
    """Black-body radiance in a filter and its inverse, for cubic Hermite interpolation.

    Values and slopes (2, N) at even steps between the `planck_ends`: `planck` has ln B over ln T,
    `inverse` T over ln B.
    """
    _, log_B, power = _curve(filter_um)
    knots = np.linspace(log_B[0], log_B[-1], _INVERSE)
    radiance = np.exp(knots)
    kelvin = temperature_of_radiance(radiance, filter_um=filter_um)
    slope = radiance * temperature_slope_of_radiance(radiance, filter_um=filter_um)
    return {"planck": np.stack([log_B, power]), "inverse": np.stack([kelvin, slope])}


def planck_ends(filter_um: Filter) -> dict[str, list[float]]:
    """First and last abscissa of each of the `planck_tables`."""
    log_T, log_B, _ = _curve(filter_um)
    return {
        "planck": [float(log_T[0]), float(log_T[-1])],
        "inverse": [float(log_B[0]), float(log_B[-1])],
    }


@lru_cache(maxsize=8)
def _curve(
    filter_um: Filter,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """ln T, ln B and d ln B / d ln T."""
    radiance = band_radiance(_KNOTS_K, filter_um=filter_um)
    slope = band_radiance_slope(_KNOTS_K, filter_um=filter_um)
    return np.log(_KNOTS_K), np.log(radiance), _KNOTS_K * slope / radiance
