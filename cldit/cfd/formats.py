"""Which format a CFD result is in, what it contains, and reading it."""

from __future__ import annotations

from dataclasses import dataclass

from cldit.cfd import converge, text_tables
from cldit.cfd.case import CfdCase
from cldit.cfd.column_mapping import ColumnMap, read_column_map
from cldit.cfd.ensight import case as ensight
from cldit.cfd.ensight.file import read_case_file
from cldit.cfd.openfoam import case as openfoam
from cldit.cfd.vtk import files as vtkfiles
from cldit.errors import SprayError
from cldit.progress import Watch, silent
from cldit.scene.spray import CfdSpray
from cldit.spray.spray_file import read_spray

_SUFFIX = {
    ".case": "ensight",
    ".encas": "ensight",
    ".h5": "converge",
    ".yaml": "tables",
    ".yml": "tables",
    ".npz": "cldit",
}


def find_format(spec: CfdSpray) -> str:
    """The format that the scene names, or that name and content of the file tell.

    Raises:
        SprayError: there is no such file, or a folder could be two things.
    """
    if spec.format is not None:
        return spec.format
    if openfoam.is_openfoam(spec.file):
        return "openfoam"
    if not spec.file.is_dir():
        return _SUFFIX.get(spec.file.suffix, "vtk")
    found = {
        name
        for suffix, name in _SUFFIX.items()
        if suffix in (".case", ".encas", ".h5")
        if any(spec.file.glob(f"*{suffix}"))
    }
    if len(found) > 1:
        raise SprayError(f"{spec.file}: holds files of {' and '.join(sorted(found))}; set format")
    return found.pop() if found else "vtk"


def read_case(spec: CfdSpray, watch: Watch = silent) -> CfdCase:
    """One time of a case, in its own coordinates.

    Raises:
        SprayError: files or fields are missing or damaged; a mapping is given where names are the
            format's own.
    """
    kind = find_format(spec)
    if spec.mapping is not None and kind not in ("ensight", "converge"):
        raise SprayError(
            f"{spec.mapping}: spray.mapping is for ensight and converge; {kind} has its names "
            + ("in spray.file itself" if kind == "tables" else "fixed")
        )
    names = ColumnMap() if spec.mapping is None else read_column_map(spec.mapping)
    match kind:
        case "tables":
            return text_tables.read_tables(
                spec.file, time_s=spec.time_s, fuel_field=spec.fuel_field
            )
        case "ensight" | "converge":
            read = ensight.read_ensight if kind == "ensight" else converge.read_converge
            return read(
                spec.file,
                time_s=spec.time_s,
                fuel_field=spec.fuel_field,
                cloud=spec.cloud,
                names=names,
                watch=watch,
            )
    fields = (spec.fuel_field, "T", "rho", "p")
    plain = openfoam.read_openfoam if kind == "openfoam" else vtkfiles.read_vtk
    return plain(spec.file, time_s=spec.time_s, fields=fields, cloud=spec.cloud, watch=watch)


@dataclass(frozen=True)
class Contents:
    """What a case holds: times in s (those known), cell fields, and clouds with their fields.

    Fields are those of the time asked for, or the last.
    """

    format: str
    times_s: tuple[float, ...]
    fields: tuple[str, ...]
    clouds: dict[str, tuple[str, ...]]


def contents(spec: CfdSpray) -> Contents:
    """Lists a case without judging whether it has what a spray needs.

    Raises:
        SprayError: it cannot be read, or does not hold the time.
    """
    kind = find_format(spec)
    found: tuple[list[float], list[str], dict[str, list[str]]]
    match kind:
        case "openfoam":
            found = openfoam.list_openfoam(spec.file, spec.time_s)
        case "ensight":
            case = read_case_file(ensight.case_path(spec.file))
            cells = [item.name for item in case.items if item.kind == "scalar per element"]
            drops = [item.name for item in case.items if "measured node" in item.kind]
            measured = any(item.kind == "measured" for item in case.items)
            found = ensight.times(case), cells, {"measured": drops} if measured else {}
        case "converge":
            found = converge.list_converge(spec.file, spec.time_s)
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
    times_s, fields, clouds = found
    named = {name: tuple(columns) for name, columns in sorted(clouds.items())}
    return Contents(kind, tuple(sorted(times_s)), tuple(sorted(fields)), named)


_STORED = ("diameter_m", "droplets", "temperature_K", "density_kg_m3")
