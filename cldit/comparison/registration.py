"""Two results in one view, found from their emissivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.arrays import Floats
from cldit.camera.alignment import Alignment, align
from cldit.comparison.shown import Shown
from cldit.dit.maps import Maps


def aligned(
    baseline: Shown, compared: Shown
) -> tuple[Shown, Shown, Alignment, list[tuple[Floats, Floats]]]:
    """Both in one view, found from their emissivities; the one without noise is moved.

    The last are changes (H, W) of other minus one by one standard deviation of the alignment, of
    T_app and of the emissivity.
    """
    swap = compared.noisy and not baseline.noisy
    fixed, moving = (compared, baseline) if swap else (baseline, compared)
    images = [np.nan_to_num(shown.maps.emissivity.astype(float)) for shown in (fixed, moving)]
    view = align(images[0], images[1])
    moved = _moved(moving, view)
    sign = -1.0 if swap else 1.0

    def change(one_off: Alignment, name: str) -> Floats:
        image, moved_image = (getattr(shown.maps, name) for shown in (moving, moved))
        return np.asarray(sign * np.nan_to_num(one_off.moved(image) - moved_image))

    changes = [
        (change(one_off, "apparent_temperature_K"), change(one_off, "emissivity"))
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
    error_K, error = (
        None if image is None else view.moved(image)
        for image in (shown.error_map_K, shown.emissivity_error_map)
    )
    maps = Maps(**images, reason=reason.astype(np.uint8))
    common, systematic = (
        tuple(
            replace(part, kelvin=view.moved(part.kelvin), emissivity=view.moved(part.emissivity))
            for part in parts
        )
        for parts in (shown.common, shown.systematic)
    )
    return replace(
        shown,
        maps=maps,
        error_map_K=error_K,
        emissivity_error_map=error,
        common=common,
        systematic=systematic,
        run=None,
    )
