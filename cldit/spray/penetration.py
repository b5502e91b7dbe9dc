"""Penetration and mass of the liquid: figures of every spray."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cldit.spray.result import Parcels, Spray

SHARES_PERCENT = (90, 95, 99)


def penetrations_m(parcels: Parcels, shares: Sequence[float]) -> tuple[float, ...]:
    """Depths below the nozzle, along the axis, above which shares of the liquid mass are.

    The ECN uses the share 0.95, others 0.90 or 0.99. The parcels must have some mass.
    """
    depth, mass = -parcels.position_m[:, 2], parcels.masses_kg
    # Size classes that share a box are consecutive, so the sort has each box once.
    starts = np.append(0, np.flatnonzero(depth[1:] != depth[:-1]) + 1)
    depth, mass = depth[starts], np.add.reduceat(mass, starts)
    order = np.argsort(depth)
    reached = np.cumsum(mass[order])
    entries = [int(np.argmax(reached >= share * reached[-1])) for share in shares]
    return tuple(float(depth[order[entry]]) for entry in entries)


def liquid_figures(parcels: Parcels, stated: Mapping[str, float] | None = None) -> dict[str, float]:
    """Figures of a spray's liquid by name: mass, Sauter mean diameter, penetrations.

    The shares are `SHARES_PERCENT`; figures in `stated` are omitted.
    """
    stated = stated or {}
    figures = {} if "liquid_mass_kg" in stated else {"liquid_mass_kg": parcels.mass_kg}
    if not {**figures, **stated}["liquid_mass_kg"] > 0.0:
        return figures
    if "sauter_mean_diameter_m" not in stated:
        figures["sauter_mean_diameter_m"] = parcels.sauter_mean_diameter_m
    names = {f"liquid_penetration_{percent}_m": percent / 100 for percent in SHARES_PERCENT}
    missing = {name: share for name, share in names.items() if name not in stated}
    if missing:
        depths = penetrations_m(parcels, tuple(missing.values()))
        figures |= dict(zip(missing, depths, strict=True))
    return figures


def with_figures(spray: Spray) -> Spray:
    """Spray with these figures in its notes; figures of the model are kept."""
    figures = {} if spray.parcels is None else liquid_figures(spray.parcels, spray.notes)
    if spray.vapour is not None and "vapour_mass_kg" not in spray.notes:
        figures["vapour_mass_kg"] = spray.vapour.mass_kg
    return replace(spray, notes={**spray.notes, **figures})
