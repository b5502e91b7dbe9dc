"""Assumptions where a case does not state a figure; each is reported and kept in the run."""

import re
from collections.abc import Iterable
from difflib import get_close_matches

from cldit.cfd.case import CfdCase
from cldit.scene.spray import CfdSpray

_ATOMIC_KG_MOL = {"C": 12.011e-3, "H": 1.008e-3, "O": 15.999e-3, "N": 14.007e-3}
_FORMULA = re.compile(r"(?:MASSFRAC_|[XY]_)?(?:[NI](?=C\d))?((?:[CHON]\d*)+)$", re.IGNORECASE)
_SLACK = 0.01  # of the molar mass: an isotope, or rounded


def assumptions(spec: CfdSpray, case: CfdCase) -> tuple[str, ...]:
    """Lists the assumptions that replace figures which the case lacks, a sentence each."""
    found = []
    if "rho" not in case.gas and "p" in case.gas:
        close = ", ".join(map(repr, similar("rho", set(case.available) - set(case.gas))))
        hint = f" (if it is {close}, name it in a mapping file)" if close else ""
        p = case.gas["p"].values
        span = f"{p.min():.4g} to {p.max():.4g} Pa"
        used = f"that of an ideal gas of air and fuel at T and p ({span}) was used"
        found.append(f"{case.source}: no density 'rho' among the cell fields{hint}: {used}.")
    if "rho" in case.gas and "p" not in case.gas:
        what = "the density was not compared with that of an ideal gas"
        found.append(f"{case.source}: no pressure among the cell fields: {what}.")
    if case.time_s is None:
        found.append(f"{case.source}: does not state its time.")
    stated = molar_mass_kg_mol(spec.fuel_field)
    if stated is not None and abs(stated / spec.fuel_molar_mass_kg_mol - 1.0) > _SLACK:
        used = f"Molar mass of {spec.fuel_field}: {spec.fuel_molar_mass_kg_mol:g} kg/mol, as given"
        found.append(f"{used}; by its formula it is {stated:.6g} (spray.fuel_molar_mass_kg_mol).")
    if stated is None:
        why = f"the name of the field {spec.fuel_field} is no formula (spray.fuel_field)"
        found.append(f"Fuel {spec.fuel}, {spec.fuel_molar_mass_kg_mol:.6g} kg/mol: {why}.")
    elif spec.fuel != "n-heptane":
        found.append(f"Fuel {spec.fuel}, {spec.fuel_molar_mass_kg_mol:.6g} kg/mol.")
    return tuple(found)


def with_molar_mass(spec: CfdSpray) -> CfdSpray:
    """Sets the molar mass by the formula of the fuel's field, unless it is given or n-heptane's."""
    stated = molar_mass_kg_mol(spec.fuel_field)
    default = CfdSpray.model_fields["fuel_molar_mass_kg_mol"].default
    if (
        stated is None
        or spec.fuel_molar_mass_kg_mol != default
        or abs(stated / default - 1) < _SLACK
    ):
        return spec
    return spec.model_copy(update={"fuel_molar_mass_kg_mol": stated})


def similar(name: str, known: Iterable[str]) -> list[str]:
    """Returns up to three of the `known` names that resemble `name`."""
    by_lower = {each.lower(): each for each in known}
    close = get_close_matches(name.lower(), by_lower, n=3, cutoff=0.6)
    return [by_lower[each] for each in close]


def molar_mass_kg_mol(name: str) -> float | None:
    """Molar mass by a formula of C, H, O and N in a species' name, such as Y_C7H16; else None."""
    match = _FORMULA.match(name)
    if match is None or not re.search(r"\d", name):
        return None
    atoms = re.findall(r"([CHON])(\d*)", match[1].upper())
    return sum(_ATOMIC_KG_MOL[atom] * int(count or 1) for atom, count in atoms)
