"""Format of a CFD result, its contents, and its reader."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from cldit.cfd.amrex import AMREX_NAMES, AMREX_PARCELS, list_amrex, plotfiles, read_amrex
from cldit.cfd.case import NO_CLOUD, CfdCase, Listing
from cldit.cfd.ensight.case import list_ensight, read_ensight
from cldit.cfd.hdf.cgns import CGNS_NAMES, list_cgns, read_cgns
from cldit.cfd.hdf.converge import CONVERGE_NAMES, list_converge, parcel_names, read_converge
from cldit.cfd.hdf.fluent import FLUENT_NAMES, is_fluent, list_fluent, read_fluent
from cldit.cfd.mapping.file import (
    FOAM_NAMES,
    PARCEL_NAMES,
    ColumnMap,
    ParcelColumns,
    Scalar,
    read_column_map,
)
from cldit.cfd.openfoam.case import list_openfoam, read_openfoam
from cldit.cfd.openfoam.dictionaries import case_injectors
from cldit.cfd.openfoam.regions import clouds_of, is_openfoam
from cldit.cfd.tables.case import list_tables, read_tables, table_cloud
from cldit.cfd.unknown_kinds import refuse_folder, refuse_unknown
from cldit.cfd.vtk.collections import COLLECTIONS, DATA
from cldit.cfd.vtk.files import list_vtk, read_vtk
from cldit.cfd.vtk.layout import is_vtk
from cldit.errors import SprayError
from cldit.io.progress import Watch, silent
from cldit.scene.spray import CfdSpray
from cldit.spray.spray_file import read_spray


class Format(NamedTuple):
    """Functions that read and list a case, and the names of its gas and of columns of parcels."""

    read: Callable[[CfdSpray, ColumnMap, Watch], CfdCase]
    listing: Callable[[CfdSpray], Listing]
    gas: Mapping[str, tuple[str, ...]] = FOAM_NAMES
    parcels: Callable[[Collection[str]], ParcelColumns] = PARCEL_NAMES.among


FORMATS = {
    "amrex": Format(read_amrex, list_amrex, AMREX_NAMES, AMREX_PARCELS.among),
    "cgns": Format(read_cgns, list_cgns, CGNS_NAMES),
    "converge": Format(read_converge, list_converge, CONVERGE_NAMES, parcel_names),
    "ensight": Format(read_ensight, list_ensight),
    "fluent": Format(read_fluent, list_fluent, FLUENT_NAMES),
    "openfoam": Format(read_openfoam, list_openfoam),
    "tables": Format(read_tables, list_tables),
    "vtk": Format(read_vtk, list_vtk),
}
_SUFFIX = {
    ".case": "ensight",
    ".encas": "ensight",
    ".h5": "converge",
    ".cgns": "cgns",
    ".yaml": "tables",
    ".yml": "tables",
    ".npz": "cldit",
} | dict.fromkeys((*DATA, *COLLECTIONS, ".pvd", ".series"), "vtk")


def find_format(spec: CfdSpray) -> str:
    """Format that the scene names, else that of the file's name and content."""
    if spec.format is not None:
        return spec.format
    if not spec.file.exists():
        raise SprayError(f"{spec.file}: no such file or folder (spray.file)")
    if is_openfoam(spec.file):
        return "openfoam"
    if plotfiles(spec.file):
        return "amrex"
    if not spec.file.is_dir():
        if is_fluent(spec.file):
            return "fluent"
        if spec.file.suffix not in _SUFFIX:
            refuse_unknown(spec.file)
        return _SUFFIX[spec.file.suffix]
    kinds = {
        _SUFFIX[suffix]
        for suffix in (".case", ".encas", ".h5")
        if any(spec.file.glob(f"*{suffix}"))
    }
    if len(kinds) > 1:
        raise SprayError(f"{spec.file}: files of {' and '.join(sorted(kinds))}; set spray.format")
    if not kinds and not is_vtk(spec.file):
        inside = [path for path in sorted(spec.file.iterdir()) if path.is_dir() and is_vtk(path)]
        if inside:
            shown = ", ".join(map(str, inside[:5]))
            raise SprayError(f"{spec.file}: VTK files are in {shown}; give one of these folders")
        refuse_folder(spec.file)
    return kinds.pop() if kinds else "vtk"


def read_case(spec: CfdSpray, watch: Watch = silent, *, fuel_column: str | None = None) -> CfdCase:
    """Reads one time of a case, in its own coordinates.

    fuel_column: read as the fuel, in place of `spec.fuel_field` or what a mapping file gives.
    """
    kind = find_format(spec)
    if spec.mapping is not None and kind == "tables":
        raise SprayError(f"{spec.mapping}: spray.mapping: spray.file has the names of tables")
    if spec.region is not None and kind != "openfoam":
        raise SprayError(f"{spec.file}: spray.region is for openfoam; this is {kind}")
    path = spec.file if kind == "tables" else spec.mapping
    names = ColumnMap() if path is None else read_column_map(path)
    if fuel_column is not None:
        fuel = (names.cells.fuel or Scalar(column=fuel_column)).model_copy(
            update={"column": fuel_column}
        )
        cells = names.cells.model_copy(update={"fuel": fuel})
        names = names.model_copy(update={"cells": cells})
    read = FORMATS[kind].read
    if kind != "tables" and names.parcels is not None and names.parcels.file is not None:
        gas = spec.model_copy(update={"cloud": NO_CLOUD})
        case = _with_table(spec, names, read(gas, names, watch))
    else:
        case = read(spec, names, watch)
        case = case if kind == "openfoam" else _in_its_case(spec, case)
    mapped = () if spec.mapping is None else (spec.mapping,)
    accept = (*spec.accept, *names.accept)
    return replace(case, files=(*mapped, *case.files), accept=accept)


def _with_table(spec: CfdSpray, names: ColumnMap, case: CfdCase) -> CfdCase:
    """Replaces the cloud of a case by the table that its mapping file names."""
    path = spec.mapping
    assert path is not None and names.parcels is not None and names.parcels.file is not None
    if spec.cloud not in (None, "parcels"):
        conflict = f"parcels.file names the parcels, and spray.cloud is {spec.cloud!r}"
        raise SprayError(f"{path}: {conflict}; remove one of them")
    file = path.parent / names.parcels.file
    return replace(case, cloud=table_cloud(path, names), files=(*case.files, file))


def _in_its_case(spec: CfdSpray, converted: CfdCase) -> CfdCase:
    """Adds the injectors of the OpenFOAM case in which its converted files lie.

    A converted file without parcels is refused if the case itself has some.
    """
    parents = spec.file.resolve().parents[:3]
    case = next((parent for parent in parents if (parent / "constant").is_dir()), None)
    if case is None:
        return converted
    if converted.cloud is not None:
        injectors, dictionaries = case_injectors(case, converted.cloud.name)
        remarks = converted.remarks
        if unread := {folder.name for folder in clouds_of(case)} - {converted.cloud.name}:
            shown = ", ".join(sorted(unread))
            remarks += (f"{converted.source}: parcels of {shown} in {case} are not read.",)
        files = (*converted.files, *dictionaries)
        return replace(converted, injectors=injectors, files=files, remarks=remarks)
    if spec.cloud is None and (folders := clouds_of(case)):
        raise SprayError(
            f"{converted.source}: no parcels, but the case around it has some: "
            f"{', '.join(map(str, folders[:3]))} (foamToVTK and foamToEnsight omit those of a "
            f"region); give {case} as the case, or set spray.cloud: {NO_CLOUD} for gas alone"
        )
    return converted


@dataclass(frozen=True)
class Contents:
    """Contents of a case: known times in s, cell fields, clouds with their fields.

    Fields are those of the time asked for, or the last.
    """

    format: str
    times_s: tuple[float, ...]
    fields: tuple[str, ...]
    clouds: dict[str, tuple[str, ...]]


def contents(spec: CfdSpray) -> Contents:
    """Lists a case without judging whether it has all that a spray needs."""
    kind = find_format(spec)
    listed = _list_stored if kind == "cldit" else FORMATS[kind].listing
    times_s, fields, clouds = listed(spec)
    named = {name: tuple(columns) for name, columns in sorted(clouds.items())}
    return Contents(kind, tuple(sorted(times_s)), tuple(sorted(fields)), named)


def _list_stored(spec: CfdSpray) -> Listing:
    """Contents of cldit's own file."""
    spray = read_spray(spec.file)
    times = [spray.notes["time_s"]] if "time_s" in spray.notes else []
    gas = [] if spray.vapour is None else ["number_density_m3", "temperature_K"]
    parcels = ["diameter_m", "droplets", "temperature_K", "density_kg_m3"]
    return times, gas, {} if spray.parcels is None else {"parcels": parcels}
