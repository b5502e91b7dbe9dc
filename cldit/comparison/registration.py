"""Two results in one view, found from their emissivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.arrays import Floats
from cldit.camera.alignment import Alignment, align
from cldit.comparison.shown import Shown
from cldit.dit.maps import Maps


def aligned(baseline: Shown, compared: Shown) -> tuple[Shown, Shown, Alignment, list[Floats]]:
    """Both in one view, found from their emissivities; the one without noise is moved.

    The last are changes (H, W) of other minus one by one standard deviation of the alignment.
    """
    swap = compared.noisy and not baseline.noisy
    fixed, moving = (compared, baseline) if swap else (baseline, compared)
    images = [np.nan_to_num(shown.maps.emissivity.astype(float)) for shown in (fixed, moving)]
    view = align(images[0], images[1])
    t_app = moving.maps.apparent_temperature_K
    moved = _moved(moving, view)
    sign = -1.0 if swap else 1.0
    changes = [
        sign * np.nan_to_num(one_off.moved(t_app) - moved.maps.apparent_temperature_K)
        for one_off in view.deviations()
    ]
    return (moved, fixed, view, changes) if swap else (fixed, moved, view, changes)


def _moved(shown: Shown, view: Alignment) -> Shown:
    """A result in another view; linear between its pixels."""
    images = {
        name: view.moved(image).astype(np.float32)
        for name, image in vars(shown.maps).items()
        if name != "reason"
    }
    reason = np.where(np.isfinite(images["apparent_temperature_K"]), 0, shown.maps.reason)
    error_K = None if shown.error_map_K is None else view.moved(shown.error_map_K)
    maps = Maps(**images, reason=reason.astype(np.uint8))
    common, systematic = (
        tuple(
            replace(part, kelvin=view.moved(part.kelvin), emissivity=view.moved(part.emissivity))
            for part in parts
        )
        for parts in (shown.common, shown.systematic)
    )
    return replace(
        shown, maps=maps, error_map_K=error_K, common=common, systematic=systematic, run=None
    )
