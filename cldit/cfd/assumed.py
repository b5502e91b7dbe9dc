"""Assumptions where a case does not state a figure; each is reported and kept in the run."""

from cldit.cfd.case import CfdCase
from cldit.cfd.names import SAME_MOLAR_MASS, fuel_of, molar_mass_kg_mol, similar
from cldit.scene.spray import CfdSpray


def assumptions(spec: CfdSpray, case: CfdCase) -> tuple[str, ...]:
    """Lists the assumptions that replace figures which the case lacks, a sentence each."""
    remarks = []
    if "rho" not in case.gas and "p" in case.gas:
        close = ", ".join(map(repr, similar("rho", set(case.available) - set(case.gas))))
        hint = f" (if it is {close}, name it in a mapping file)" if close else ""
        p = case.gas["p"].values
        span = f"{p.min():.4g} to {p.max():.4g} Pa"
        used = f"that of an ideal gas of air and fuel at T and p ({span}) was used"
        remarks.append(f"{case.source}: no density 'rho' among the cell fields{hint}: {used}.")
    if "rho" in case.gas and "p" not in case.gas:
        effect = "the density was not compared with that of an ideal gas"
        remarks.append(f"{case.source}: no pressure among the cell fields: {effect}.")
    if case.time_s is None:
        caveat = "" if case.cloud is None else "; gas and parcels were not compared by theirs"
        remarks.append(f"{case.source}: does not state its time{caveat}.")
    fuel, stated = fuel_of(spec), molar_mass_kg_mol(spec.fuel_field)
    if stated is not None and abs(stated / spec.fuel_molar_mass_kg_mol - 1.0) > SAME_MOLAR_MASS:
        used = f"Molar mass of {spec.fuel_field}: {spec.fuel_molar_mass_kg_mol:g} kg/mol, as given"
        remarks.append(f"{used}; by its formula it is {stated:.6g} (spray.fuel_molar_mass_kg_mol).")
    if stated is None:
        reason = f"the name of the field {spec.fuel_field} is no formula (spray.fuel_field)"
        remarks.append(f"Fuel {fuel}, {spec.fuel_molar_mass_kg_mol:.6g} kg/mol: {reason}.")
    elif fuel != "n-heptane":
        remarks.append(f"Fuel {fuel}, {spec.fuel_molar_mass_kg_mol:.6g} kg/mol.")
    return tuple(remarks)


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
