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
from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError
from cldit.io.images import write_maps
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights, background_radiance

LEAST_OWN = 0.1  # least share of epsilon of the medium's own light for a result
_APART = 1e-6  # relative difference of radiances from which enclosures differ: 5e-5 K at 450 K
WALL = "wall"
MEDIUM = ("medium_temperature_K", "medium_temperature_standard_error_K", "scattered_share")


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

    def save(self, folder: Path, *, pixel_m: tuple[float, float]) -> None:
        """Writes the maps `MEDIUM` into `folder`, with pixels of `pixel_m`."""
        images = (self.temperature_K, "K"), (self.standard_error_K, "K"), (self.share, "1")
        write_maps(folder, dict(zip(MEDIUM, images, strict=True)), pixel_m=pixel_m)


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


def scattered_by(
    spray: Weights, reference: Weights, parts: Mapping[str, float]
) -> tuple[Floats, Floats]:
    """Scattered shares from a trace: gain of each part's light over loss of the background's.

    Args:
        spray, reference: weights (H, W) of the model with and without spray.
        parts: radiances of `enclosure`.

    Returns:
        Share and radiance (H, W) of the scattered light of all parts: sums of omega_j and of
        omega_j L_j.

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
        return (
            np.where(lost > 0.0, share / lost, np.nan),
            np.where(lost > 0.0, radiance / lost, np.nan),
        )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def medium_temperature(maps: Maps, scattered: tuple[Floats, Floats], curve: Curve) -> Medium:
    """Temperature of the emitting medium, from apparent temperatures and scattered light.

    Args:
        maps: (H, W) measured.
        scattered: share and radiance of `scattered_by`, of the same shape.
        curve: temperature to radiance.

    Returns:
        Temperature [K], its standard error and the share of scattered light (H, W).

    Raises:
        EvaluationError: maps and shares differ in shape.
    """
    share, light = scattered
    if share.shape != maps.emissivity.shape:
        raise EvaluationError(
            f"model: {share.shape} pixels, the maps have {maps.emissivity.shape}; trace the model "
            "with the camera of the measurement"
        )
    radiance, error = apparent(maps, curve)
    with np.errstate(divide="ignore", invalid="ignore"):
        medium, error = (radiance - light) / (1.0 - share), error / (1.0 - share)
    return _medium(curve, medium, error=error, share=share, share_error=np.zeros(1))


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


def _leaving(enclosures: Sequence[Mapping[str, float]]) -> Floats:
    """Radiances (K, J) of the J parts of K enclosures, of which each part varies; raises
    EvaluationError if their shares cannot be separated."""
    names = list(enclosures[0])
    if any(set(radiances) != set(names) for radiances in enclosures):
        raise EvaluationError(f"enclosures: not all have the parts {', '.join(names)}")
    table = np.array([[radiances[name] for name in names] for radiances in enclosures])
    scale = np.max(np.abs(table))
    varied = [name for name, column in zip(names, table.T, strict=True)
              if np.ptp(column) > _APART * scale]  # fmt: skip
    if not varied:
        listed = ", ".join(f"{name} {value:.4g}" for name, value in enclosures[0].items())
        raise EvaluationError(
            f"enclosures: do not differ (radiances {listed}); the scattered share needs two "
            "temperatures of the walls or of a patch"
        )
    chosen = table[:, [name in varied for name in names]] / scale
    if np.linalg.matrix_rank(chosen - chosen.mean(axis=0), tol=_APART) < len(varied):
        raise EvaluationError(
            f"enclosures: {len(enclosures)} do not separate {', '.join(varied)}; "
            "vary each alone once, and measure once more than there are parts"
        )
    if fixed := set(names) - set(varied):
        raise EvaluationError(
            f"enclosures: {', '.join(sorted(fixed))} has one temperature only, so its scattered "
            "share is unknown; vary it too, or give a model"
        )
    return table


def medium_of_enclosures(
    maps: Sequence[Maps], enclosures: Sequence[Mapping[str, float]], curve: Curve
) -> Medium:
    """Temperature of the medium without a model, from maps of one spray in different enclosures.

    With walls alone it is the intersection of the line B(T_app) over B(T_wall) with the diagonal:
    walls as warm as the medium have no influence. Errors of all maps propagate with correlation.
    """
    leaving = _leaving(enclosures)
    scale = float(np.max(np.abs(leaving)))
    radiance, errors = (
        np.stack(images) for images in zip(*(apparent(m, curve) for m in maps), strict=True)
    )
    # B(T_app) is linear in the L_j: omega_j, and the constant
    gradients = np.linalg.pinv(np.column_stack([leaving / scale, np.ones(len(maps))]))
    values = np.tensordot(gradients, radiance, axes=1)
    gradients = gradients / np.append(np.full(leaving.shape[1], scale), 1.0)[:, None]
    shares, rest = values[:-1] / scale, values[-1]
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
