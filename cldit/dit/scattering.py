"""DIT that knows about scattering: the temperature of what emits, without the walls' light.

A pixel of emissivity epsilon = 1 - w_bg shows, whatever the background,

    epsilon B(T_app) = w_wall B(T_wall) + E_vapour + E_liquid,

so that the apparent temperature mixes what the spray emits with what its droplets scatter of the
walls. With omega = w_wall / epsilon, the scattered part of what is taken from the background, and
because all weights add up to 1, the medium that emits has the temperature

    B(T_medium) = (B(T_app) - omega B(T_wall)) / (1 - omega).

omega comes from a trace of a model of the spray (`wall_share`), in which the amount of fuel nearly
cancels; or, without any model, from the same spray before two wall temperatures
(`measured_share`), B(T_app) being linear in B(T_wall):

    omega = (B(T_app 1) - B(T_app 2)) / (B(T_wall 1) - B(T_wall 2)).

Of the medium, vapour and droplets are told apart by a model alone (`droplet_radiance`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError
from cldit.radiance.weights import Weights

Floats = NDArray[np.float64]

LEAST_OWN = 0.1  # of epsilon: where less than this is the medium's own light, nothing is said


@dataclass(frozen=True)
class Medium:
    """(H, W) each, NaN where nothing is said.

    temperature_K, standard_error_K: of what emits; the error is that of T_app and of a measured
    share, not that of a model. share: omega. share_error: its standard error, 0 from a model.
    """

    temperature_K: Floats
    standard_error_K: Floats
    share: Floats
    share_error: Floats


def wall_share(spray: Weights, reference: Weights) -> Floats:
    """omega (H, W) of a trace: wall's light gained over background's light lost.

    Raises:
        EvaluationError: the enclosure has patches of their own temperature.
    """
    if spray.patches:
        raise EvaluationError(
            f"model: has patches ({', '.join(spray.patches)}); the scattered share is that of "
            "walls at one temperature"
        )
    lost = reference.background.astype(float) - spray.background
    gained = spray.wall.astype(float) - reference.wall
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(lost > 0.0, np.clip(gained / lost, 0.0, 1.0), np.nan)


def medium_temperature(
    maps: Maps,
    share: Floats,
    *,
    wall_temperature_K: float,
    curve: Curve,
    share_error: Floats | None = None,
) -> Medium:
    """The temperature of what emits, from apparent temperatures and omega.

    Raises:
        EvaluationError: maps and shares differ in shape.
    """
    if share.shape != maps.emissivity.shape:
        raise EvaluationError(
            f"model: {share.shape} pixels, the maps have {maps.emissivity.shape}; trace the model "
            "with the camera of the measurement"
        )
    apparent_K = maps.apparent_temperature_K.astype(float)
    radiance = curve.radiance(apparent_K)
    error = curve.slope(apparent_K) * maps.apparent_temperature_standard_error_K
    wall = float(curve.radiance(wall_temperature_K))
    uncertain = np.zeros_like(share) if share_error is None else share_error
    own = 1.0 - share
    with np.errstate(divide="ignore", invalid="ignore"):
        medium = (radiance - share * wall) / own
        variance = (error / own) ** 2 + ((medium - wall) / own * uncertain) ** 2
    medium = np.where((own >= LEAST_OWN) & (medium > 0.0), medium, np.nan)
    kelvin = curve.temperature(medium)
    return Medium(
        temperature_K=kelvin,
        standard_error_K=np.sqrt(variance) * curve.temperature_slope(medium),
        share=share,
        share_error=np.broadcast_to(uncertain, share.shape),
    )


def measured_share(
    first: Maps, second: Maps, *, wall_temperatures_K: tuple[float, float], curve: Curve
) -> tuple[Floats, Floats]:
    """omega (H, W) and its standard error from one spray before two wall temperatures.

    Raises:
        EvaluationError: the walls are equal.
    """
    walls = curve.radiance(np.array(wall_temperatures_K))
    if not abs(walls[0] - walls[1]) > 1e-6 * float(np.max(walls)):
        raise EvaluationError(
            f"walls: {wall_temperatures_K[0]:g} and {wall_temperatures_K[1]:g} K do not differ; "
            "the scattered share needs two wall temperatures"
        )
    radiance, variance = [], []
    for maps in (first, second):
        kelvin = maps.apparent_temperature_K.astype(float)
        radiance.append(curve.radiance(kelvin))
        error = curve.slope(kelvin) * maps.apparent_temperature_standard_error_K
        variance.append(error**2)
    apart = float(walls[0] - walls[1])
    share = (radiance[0] - radiance[1]) / apart
    return np.asarray(share), np.asarray(np.sqrt(variance[0] + variance[1]) / abs(apart))


def medium_of_two_walls(
    first: Maps, second: Maps, *, wall_temperatures_K: tuple[float, float], curve: Curve
) -> Medium:
    """The medium's temperature without a model.

    It is where the line of B(T_app) over B(T_wall) meets the diagonal: walls as warm as the medium
    change nothing. Errors of both maps go through that line with their correlation.
    """
    share, share_error = measured_share(
        first, second, wall_temperatures_K=wall_temperatures_K, curve=curve
    )
    walls = curve.radiance(np.array(wall_temperatures_K))
    kelvin = [maps.apparent_temperature_K.astype(float) for maps in (first, second)]
    errors = [
        curve.slope(k) * maps.apparent_temperature_standard_error_K
        for k, maps in zip(kelvin, (first, second), strict=True)
    ]
    radiance = [curve.radiance(k) for k in kelvin]
    own = 1.0 - share
    with np.errstate(divide="ignore", invalid="ignore"):
        medium = (radiance[0] - share * walls[0]) / own
        # d medium / d radiance_1 = (1 - q) / own, / d radiance_2 = q / own
        q = (walls[0] - medium) / (walls[0] - walls[1])
        variance = ((1.0 - q) * errors[0]) ** 2 + (q * errors[1]) ** 2
        spread = np.sqrt(variance) / own
    medium = np.where((own >= LEAST_OWN) & (medium > 0.0), medium, np.nan)
    return Medium(
        temperature_K=curve.temperature(medium),
        standard_error_K=spread * curve.temperature_slope(medium),
        share=share,
        share_error=share_error,
    )


def droplet_radiance(
    maps: Maps,
    spray: Weights,
    liquid_share: Floats,
    *,
    wall_temperature_K: float,
    curve: Curve,
) -> Floats:
    """B of the droplets (H, W): T_app less the model's scattered walls and the model's vapour.

    Args:
        spray: the model's weights, before an unobstructed background.
        liquid_share: (H, W) weight of the droplets' emission in the model.
    """
    epsilon = 1.0 - spray.background.astype(float)
    wall = float(curve.radiance(wall_temperature_K))
    radiance = curve.radiance(maps.apparent_temperature_K.astype(float))
    with np.errstate(divide="ignore", invalid="ignore"):
        own = (epsilon * radiance - spray.wall * wall - spray.vapour) / liquid_share
    return np.where((liquid_share >= LEAST_OWN * epsilon) & (own > 0.0), own, np.nan)
