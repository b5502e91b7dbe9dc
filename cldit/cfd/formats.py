"""Format of a CFD result, its contents, and its reader."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

from cldit.cfd import tables as text_tables
from cldit.cfd.case import NO_CLOUD, CfdCase
from cldit.cfd.ensight import case as ensight
from cldit.cfd.ensight.file import read_case_file
from cldit.cfd.hdf import cgns, converge, fluent
from cldit.cfd.mapping.file import ColumnMap, read_column_map
from cldit.cfd.openfoam import case as openfoam
from cldit.cfd.openfoam.injectors import case_injectors
from cldit.cfd.openfoam.regions import clouds_of, is_openfoam
from cldit.cfd.times import CaseTime
from cldit.cfd.unknown_kinds import refuse_folder, refuse_unknown
from cldit.cfd.vtk import files as vtkfiles
from cldit.cfd.vtk.collections import COLLECTIONS, DATA
from cldit.cfd.vtk.layout import is_vtk
from cldit.errors import SprayError
from cldit.io.progress import Watch, silent
from cldit.scene.spray import CfdSpray
from cldit.spray.spray_file import read_spray

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
    if not spec.file.is_dir():
        if fluent.is_fluent(spec.file):
            return "fluent"
        if spec.file.suffix not in _SUFFIX:
            refuse_unknown(spec.file)
        return _SUFFIX[spec.file.suffix]
    found = {
        name
        for suffix, name in _SUFFIX.items()
        if suffix in (".case", ".encas", ".h5")
        if any(spec.file.glob(f"*{suffix}"))
    }
    if len(found) > 1:
        raise SprayError(f"{spec.file}: holds files of {' and '.join(sorted(found))}; set format")
    if not found and not is_vtk(spec.file):
        inside = [each for each in sorted(spec.file.iterdir()) if each.is_dir() and is_vtk(each)]
        if inside:
            shown = ", ".join(map(str, inside[:5]))
            raise SprayError(f"{spec.file}: VTK files lie in {shown}; give one of these folders")
        refuse_folder(spec.file)
    return found.pop() if found else "vtk"


def read_case(spec: CfdSpray, watch: Watch = silent) -> CfdCase:
    """Reads one time of a case, in its own coordinates."""
    kind = find_format(spec)
    if spec.mapping is not None and kind == "tables":
        raise SprayError(f"{spec.mapping}: spray.mapping: tables have their names in spray.file")
    names = ColumnMap() if spec.mapping is None else read_column_map(spec.mapping)
    if spec.region is not None and kind != "openfoam":
        raise SprayError(f"{spec.file}: spray.region is for openfoam; this is {kind}")
    table = kind != "tables" and names.parcels is not None and names.parcels.file is not None
    common: _Common = {
        "time_s": spec.time_s,
        "fuel_field": spec.fuel_field,
        "cloud": NO_CLOUD if table else spec.cloud,
        "names": names,
        "watch": watch,
    }
    match kind:
        case "tables":
            found = text_tables.read_tables(
                spec.file, time_s=spec.time_s, fuel_field=spec.fuel_field, cloud=spec.cloud
            )
        case "ensight":
            found = ensight.read_ensight(spec.file, **common)
        case "converge":
            found = converge.read_converge(spec.file, **common)
        case "cgns":
            found = cgns.read_cgns(spec.file, **common)
        case "fluent":
            found = fluent.read_fluent(spec.file, **common)
        case "openfoam":
            found = openfoam.read_openfoam(spec.file, **common, region=spec.region)
        case _:
            found = vtkfiles.read_vtk(spec.file, **common)
    if table:
        assert spec.mapping is not None
        found = _with_table(spec, spec.mapping, names, found)
    elif kind != "openfoam":
        found = _in_its_case(spec, found)
    mapped = () if spec.mapping is None else (spec.mapping,)
    return replace(found, files=(*mapped, *found.files))


def _with_table(spec: CfdSpray, path: Path, names: ColumnMap, found: CfdCase) -> CfdCase:
    """Replaces the cloud of a case by the table that the mapping file `path` names."""
    if spec.cloud not in (None, "parcels"):
        raise SprayError(
            f"{path}: parcels.file names the parcels, and spray.cloud is {spec.cloud!r}; leave one "
            "of them out"
        )
    assert names.parcels is not None and names.parcels.file is not None
    cloud = text_tables.table_cloud(path, names)
    file = path.parent / names.parcels.file
    return replace(found, cloud=cloud, files=(*found.files, file))


def _in_its_case(spec: CfdSpray, found: CfdCase) -> CfdCase:
    """Adds the injectors of the OpenFOAM case in which its converted files lie.

    A converted file without parcels is refused if the case itself has some.
    """
    near = spec.file.resolve().parents[:3]
    case = next((each for each in near if (each / "constant").is_dir()), None)
    if case is None:
        return found
    if found.cloud is not None:
        injectors, dictionaries = case_injectors(case, found.cloud.name)
        others = {each.name for each in clouds_of(case)} - {found.cloud.name}
        said = (
            f"{found.source}: the case that it lies in has also the parcels of "
            f"{', '.join(sorted(others))}, which are not read.",
        )
        return replace(
            found,
            injectors=injectors,
            files=(*found.files, *dictionaries),
            remarks=(*found.remarks, *(said if others else ())),
        )
    if spec.cloud is None and (folders := clouds_of(case)):
        raise SprayError(
            f"{found.source}: holds no parcels, but the case that it lies in does: "
            f"{', '.join(map(str, folders[:3]))} (foamToVTK and foamToEnsight leave a region's "
            f"out); give {case} as the case, or spray.cloud: {NO_CLOUD} for gas alone"
        )
    return found


class _Common(TypedDict):
    """What every reader takes."""

    time_s: CaseTime | None
    fuel_field: str
    cloud: str | None
    names: ColumnMap
    watch: Watch


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
    found: tuple[list[float], list[str], dict[str, list[str]]]
    match kind:
        case "openfoam":
            found = openfoam.list_openfoam(spec.file, spec.time_s, spec.region)
        case "ensight":
            case = read_case_file(ensight.case_path(spec.file))
            kinds = ("scalar per element", "scalar per node")
            cells = [item.name for item in case.items if item.kind in kinds]
            clouds = ensight.clouds(case)
            found = ensight.times(case), cells, {key: list(clouds[key][1]) for key in clouds}
        case "converge":
            found = converge.list_converge(spec.file, spec.time_s)
        case "cgns":
            found = (*cgns.list_cgns(spec.file), {})
        case "fluent":
            found = [], fluent.list_fluent(spec.file), {}
        case "tables":
            mapping = read_column_map(spec.file)
            folder = spec.file.parent
            times = [] if mapping.time_s is None else [mapping.time_s]
            names: list[list[str]] = [
                []
                if part is None or part.file is None
                else text_tables.table_names(folder / part.file, part)
                for part in (mapping.cells, mapping.parcels)
            ]
            found = times, names[0], {} if mapping.parcels is None else {"parcels": names[1]}
        case "cldit":
            spray = read_spray(spec.file)
            times = [spray.notes["time_s"]] if "time_s" in spray.notes else []
            gas = [] if spray.vapour is None else ["number_density_m3", "temperature_K"]
            found = times, gas, {} if spray.parcels is None else {"parcels": list(_STORED)}
        case _:
            found = vtkfiles.list_vtk(spec.file, spec.time_s)
    times_s, fields, parcels = found
    named = {name: tuple(columns) for name, columns in sorted(parcels.items())}
    return Contents(kind, tuple(sorted(times_s)), tuple(sorted(fields)), named)


_STORED = ("diameter_m", "droplets", "temperature_K", "density_kg_m3")
