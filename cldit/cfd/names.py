"""Names that programs give to quantities and species: the only lists and expressions of these."""

import re
from collections.abc import Iterable
from difflib import get_close_matches

from cldit.cfd.mapping.file import without_unit
from cldit.constants import HEPTANE_MOLAR_MASS_kg_mol
from cldit.scene.spray import CfdSpray

# Lower case, letters and digits alone, without the unit; the likeliest first.
GAS = {
    "temperature": "t temp temperature statictemperature gastemperature svt",
    "pressure": "p pres absolutepressure absolutestaticpressure pressure",
    "density": "rho dens density svdensity",
    "fuel": "fuel yfuel massfractionoffuel fuelmassfraction massfractionfuel",
    "volume": "v vol volume cellvolume",
}
PARCELS = {
    "diameter": "d diam diameter particlediameter dropletdiameter",
    "radius": "r rad radius particleradius parcelradius",
    "number": "nparticle n num numdrop ninparcel particlecount parcelparticlecount "
    "numberofdroplets particlesperparcel numberinparcel",
    "mass": "parcelmass",
    "temperature": "t temp temperature particletemperature parceltemp",
    "density": "rho dens density particledensity",
    "age": "age residencetime particleresidencetime lifetime parcelage",
}
VECTORS = {
    "position": "x y z, xposition yposition zposition, xcoordinate ycoordinate zcoordinate, "
    "centroidx centroidy centroidz, points0 points1 points2",
    "size": "dx dy dz",
    "velocity": "u v w, ux uy uz, u0 u1 u2, velocityi velocityj velocityk, "
    "velocity0 velocity1 velocity2, velocityx velocityy velocityz, xvelocity yvelocity zvelocity",
}
TIME = re.compile(
    r"(flow|physical|solution|simulation|integration)?time(s|value|step|index)?"
    r"|step|iteration|cycle|crankangle"
)
IDENTITY = re.compile(r"(particle|parcel|droplet|track)(id|identifier|index)")


def normalised(name: str) -> str:
    """Letters and digits of a name without its unit: `velocityi` of `Velocity[i] (m/s)`."""
    return re.sub(r"[^a-z0-9]", "", without_unit(name).lower())


def is_mark(name: str) -> bool:
    """True for the name of a column that gives the time, or the identity of a particle."""
    plain = normalised(name)
    return bool(TIME.fullmatch(plain) or IDENTITY.fullmatch(plain))


def guessed(aliases: Iterable[str], names: Iterable[str]) -> list[str]:
    """Selects the `names` that are `aliases` of a quantity in some program, the likeliest first."""
    by_name: dict[str, list[str]] = {}
    for column in names:
        by_name.setdefault(normalised(column), []).append(column)
    return [column for name in aliases for column in by_name.get(name, ())]


def similar(name: str, names: Iterable[str]) -> list[str]:
    """Returns up to three of `names` that resemble `name`."""
    by_lower = {candidate.lower(): candidate for candidate in names}
    close = get_close_matches(name.lower(), by_lower, n=3, cutoff=0.6)
    return [by_lower[match] for match in close]


_BEFORE = re.compile(r"^(?:MASSFRAC_|[XY]_|[XY](?=[NI]?C\d+H|\())\(?|\)$")
_ATOMIC_KG_MOL = {"C": 12.011e-3, "H": 1.008e-3, "O": 15.999e-3, "N": 14.007e-3}
_PHASE = re.compile(r"(\w+)\((?:l|s|liq|liquid)\)$", re.IGNORECASE)  # OpenFOAM's C7H16(l)
_SUBSTANCES = "WATER ETHANOL METHANOL HEPTANE OCTANE ISOOCTANE DODECANE TOLUENE UREA".split()
_FUELS = {
    "C7H16": "n-heptane",
    "NC7H16": "n-heptane",
    "IC8H18": "iso-octane",
    "NC8H18": "n-octane",
    "CH4": "methane",
}
# Relative difference of molar masses below which fuels are the same: rounded masses of atoms
# change them by some 0.2 %, neighbours in the series of alkanes by 14 % (C7 and C8) to 5 % (C20).
SAME_MOLAR_MASS = 0.01


def formula(field: str) -> str:
    """Name of the species of a field without what programs put around it, in capitals."""
    name = field.upper().replace("-", "")
    return _BEFORE.sub("", name) if _BEFORE.match(name) else name


def other_fuels(available: Iterable[str], fuel_field: str) -> list[str]:
    """Lists hydrocarbons (from C2 on) among the `available` names, other than `fuel_field`."""
    fuel, form = formula(fuel_field), re.compile(r"C\d+H\d+\w*|[NI]C\d+H\d+")
    return sorted(n for n in available if form.fullmatch(formula(n)) and formula(n) != fuel)


def molar_mass_kg_mol(name: str) -> float | None:
    """Molar mass by a formula of C, H, O and N in a species' name, such as Y_C7H16; else None."""
    match = re.fullmatch(r"(?:[NI](?=C\d))?((?:[CHON]\d*)+)", formula(name))
    if match is None or not re.search(r"\d", name):
        return None
    atoms = re.findall(r"([CHON])(\d*)", match[1])
    return sum(_ATOMIC_KG_MOL[atom] * int(count or 1) for atom, count in atoms)


def species_in(name: str) -> str | None:
    """Species of which a column of parcels gives the share, by its name; else None."""
    if (phase := _PHASE.search(name)) is not None:
        return formula(phase[1])
    words = [word.upper() for word in re.split(r"[^A-Za-z0-9]+", name)]
    species = (w for w in words if w in _SUBSTANCES or molar_mass_kg_mol(w) is not None)
    return next(species, None)


def is_liquid(name: str) -> bool:
    """True if a name states the share of a species in the liquid."""
    return _PHASE.search(name) is not None


def fuel_of(spec: CfdSpray) -> str:
    """Name of the fuel by `fuel_field`, which n-heptane's molar mass replaces."""
    name = formula(spec.fuel_field)
    heptane = abs(spec.fuel_molar_mass_kg_mol / HEPTANE_MOLAR_MASS_kg_mol - 1.0) < SAME_MOLAR_MASS
    formula_match = re.fullmatch(r"[NI]?C\d*H\d+\w*", name)
    return _FUELS.get(name, "n-heptane" if heptane and not formula_match else spec.fuel_field)


def with_molar_mass(spec: CfdSpray) -> CfdSpray:
    """Sets the molar mass by the formula of the fuel's field, unless it is given or n-heptane's."""
    stated = molar_mass_kg_mol(spec.fuel_field)
    default = CfdSpray.model_fields["fuel_molar_mass_kg_mol"].default
    if (
        stated is None
        or spec.fuel_molar_mass_kg_mol != default
        or abs(stated / default - 1) < SAME_MOLAR_MASS
    ):
        return spec
    return spec.model_copy(update={"fuel_molar_mass_kg_mol": stated})
