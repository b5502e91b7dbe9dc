"""Shift of the images of one background against the others.

An image that is shifted by u differs by u times its gradient. The residuals of Delta I about the
lines of all pixels at one background are therefore fitted by the gradient of its own image.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.ndimage import binary_erosion

from cldit.arrays import Floats, Mask
from cldit.dit.chance import sure
from cldit.dit.shots import AllSums
from cldit.dit.witness.finding import LIMIT_K, WORTH_K, Witness

_TILES = 4  # along either axis: the scatter of 16 gives the noise of the shift to 18 %
_WORTH_PIXELS = 0.1
_COMPARED = "images against the gradient of each"


def shift(
    sums: AllSums,
    setpoints: Sequence[float],
    *,
    sees: Mask,
    source: Floats,
    counts_per_kelvin: Floats,
) -> tuple[Witness, Floats | None]:
    """Witness of a background at which the spray is shifted, and its variances (K, h, w), counts^2.

    Args:
        sums, setpoints: sums by set point and kind, and the K set points.
        sees: (h, w) pixels that see the background.
        source, counts_per_kelvin: (K,) radiance of the backgrounds, and counts per kelvin.
    """
    count = len(setpoints)
    lacking = partial(Witness, name="shift", compared=_COMPARED)
    if count < 3 or min(sees.shape) < 3 * _TILES:
        return lacking(says="too few backgrounds or pixels"), None
    inner = binary_erosion(sees)  # pixels with four neighbours that see the background
    if not inner.any():
        return lacking(says="too few pixels see the background"), None
    delta = np.array([sums[k, "injection"].mean() - sums[k, "reference"].mean() for k in setpoints])
    design = np.stack([source / source.max(), np.ones(count)], axis=1) / counts_per_kelvin[:, None]
    keep = np.eye(count) - design @ np.linalg.pinv(design)  # residuals about the lines
    residuals = np.einsum("kl,lhw->khw", keep, delta / counts_per_kelvin[:, None, None])
    moved, noise, gained = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros(count)
    for k in range(count):
        slope = np.array(np.gradient(delta[k])) / counts_per_kelvin[k]
        moved[k], noise[k], gained[k] = _fit(slope, residuals[k] / keep[k, k], inner)
        gained[k] *= keep[k, k]
    wander, degrees = _wander(sums, setpoints, keep=keep, counts_per_kelvin=counts_per_kelvin)
    noise = np.hypot(noise, wander)
    at = int(np.argmax(gained))
    kelvin, noise_K = (
        np.array([_rms(_moved(delta[k], by[k])[inner]) for k in range(count)]) / counts_per_kelvin
        for by in (moved, noise)
    )
    beyond = np.any(np.abs(moved[at]) > sure(degrees) * noise[at])
    stands_out = bool(beyond and np.hypot(*moved[at]) > _WORTH_PIXELS and kelvin[at] > WORTH_K)
    message, variances = "", None
    if stands_out:
        message = (
            f"background {setpoints[at]:g} K: the spray is shifted by {moved[at, 1]:+.1f} "
            f"columns and {moved[at, 0]:+.1f} rows"
        )
        variances = np.zeros_like(delta)
        variances[at] = _moved(delta[at], moved[at]) ** 2
    witness = Witness(
        name="shift",
        compared=_COMPARED,
        says=message,
        setpoints=tuple(setpoints),
        kelvin=tuple(kelvin.tolist()),
        noise_K=tuple(noise_K.tolist()),
        remedy=f"remove the images of background {setpoints[at]:g} K",
        stands_out=stands_out,
        severe=stands_out and float(kelvin[at]) > LIMIT_K,
    )
    return witness, variances


def _fit(slope: Floats, residuals: Floats, where: Mask) -> tuple[Floats, Floats, float]:
    """Shift (rows, columns) by least squares, its standard errors, and the explained squares.

    The errors are a jackknife over tiles, since residuals are correlated if the spray differs
    between shots.
    """
    rows, columns = (np.arange(size) * _TILES // size for size in where.shape)
    tile = (rows[:, None] * _TILES + columns)[where]
    g, y = slope[:, where], residuals[where]
    inner = np.array(
        [[np.bincount(tile, g[i] * g[j], minlength=_TILES**2) for j in range(2)] for i in range(2)]
    )
    right = np.array([-np.bincount(tile, g[i] * y, minlength=_TILES**2) for i in range(2)])
    normal, side = inner.sum(axis=2), right.sum(axis=1)
    u = np.linalg.pinv(normal, hermitian=True) @ side
    without = np.array(
        [
            np.linalg.pinv(normal - inner[:, :, i], hermitian=True) @ (side - right[:, i])
            for i in range(_TILES**2)
        ]
    )
    share = (_TILES**2 - 1) / _TILES**2
    noise = np.sqrt(share * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    return u, noise, float(u @ side)


def _wander(
    sums: AllSums, setpoints: Sequence[float], *, keep: Floats, counts_per_kelvin: Floats
) -> tuple[Floats, int]:
    """Standard errors (K, 2) of the shift due to scatter of the shots, and degrees of freedom.

    Deviations of shots from the mean of their background are fitted by the gradient of every
    background's mean, in blocks, like the residuals about the lines, which `keep` (K, K) projects.
    """
    groups = [sums[setpoint, "injection"] for setpoint in setpoints]
    small = [np.array(group.thumbnails, float) for group in groups]
    block = np.array(groups[0].total.shape) / np.array(small[0].shape[1:])
    deviations = [
        (thumbnails - thumbnails.mean(axis=0)).reshape(len(thumbnails), -1) / scale
        for thumbnails, scale in zip(small, counts_per_kelvin, strict=True)
    ]
    spare = np.array([len(thumbnails) - 1.0 for thumbnails in small])
    errors = np.zeros((len(setpoints), 2))
    if min(small[0].shape[1:]) < 2:
        return errors, 0
    for k, setpoint in enumerate(setpoints):
        bare = np.mean(sums[setpoint, "reference"].thumbnails, axis=0)
        mean = (small[k].mean(axis=0) - bare) / counts_per_kelvin[k]
        g = np.array(np.gradient(mean)).reshape(2, -1) / block[:, None]
        to_shift = np.linalg.pinv(g @ g.T, hermitian=True) @ g
        # (K, 2): variance of a shift due to one shot at each background
        shot_variance = np.array(
            [
                np.sum((deviation @ to_shift.T) ** 2, axis=0) / max(degrees, 1.0)
                for deviation, degrees in zip(deviations, spare, strict=True)
            ]
        )
        shot_variance = np.maximum(shot_variance, spare @ shot_variance / max(spare.sum(), 1.0))
        share = (keep[k] / keep[k, k]) ** 2 / (spare + 1.0)
        errors[k] = np.sqrt(share @ shot_variance)
    return errors, int(spare.sum())


def _moved(delta: Floats, by: Floats) -> Floats:
    """Change (h, w) of an image that is shifted by so many rows and columns, to first order."""
    rows, columns = np.gradient(delta)
    with np.errstate(invalid="ignore"):
        return np.asarray(by[0] * rows + by[1] * columns)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
