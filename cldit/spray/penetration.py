"""How far liquid reaches, and how much of it there is: figures that every spray has alike."""

from __future__ import annotations

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
    depth = -parcels.position_m[:, 2]
    order = np.argsort(depth)
    reached = np.cumsum(parcels.masses_kg[order])
    return float(depth[order][int(np.argmax(reached >= share * reached[-1]))])


def liquid_figures(parcels: Parcels) -> dict[str, float]:
    """Notes of a spray's liquid: mass, Sauter mean diameter, penetrations by `SHARES_PERCENT`."""
    figures = {"liquid_mass_kg": parcels.mass_kg}
    if figures["liquid_mass_kg"] > 0.0:
        figures["sauter_mean_diameter_m"] = parcels.sauter_mean_diameter_m
        for percent in SHARES_PERCENT:
            figures[f"liquid_penetration_{percent}_m"] = penetration_m(parcels, percent / 100)
    return figures


def with_figures(spray: Spray) -> Spray:
    """The spray with these figures among its notes; those that its model has put there stay."""
    figures = {} if spray.parcels is None else liquid_figures(spray.parcels)
    if spray.vapour is not None:
        figures["vapour_mass_kg"] = spray.vapour.mass_kg
    return replace(
        spray, notes=spray.notes | {k: v for k, v in figures.items() if k not in spray.notes}
    )
