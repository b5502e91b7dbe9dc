"""DIT that knows about scattering: the temperature of what emits, without the enclosure's light.

A pixel of emissivity epsilon = 1 - w_bg shows, whatever the background,

    epsilon B(T_app) = sum over parts j of the enclosure (w_j L_j) + E_vapour + E_liquid,

the parts being the walls and the patches that have temperatures of their own. So the apparent
temperature mixes what the spray emits with what its droplets scatter of the enclosure. With
omega_j = w_j / epsilon, the scattered parts of what is taken from the background, and because all
weights add up to 1, the medium that emits has the temperature

    B(T_medium) = (B(T_app) - sum_j omega_j L_j) / (1 - sum_j omega_j).

The omega_j come from a trace of a model of the spray (`scattered_by`), in which the amount of fuel
nearly cancels; or, without any model, from the same spray in enclosures that differ, B(T_app) being
linear in the L_j (`medium_of_enclosures`). Of the medium, vapour and droplets are told apart by a
model alone (`droplet_radiance`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights, background_radiance

Floats = NDArray[np.float64]

LEAST_OWN = 0.1  # of epsilon: where less than this is the medium's own light, nothing is said
_APART = 1e-6  # relative difference of radiances from which enclosures differ
WALL = "wall"


@dataclass(frozen=True)
class Medium:
    """(H, W) each, NaN where nothing is said.

    temperature_K, standard_error_K: of what emits; the error is that of T_app and of measured
    shares, not that of a model. share: of the scattered light, all parts of the enclosure together.
    share_error: its standard error, 0 from a model.
    """

    temperature_K: Floats
    standard_error_K: Floats
    share: Floats
    share_error: Floats


@dataclass(frozen=True)
class Scattered:
    """(H, W) each: sum of omega_j, sum of omega_j L_j, and the standard error of the former.

    Where it comes from measured shares, radiance / share is known and the share's error is all.
    """

    share: Floats
    radiance: Floats
    share_error: Floats

    @classmethod
    def of_share(cls, share: Floats, radiance: float, error: Floats | None = None) -> Scattered:
        """An enclosure that radiates alike from everywhere.

        Args:
            share: (H, W) scattered part.
            radiance: of the enclosure.
            error: (H, W) of the share; None: exact.
        """
        none = np.zeros_like(share) if error is None else error
        return cls(share, share * radiance, none)


def enclosure(around: Surroundings, curve: Curve) -> dict[str, float]:
    """Radiance L_j, by `curve`, that leaves each part of the enclosure `around`, by name.

    The walls come first, then patches.
    """
    wall = float(curve.radiance(around.wall_temperature_K))
    parts = {WALL: wall}
    for patch in around.patches:
        own = float(curve.radiance(patch.temperature_K))
        parts[patch.name] = background_radiance(
            blackbody=own, wall=wall, emissivity=patch.emissivity
        )
    return parts


def scattered_by(spray: Weights, reference: Weights, parts: Mapping[str, float]) -> Scattered:
    """Scattered shares by a trace: each part's light gained over the background's light lost.

    Args:
        spray, reference: weights (H, W) of the model with and without spray.
        parts: as `enclosure` gives them.

    Raises:
        EvaluationError: model and measurement differ in the patches of their enclosures.
    """
    known = {WALL, *spray.patches}
    if known != set(parts):
        raise EvaluationError(
            f"model: its patches are {_listed(spray.patches)}, those of the measurement "
            f"{_listed(name for name in parts if name != WALL)}; their light can only be told "
            "apart by a model with the same"
        )
    lost = reference.background.astype(float) - spray.background
    bare = reference.images
    share = np.zeros(lost.shape)
    radiance = np.zeros(lost.shape)
    for name, leaving in parts.items():
        gained = spray.images[name].astype(float) - bare[name]
        share += gained
        radiance += gained * leaving
    with np.errstate(divide="ignore", invalid="ignore"):
        return Scattered(
            share=np.where(lost > 0.0, share / lost, np.nan),
            radiance=np.where(lost > 0.0, radiance / lost, np.nan),
            share_error=np.zeros(lost.shape),
        )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def medium_temperature(maps: Maps, scattered: Scattered, curve: Curve) -> Medium:
    """The temperature of what emits, from apparent temperatures and what is scattered.

    Args:
        maps: (H, W) measured.
        scattered: the scattered shares, of the same shape.
        curve: temperature to radiance.

    Raises:
        EvaluationError: maps and shares differ in shape.
    """
    if scattered.share.shape != maps.emissivity.shape:
        raise EvaluationError(
            f"model: {scattered.share.shape} pixels, the maps have {maps.emissivity.shape}; trace "
            "the model with the camera of the measurement"
        )
    radiance, error = apparent(maps, curve)
    own = 1.0 - scattered.share
    with np.errstate(divide="ignore", invalid="ignore"):
        medium = (radiance - scattered.radiance) / own
        mean = np.where(scattered.share > 0.0, scattered.radiance / scattered.share, 0.0)
        variance = (error / own) ** 2 + ((medium - mean) / own * scattered.share_error) ** 2
    return _medium(
        curve,
        medium,
        error=np.sqrt(variance),
        share=scattered.share,
        share_error=scattered.share_error,
    )


def apparent(maps: Maps, curve: Curve) -> tuple[Floats, Floats]:
    """B(T_app) of `maps` by `curve`, (H, W), and its standard error."""
    apparent_K = maps.apparent_temperature_K.astype(float)
    error_K = maps.apparent_temperature_standard_error_K
    return curve.radiance(apparent_K), curve.slope(apparent_K) * error_K


def _medium(
    curve: Curve, radiance: Floats, *, error: Floats, share: Floats, share_error: Floats
) -> Medium:
    with np.errstate(invalid="ignore"):
        said = (1.0 - share >= LEAST_OWN) & (radiance > 0.0)
    radiance = np.where(said, radiance, np.nan)
    return Medium(
        temperature_K=curve.temperature(radiance),
        standard_error_K=error * curve.temperature_slope(radiance),
        share=share,
        share_error=np.broadcast_to(share_error, share.shape),
    )


@dataclass(frozen=True)
class _Line:
    """B(T_app) over the L_j of enclosures: omega_j (J, H, W), what does not change (H, W), their
    gradients (J + 1, K) with respect to the K radiances, and the errors (K, H, W) of those."""

    shares: Floats
    rest: Floats
    gradients: Floats
    errors: Floats


def _line(
    maps: Sequence[Maps], enclosures: Sequence[Mapping[str, float]], curve: Curve, varied: set[str]
) -> _Line:
    names = [name for name in enclosures[0] if name in varied]
    leaving = np.array([[one[name] for name in names] for one in enclosures])
    scale = float(np.max(np.abs(leaving)))
    design = np.column_stack([leaving / scale, np.ones(len(maps))])
    radiance, error = (
        np.stack(each) for each in zip(*(apparent(m, curve) for m in maps), strict=True)
    )
    gradients = np.linalg.pinv(design)
    values = np.tensordot(gradients, radiance, axes=1)
    gradients = gradients / np.append(np.full(len(names), scale), 1.0)[:, None]
    return _Line(values[:-1] / scale, values[-1], gradients, error)


def varied_parts(enclosures: Sequence[Mapping[str, float]]) -> set[str]:
    """Names of the parts whose light differs between enclosures.

    Raises:
        EvaluationError: none does, they have different parts, or the parts that differ cannot be
            told from each other: one enclosure more than there are such parts, each varied by
            itself at least once.
    """
    names = list(enclosures[0])
    if any(set(one) != set(names) for one in enclosures):
        raise EvaluationError(f"enclosures: not all have the parts {', '.join(names)}")
    table = np.array([[one[name] for name in names] for one in enclosures])
    least = _APART * np.max(np.abs(table))
    varied = [j for j in range(len(names)) if np.ptp(table[:, j]) > least]
    if not varied:
        told = ", ".join(f"{name} {value:.4g}" for name, value in enclosures[0].items())
        raise EvaluationError(
            f"enclosures: do not differ (radiances {told}); the scattered share needs two "
            "temperatures of the walls or of a patch"
        )
    chosen = table[:, varied] / np.max(np.abs(table))
    if np.linalg.matrix_rank(chosen - chosen.mean(axis=0), tol=_APART) < len(varied):
        raise EvaluationError(
            f"enclosures: {len(enclosures)} do not tell {', '.join(names[j] for j in varied)} "
            "apart; vary each by itself once, and measure once more than there are parts"
        )
    return {names[j] for j in varied}


def measured_share(
    maps: Sequence[Maps], enclosures: Sequence[Mapping[str, float]], curve: Curve, *, part: str
) -> tuple[Floats, Floats]:
    """omega (H, W) of one part and its standard error, from one spray in enclosures that differ.

    Args:
        maps: (H, W) each, of the same spray.
        enclosures: of each, `enclosure`.
        curve: temperature to radiance.
        part: the part of the enclosure that is meant.

    Returns:
        omega (H, W), and its standard error.

    Raises:
        EvaluationError: as `varied_parts`, or this part does not differ.
    """
    varied = varied_parts(enclosures)
    if part not in varied:
        raise EvaluationError(f"enclosures: the light of {part} does not differ")
    line = _line(maps, enclosures, curve, varied)
    at = [name for name in enclosures[0] if name in varied].index(part)
    error = np.sqrt(np.tensordot(line.gradients[at] ** 2, line.errors**2, axes=1))
    return line.shares[at], error


def medium_of_enclosures(
    maps: Sequence[Maps], enclosures: Sequence[Mapping[str, float]], curve: Curve
) -> Medium:
    """The medium's temperature without a model, from one spray in enclosures that differ.

    With walls alone it is where the line of B(T_app) over B(T_wall) meets the diagonal: walls as
    warm as the medium change nothing. Errors of all maps go through with their correlation.

    Args:
        maps: (H, W) each, of the same spray.
        enclosures: of each, `enclosure`.
        curve: temperature to radiance.

    Raises:
        EvaluationError: as `varied_parts`, or a part keeps its temperature, so that nothing tells
            how much of its light is scattered.
    """
    fixed = set(enclosures[0]) - varied_parts(enclosures)
    if fixed:
        raise EvaluationError(
            f"enclosures: {', '.join(sorted(fixed))} keeps its temperature, and how much of its "
            "light the spray scatters is not known; vary it too, or give a model"
        )
    line = _line(maps, enclosures, curve, set(enclosures[0]))
    share = line.shares.sum(axis=0)
    of_share = line.gradients[:-1].sum(axis=0)
    own = 1.0 - share
    with np.errstate(divide="ignore", invalid="ignore"):
        medium = line.rest / own
        # d medium / d radiance_k = (d rest + medium d share) / own
        change = line.gradients[-1][:, None, None] + medium * of_share[:, None, None]
        error = np.sqrt(np.sum((change * line.errors) ** 2, axis=0)) / own
    share_error = np.sqrt(np.tensordot(of_share**2, line.errors**2, axes=1))
    return _medium(curve, medium, error=error, share=share, share_error=share_error)


def droplet_radiance(
    maps: Maps,
    spray: Weights,
    liquid_share: Floats,
    scattered: Scattered,
    curve: Curve,
) -> Floats:
    """B of the droplets: T_app less the model's scattered light and the model's vapour.

    Args:
        maps: (H, W) measured.
        spray: the model's weights, before an unobstructed background.
        liquid_share: (H, W) weight of the droplets' emission in the model.
        scattered: of the model, `scattered_by`.
        curve: temperature to radiance.

    Returns:
        (H, W); NaN where droplets emit too little.
    """
    epsilon = 1.0 - spray.background.astype(float)
    radiance, _ = apparent(maps, curve)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = (epsilon * (radiance - scattered.radiance) - spray.vapour) / liquid_share
    return np.where((liquid_share >= LEAST_OWN * epsilon) & (own > 0.0), own, np.nan)
