"""How far liquid reaches, and how much of it there is: figures that every spray has alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cldit.spray.result import Parcels, Spray

SHARES_PERCENT = (90, 95, 99)


def penetration_m(parcels: Parcels, share: float) -> float:
    """Depth below the nozzle, along the axis, above which a share of the liquid's mass is (ECN).

    Args:
        parcels: with some mass.
        share: 0 to 1; the ECN takes 0.95, others 0.90 or 0.99.
    """
    return penetrations_m(parcels, (share,))[0]


def penetrations_m(parcels: Parcels, shares: Sequence[float]) -> tuple[float, ...]:
    """`penetration_m` of several shares, by one sort.

    Args:
        parcels: with some mass.
        shares: 0 to 1.

    Returns:
        Metres, one for each share.
    """
    depth, mass = -parcels.position_m[:, 2], parcels.masses_kg
    # Classes of size that share a box follow each other: the sort takes each box once.
    starts = np.append(0, np.flatnonzero(depth[1:] != depth[:-1]) + 1)
    depth, mass = depth[starts], np.add.reduceat(mass, starts)
    order = np.argsort(depth)
    reached = np.cumsum(mass[order])
    first = [int(np.argmax(reached >= share * reached[-1])) for share in shares]
    return tuple(float(depth[order[one]]) for one in first)


def liquid_figures(parcels: Parcels, known: Mapping[str, float] | None = None) -> dict[str, float]:
    """Notes of a spray's liquid: mass, Sauter mean diameter, penetrations by `SHARES_PERCENT`.

    Args:
        parcels: the liquid.
        known: figures that are there already, and are left out.

    Returns:
        Figures by name, SI.
    """
    known = known or {}
    figures = {} if "liquid_mass_kg" in known else {"liquid_mass_kg": parcels.mass_kg}
    if not {**figures, **known}["liquid_mass_kg"] > 0.0:
        return figures
    if "sauter_mean_diameter_m" not in known:
        figures["sauter_mean_diameter_m"] = parcels.sauter_mean_diameter_m
    names = {f"liquid_penetration_{percent}_m": percent / 100 for percent in SHARES_PERCENT}
    wanted = {name: share for name, share in names.items() if name not in known}
    if wanted:
        found = penetrations_m(parcels, tuple(wanted.values()))
        figures |= dict(zip(wanted, found, strict=True))
    return figures


def with_figures(spray: Spray) -> Spray:
    """The spray with these figures among its notes; those that its model has put there stay."""
    figures = {} if spray.parcels is None else liquid_figures(spray.parcels, spray.notes)
    if spray.vapour is not None and "vapour_mass_kg" not in spray.notes:
        figures["vapour_mass_kg"] = spray.vapour.mass_kg
    return replace(spray, notes={**spray.notes, **figures})
