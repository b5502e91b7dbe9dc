"""Parcels of a case: range checks, omission of impossible ones, spreading over a ball."""

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.cfd.case import Cloud, Column, triple
from cldit.cfd.tolerances import WRITTEN
from cldit.errors import SprayError
from cldit.spray.result import Parcels

# a falling drop of water breaks up beyond some 5 mm; a larger value has another unit
_LIMITS = {
    "d": (1e-9, 5e-3, "d is the diameter of a droplet in metres"),
    "nParticle": (0.0, 1e18, "nParticle is the number of droplets"),
    "T": (1.0, 5000.0, "T is a temperature in K, above the freezing point (degC?)"),
    "rho": (10.0, 3e4, "rho is a density in kg/m3"),
}


def check_parcels(
    cloud: Cloud, lower_m: Floats, upper_m: Floats, *, share: float, coldest_K: float
) -> tuple[Parcels, Mask, tuple[str, ...]]:
    """Omits parcels with impossible values or outside the mesh's bounding box, lower_m to upper_m.

    Returns parcels in the case's coordinates, a mask of those that are kept, (N,), and remarks.
    Liquid below coldest_K, the freezing point, is impossible. More than `share` of their number,
    or of the mass, is an error. Up to half may be dummies, of diameter or number zero.
    """
    count = len(cloud.position_m.values)
    wrong: list[tuple[Mask, str]] = []
    for name, (minimum, maximum, hint) in _LIMITS.items():
        if name == "T":
            minimum = coldest_K
        column = cloud.fields[name]
        if (outside := column.outside(minimum, maximum)) is not None:
            bad = int(np.argmax(outside))
            value = f"{column.values[bad]:g} (entry {bad}) is outside {minimum:g}..{maximum:g}"
            wrong.append((outside, f"{column.label}: {value}; {hint}"))
    position = cloud.position_m
    slack = WRITTEN * float((upper_m - lower_m).max())  # float32 in either file
    low, high = position.values >= lower_m - slack, position.values <= upper_m + slack
    beyond = ~np.all(low & high, axis=1)
    if beyond.any():
        bad = int(np.argmax(beyond))
        box = f"{triple(lower_m)} to {triple(upper_m)} m"
        place = f"parcel {bad} at {triple(position.values[bad])} m"
        wrong.append((beyond, f"{position.label}: {place} is outside the mesh, {box}"))
    kept = np.ones(count, dtype=bool)
    for mask, _ in wrong:
        kept &= ~mask
    dummy = (cloud.fields["d"].values == 0.0) | (cloud.fields["nParticle"].values == 0.0)
    lost = int(np.sum(~kept & ~dummy if 2 * dummy.sum() <= count else ~kept))
    if lost > share * count or _mass_share(cloud, beyond, wrong) > share:
        problem = f"{lost} of {count} parcels are impossible or outside"
        limit = f"up to {100 * share:g} % may be omitted: spray.parcels_left_out"
        raise SprayError(f"{wrong[0][1]} ({problem}; {limit})")
    remarks = tuple(f"Omitted {int(mask.sum())} of {count} parcels: {why}." for mask, why in wrong)
    columns = (position, *(cloud.fields[name] for name in _LIMITS))
    where, *quantities = (np.asarray(stored.values[kept], np.float64) for stored in columns)
    size, droplets, temperature, density = quantities
    vector = cloud.fields.get("U")
    velocity = None  # unless all parcels have one
    if vector is not None and np.isfinite(vector.values[kept]).all():
        velocity = np.asarray(vector.values[kept], np.float64)
    parcels = Parcels(where, size, droplets, temperature, density, velocity_m_s=velocity)
    return parcels, kept, remarks


def _mass_share(cloud: Cloud, beyond: Mask, wrong: list[tuple[Mask, str]]) -> float:
    """Share of the liquid in parcels with possible values, but outside the mesh."""
    possible = np.ones(len(beyond), dtype=bool)
    for mask, _ in wrong:
        possible &= ~mask | (mask is beyond)
    if not (beyond & possible).any():
        return 0.0
    mass = np.where(possible, cloud.masses, 0.0)
    return float(mass[beyond].sum() / mass.sum()) if mass.sum() > 0 else 0.0


def farthest_m(cloud: Cloud, share: float) -> float | None:
    """Distance from their origin within which `share` of the liquid lies; None without origins.

    Interpolated as KinematicCloud::penetration does; OpenFOAM's log states it for 0.95.
    """
    if "origin" not in cloud.fields:
        return None
    distance = np.linalg.norm(cloud.position_m.values - cloud.fields["origin"].values, axis=1)
    order = np.argsort(distance, kind="stable")
    distance, mass = distance[order], cloud.masses[order]
    beyond = np.cumsum(mass[::-1])[::-1]  # with the parcel itself
    rest = (1.0 - share) * beyond[0]
    at = int(np.flatnonzero(beyond > rest)[-1]) if beyond[0] > 0 else len(distance) - 1
    if at == len(distance) - 1:
        return float(distance[-1])
    step = (beyond[at] - rest) / mass[at]
    return float(distance[at] + step * (distance[at + 1] - distance[at]))


def only(cloud: Cloud, kept: Mask) -> Cloud:
    """Restricts `cloud` to the parcels that are `kept` (N,)."""
    if kept.all():
        return cloud
    fields, extra = (
        {name: Column(column.label, column.values[kept]) for name, column in columns.items()}
        for columns in (cloud.fields, cloud.extra)
    )
    place = Column(cloud.position_m.label, cloud.position_m.values[kept])
    return Cloud(cloud.name, place, fields, extra)
