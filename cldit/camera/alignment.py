"""View of one image in another: scale, rotation, shift and mirror, found from the images.

A pixel at o from the centre of the fixed image shows what the moved image has at

    i = R(-a) (o - t) / s        a: rotation, counterclockwise; t: shift; s: scale

with the first coordinate reversed if it is mirrored. The start is the maximum of the phase
correlation (Kuglin and Hines 1975); least squares over a, t and s follow, first of blurred images.
Their covariance is that of the Jacobian with the squares of the residuals and their correlation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import affine_transform, gaussian_filter
from scipy.optimize import least_squares

from cldit.arrays import Floats
from cldit.camera.correlation import correlation
from cldit.errors import EvaluationError

_BLURS_px = (4.0, 1.5, 0.0)  # standard deviations in turn: a wide minimum first, then the exact one
_STEP = 1e-3  # of a derivative, in pixels at the edge of the image
_ALIKE = 0.5  # least correlation of the two emissivities
_LEAST_EMISSIVITY = 0.02  # mean over the image, without which there is nothing to align


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """View of the moved image in the fixed one.

    values: (4,) scale less 1, rotation [rad], shift along columns and rows [pixels, downwards];
    covariance: (4, 4) of them.
    """

    values: Floats
    covariance: Floats
    mirrored: bool = False

    @property
    def errors(self) -> Floats:
        """Standard errors (4,) of the values."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def text(self) -> str:
        """Scale, rotation and shift with their errors, on one line."""
        scale, turn, right, down = (
            f"{value:+.3f} ± {error:.3f}"
            for value, error in zip(
                self.values * (100.0, np.degrees(1.0), 1.0, 1.0),
                self.errors * (100.0, np.degrees(1.0), 1.0, 1.0),
                strict=True,
            )
        )
        mirror = "mirrored, " if self.mirrored else ""
        return f"{mirror}scale {scale} %, rotation {turn}°, shift {right} and {down} pixels"

    def moved(self, image: NDArray[np.floating], *, order: Literal[1, 3] = 1) -> Floats:
        """The moved image (H, W) on the pixels of the fixed one; NaN beyond its edge."""
        scale, turn, right, down = self.values
        cos, sin = np.cos(turn) / (1.0 + scale), np.sin(turn) / (1.0 + scale)
        flip = -1.0 if self.mirrored else 1.0
        matrix = np.array([[cos, sin], [-sin * flip, cos * flip]])  # rows run downwards
        centre = (np.array(image.shape) - 1.0) / 2.0
        offset = centre - matrix @ (centre + np.array([down, right]))
        return np.asarray(
            affine_transform(
                np.asarray(image, float), matrix, offset, order=order, cval=np.nan, mode="constant"
            )
        )

    def deviations(self) -> Iterator[Alignment]:
        """Alignments that are one standard deviation off along each axis of the covariance."""
        size, axes = np.linalg.eigh(self.covariance)
        for square, axis in zip(size, axes.T, strict=True):
            yield replace(self, values=self.values + np.sqrt(max(square, 0.0)) * axis)


def align(fixed: Floats, moving: Floats) -> Alignment:
    """View of `moving` in `fixed`, both (H, W) and finite; raises EvaluationError without one."""
    if min(float(fixed.mean()), float(moving.mean())) < _LEAST_EMISSIVITY:
        raise EvaluationError(
            "align: images: less than 2 % of the background is hidden by the spray; "
            "allowed: metadata"
        )
    views = [_aligned(fixed, moving, mirrored=mirrored) for mirrored in (False, True)]
    best, alike = max(views, key=lambda view: view[1])
    if alike < _ALIKE:
        raise EvaluationError(
            f"align: images: the two do not look alike (correlation {alike:.2f}); allowed: metadata"
        )
    return best


def _aligned(fixed: Floats, moving: Floats, *, mirrored: bool) -> tuple[Alignment, float]:
    shown = moving[:, ::-1] if mirrored else moving
    down, right = _shift(fixed, shown)
    edge = float(max(fixed.shape))
    unit = np.array([2.0 / edge, 2.0 / edge, 1.0, 1.0])
    none = np.zeros((4, 4))
    values = np.array([0.0, 0.0, right, down])
    for blur_px in _BLURS_px:
        still, shifted = (gaussian_filter(image, blur_px) for image in (fixed, moving))

        def residuals(x: Floats, still: Floats = still, shifted: Floats = shifted) -> Floats:
            view = Alignment(values=x * unit, covariance=none, mirrored=mirrored)
            seen = view.moved(shifted, order=3)
            return np.asarray(np.where(np.isfinite(seen), seen - still, 0.0).ravel())

        solved = least_squares(residuals, values / unit, diff_step=np.full(4, _STEP))
        values = solved.x * unit
    residual = solved.fun
    jacobian = np.asarray(solved.jac, float)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    weighed = inverse @ (jacobian * residual[:, None]).T  # White 1980: residuals differ in size
    size = float(np.sqrt(np.mean(residual**2)))
    alike_nearby = correlation((residual / size).reshape(fixed.shape))[1] if size > 0.0 else 1.0
    covariance = alike_nearby * (weighed @ weighed.T) * unit[:, None] * unit
    view = Alignment(values=values, covariance=covariance, mirrored=mirrored)
    seen = view.moved(moving)
    common = np.isfinite(seen)
    alike = float(np.corrcoef(seen[common], fixed[common])[0, 1]) if common.any() else 0.0
    return view, alike if np.isfinite(alike) else 0.0


def _shift(fixed: Floats, moving: Floats) -> tuple[float, float]:
    """Whole pixels, downwards and to the right, at the maximum of the phase correlation."""
    product = np.fft.rfft2(gaussian_filter(fixed, 1.0)) * np.conj(
        np.fft.rfft2(gaussian_filter(moving, 1.0))
    )
    size = np.abs(product)
    peak = np.fft.irfft2(product / np.maximum(size, 1e-6 * size.max()), fixed.shape)
    down, right = np.unravel_index(
        int(np.argmax(gaussian_filter(peak, 2.0, mode="wrap"))), peak.shape
    )
    rows, columns = fixed.shape
    return float((down + rows // 2) % rows - rows // 2), float(
        (right + columns // 2) % columns - columns // 2
    )
