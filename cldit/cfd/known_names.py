"""Names that programs give to the quantities of gas and parcels, to propose them in a mapping."""

from __future__ import annotations

import re
from collections.abc import Iterable

from cldit.cfd.mapping_file import without_unit

# Normalised: lower case, letters and digits alone, without the unit.
GAS_NAMES: dict[str, tuple[str, ...]] = {
    "temperature": ("t", "temp", "temperature", "statictemperature", "gastemperature", "svt"),
    "pressure": ("p", "pres", "absolutepressure", "absolutestaticpressure", "pressure"),
    "density": ("rho", "dens", "density", "svdensity"),
    "fuel": ("fuel", "yfuel", "massfractionoffuel", "fuelmassfraction", "massfractionfuel"),
    "volume": ("v", "vol", "volume", "cellvolume"),
}
PARCEL_KEYS: dict[str, tuple[str, ...]] = {
    "diameter": ("d", "diam", "diameter", "particlediameter", "dropletdiameter"),
    "radius": ("r", "rad", "radius", "particleradius", "parcelradius"),
    "number": (
        *("nparticle", "n", "num", "number", "numdrop", "ninparcel", "particlecount"),
        *("parcelparticlecount", "numberofdroplets", "particlesperparcel", "numberinparcel"),
    ),
    "mass": ("parcelmass",),
    "temperature": ("t", "temp", "temperature", "particletemperature", "parceltemp"),
    "density": ("rho", "dens", "density", "particledensity"),
    "age": ("age", "residencetime", "particleresidencetime", "lifetime", "parcelage"),
}
VECTORS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "position": (
        ("x", "y", "z"),
        ("xposition", "yposition", "zposition"),
        ("xcoordinate", "ycoordinate", "zcoordinate"),
        ("centroidx", "centroidy", "centroidz"),
        ("points0", "points1", "points2"),
    ),
    "size": (("dx", "dy", "dz"),),
    "velocity": (
        ("u", "v", "w"),
        ("ux", "uy", "uz"),
        ("u0", "u1", "u2"),
        ("velocityi", "velocityj", "velocityk"),
        ("velocity0", "velocity1", "velocity2"),
        ("velocityx", "velocityy", "velocityz"),
        ("xvelocity", "yvelocity", "zvelocity"),
    ),
}


def normalised(name: str) -> str:
    """A name by its letters and digits: `velocityi` of `Velocity[i] (m/s)`."""
    return re.sub(r"[^a-z0-9]", "", without_unit(name).lower())


def guessed(known: Iterable[str], names: Iterable[str]) -> list[str]:
    """Names that some program gives to a quantity.

    Args:
        known: normalised names of the quantity.
        names: that there are.

    Returns:
        Those of `names`, the likeliest first.
    """
    by_name: dict[str, list[str]] = {}
    for each in names:
        by_name.setdefault(normalised(each), []).append(each)
    return [each for name in known for each in by_name.get(name, ())]


def guessed_vector(key: str, names: Iterable[str]) -> tuple[str, str, str] | None:
    """Three columns that some program gives to a vector.

    Args:
        key: of a mapping file.
        names: that there are.

    Returns:
        The names of the columns; None: there are none.
    """
    listed = list(names)
    for letters in VECTORS[key]:
        parts = [guessed((letter,), listed) for letter in letters]
        if all(len(part) == 1 for part in parts):
            return parts[0][0], parts[1][0], parts[2][0]
    return None
