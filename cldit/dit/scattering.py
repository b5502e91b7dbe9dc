"""Temperature of the emitting medium: DIT corrected for scattered light of the enclosure.

A pixel of emissivity epsilon = 1 - w_bg satisfies, for any background,

    epsilon B(T_app) = sum over parts j of the enclosure (w_j L_j) + E_vapour + E_liquid,

where the parts are the walls and the patches with their own temperatures. The apparent temperature
thus mixes emission of the spray with light of the enclosure that droplets scatter. With the
scattered shares omega_j = w_j / epsilon, and since all weights add up to 1, the emitting medium has
the temperature

    B(T_medium) = (B(T_app) - sum_j omega_j L_j) / (1 - sum_j omega_j).

The omega_j follow from a trace of a model of the spray (`scattered_by`), where the amount of fuel
nearly cancels; or without a model from the same spray in different enclosures, since B(T_app) is
linear in the L_j (`medium_of_enclosures`). Only a model can separate vapour and droplets.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats
from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights, background_radiance

LEAST_OWN = 0.1  # least share of epsilon of the medium's own light for a result
_APART = 1e-6  # relative difference of radiances from which enclosures differ: 5e-5 K at 450 K
WALL = "wall"


@dataclass(frozen=True)
class Medium:
    """Temperature of the emitting medium, (H, W) each, NaN without a result.

    standard_error_K: due to T_app and measured shares, not to a model. share: of scattered light,
    from all parts of the enclosure. share_error: its standard error, 0 from a model.
    """

    temperature_K: Floats
    standard_error_K: Floats
    share: Floats
    share_error: Floats


@dataclass(frozen=True)
class Scattered:
    """Scattered light, (H, W) each: sum of omega_j with its standard error, sum of omega_j L_j.

    For measured shares, radiance / share is exact and only the share has an error.
    """

    share: Floats
    radiance: Floats
    share_error: Floats


def enclosure(surroundings: Surroundings, curve: Curve) -> dict[str, float]:
    """Radiance L_j of each part of an enclosure by name, the walls first, then patches."""
    wall = float(curve.radiance(surroundings.wall_temperature_K))
    parts = {WALL: wall}
    for patch in surroundings.patches:
        patch_radiance = float(curve.radiance(patch.temperature_K))
        parts[patch.name] = background_radiance(
            blackbody=patch_radiance, wall=wall, emissivity=patch.emissivity
        )
    return parts


def scattered_by(spray: Weights, reference: Weights, parts: Mapping[str, float]) -> Scattered:
    """Scattered shares from a trace: gain of each part's light over loss of the background's.

    Args:
        spray, reference: weights (H, W) of the model with and without spray.
        parts: radiances of `enclosure`.

    Returns:
        Share and radiance (H, W) of the scattered light of all parts.

    Raises:
        EvaluationError: model and measurement have different patches.
    """
    modelled = {WALL, *spray.patches}
    if modelled != set(parts):
        raise EvaluationError(
            f"model: its patches are {_listed(spray.patches)}, those of the measurement "
            f"{_listed(name for name in parts if name != WALL)}; a model needs the same "
            "patches to separate their light"
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
    """Temperature of the emitting medium, from apparent temperatures and scattered light.

    Args:
        maps: (H, W) measured.
        scattered: the scattered shares, of the same shape.
        curve: temperature to radiance.

    Returns:
        Temperature [K], its standard error and the share of scattered light (H, W).

    Raises:
        EvaluationError: maps and shares differ in shape.
    """
    if scattered.share.shape != maps.emissivity.shape:
        raise EvaluationError(
            f"model: {scattered.share.shape} pixels, the maps have {maps.emissivity.shape}; trace "
            "the model with the camera of the measurement"
        )
    radiance, error = apparent(maps, curve)
    emitted = 1.0 - scattered.share
    with np.errstate(divide="ignore", invalid="ignore"):
        medium = (radiance - scattered.radiance) / emitted
        mean = np.where(scattered.share > 0.0, scattered.radiance / scattered.share, 0.0)
        variance = (error / emitted) ** 2 + ((medium - mean) / emitted * scattered.share_error) ** 2
    return _medium(
        curve,
        medium,
        error=np.sqrt(variance),
        share=scattered.share,
        share_error=scattered.share_error,
    )


def apparent(maps: Maps, curve: Curve) -> tuple[Floats, Floats]:
    """B(T_app), (H, W), and its standard error."""
    apparent_K = maps.apparent_temperature_K.astype(float)
    error_K = maps.apparent_temperature_standard_error_K
    return curve.radiance(apparent_K), curve.slope(apparent_K) * error_K


def _medium(
    curve: Curve, radiance: Floats, *, error: Floats, share: Floats, share_error: Floats
) -> Medium:
    with np.errstate(invalid="ignore"):
        resolved = (1.0 - share >= LEAST_OWN) & (radiance > 0.0)
    radiance = np.where(resolved, radiance, np.nan)
    return Medium(
        temperature_K=curve.temperature(radiance),
        standard_error_K=error * curve.temperature_slope(radiance),
        share=share,
        share_error=np.broadcast_to(share_error, share.shape),
    )


def fitted_shares(
    maps: Sequence[Maps], enclosures: Sequence[Mapping[str, float]], curve: Curve, varied: set[str]
) -> tuple[Floats, Floats, Floats, Floats]:
    """B(T_app) as a linear function of the L_j of `varied` parts: omega_j (J, H, W), the constant
    (H, W), their gradients (J + 1, K) by the K radiances, and the errors (K, H, W) of these."""
    names = [name for name in enclosures[0] if name in varied]
    leaving = np.array([[radiances[name] for name in names] for radiances in enclosures])
    scale = float(np.max(np.abs(leaving)))
    radiance, errors = (
        np.stack(images) for images in zip(*(apparent(m, curve) for m in maps), strict=True)
    )
    gradients = np.linalg.pinv(np.column_stack([leaving / scale, np.ones(len(maps))]))
    values = np.tensordot(gradients, radiance, axes=1)
    gradients = gradients / np.append(np.full(len(names), scale), 1.0)[:, None]
    return values[:-1] / scale, values[-1], gradients, errors


def varied_parts(enclosures: Sequence[Mapping[str, float]]) -> set[str]:
    """Names of the parts whose light differs between enclosures."""
    names = list(enclosures[0])
    if any(set(radiances) != set(names) for radiances in enclosures):
        raise EvaluationError(f"enclosures: not all have the parts {', '.join(names)}")
    table = np.array([[radiances[name] for name in names] for radiances in enclosures])
    threshold = _APART * np.max(np.abs(table))
    varied = [j for j in range(len(names)) if np.ptp(table[:, j]) > threshold]
    if not varied:
        listed = ", ".join(f"{name} {value:.4g}" for name, value in enclosures[0].items())
        raise EvaluationError(
            f"enclosures: do not differ (radiances {listed}); the scattered share needs two "
            "temperatures of the walls or of a patch"
        )
    chosen = table[:, varied] / np.max(np.abs(table))
    if np.linalg.matrix_rank(chosen - chosen.mean(axis=0), tol=_APART) < len(varied):
        raise EvaluationError(
            f"enclosures: {len(enclosures)} do not separate {', '.join(names[j] for j in varied)}; "
            "vary each alone once, and measure once more than there are parts"
        )
    return {names[j] for j in varied}


def medium_of_enclosures(
    maps: Sequence[Maps], enclosures: Sequence[Mapping[str, float]], curve: Curve
) -> Medium:
    """Temperature of the medium without a model, from maps of one spray in different enclosures.

    With walls alone it is the intersection of the line B(T_app) over B(T_wall) with the diagonal:
    walls as warm as the medium have no influence. Errors of all maps propagate with correlation.
    """
    fixed = set(enclosures[0]) - varied_parts(enclosures)
    if fixed:
        raise EvaluationError(
            f"enclosures: {', '.join(sorted(fixed))} has one temperature only, so its scattered "
            "share is unknown; vary it too, or give a model"
        )
    shares, rest, gradients, errors = fitted_shares(maps, enclosures, curve, set(enclosures[0]))
    share = shares.sum(axis=0)
    of_share = gradients[:-1].sum(axis=0)
    emitted = 1.0 - share
    with np.errstate(divide="ignore", invalid="ignore"):
        medium = rest / emitted
        # d medium / d radiance_k = (d rest + medium d share) / own
        change = gradients[-1][:, None, None] + medium * of_share[:, None, None]
        error = np.sqrt(np.sum((change * errors) ** 2, axis=0)) / emitted
    share_error = np.sqrt(np.tensordot(of_share**2, errors**2, axes=1))
    return _medium(curve, medium, error=error, share=share, share_error=share_error)
