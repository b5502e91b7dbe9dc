"""Kinds of files that cldit does not read, and the export of each that it reads."""

import re
from pathlib import Path

from cldit.errors import SprayError

_PARAVIEW = "open it in ParaView and save the gas as .vtu and the parcels as .vtp"
_TABLES = "export cells and parcels as text tables and describe them by a mapping file (.yaml)"
_BEGIN = (
    "`cldit import FILE --write-mapping case.yaml` drafts a mapping file (.yaml) for its "
    "columns; then give case.yaml as the case"
)
_FLUENT = f"in Fluent, File > Export > EnSight Case Gold with the DPM particles; or {_TABLES}"
_STAR = "in STAR-CCM+, File > Export > EnSight Gold with the Lagrangian phase; or " + _TABLES
# endings: what it is, and the way out
_KINDS: dict[str, tuple[str, str]] = {
    ".cas .cas.gz .dat .dat.gz .his": ("a file of Fluent (or Tecplot)", _FLUENT),
    ".msh": ("a mesh of Fluent or Gmsh without results", "give the results, as EnSight or .vtu"),
    ".sim .ccm .trk": ("a session, mesh or tracks of STAR-CCM+", _STAR),
    ".res": ("a result of CFX", f"in CFD-Post, export EnSight or CSV; {_TABLES}"),
    ".hdf": ("HDF, maybe VTK's", "give VTK's own the ending .vtkhdf"),
    ".plt .silo .visit .nek5000 .gmv .bp .phs .xmf .xdmf .e .exo .pvsm": (
        "a file of Tecplot, Silo, VisIt, Nek5000, GMV (KIVA), ADIOS, PHASTA, XDMF or Exodus",
        _PARAVIEW,
    ),
    ".szplt": ("Tecplot", f"in Tecplot, export .plt, then {_PARAVIEW}"),
    ".stl": ("a surface without gas", "give the results, as .vtu or an OpenFOAM case"),
    ".fla .flm .fl3": ("a file of AVL FIRE", _TABLES),
    ".out": ("a map or restart of CONVERGE", "convert it with CONVERGE's post_convert to HDF5"),
    ".csv .txt .tsv .dpm": ("a table", _BEGIN),
    ".parquet": ("a Parquet table", "save it as CSV: `pandas.read_parquet(FILE).to_csv('a.csv')`"),
    ".xlsx": ("a spreadsheet", f"save it as CSV; {_TABLES}"),
    ".json": ("JSON", _TABLES),
    ".tar .tgz .tar.gz .zip": ("an archive", "unpack it and give the case inside"),
}
_READ = (
    "an OpenFOAM case (folder or .foam), VTK files (.vtu, .vtp, .vtk, .vti, .vtr, .vts, their "
    "pieces (.pvtu), .vtm, .pvd, .vtkhdf), CGNS in HDF5 (.cgns), EnSight Gold (.case), CONVERGE "
    "(.h5), Fluent (.cas.h5), AMReX plotfiles (their folder), tables (a mapping file, .yaml), or "
    "cldit's own .npz"
)


def _kind(path: Path) -> tuple[str, str] | None:
    if re.search(r"0\.f\d{5}$", path.name):
        return "a field file of Nek5000", f"with its .nek5000 file {_PARAVIEW}"
    if re.match(r"(otape|itape|tape)\d*", path.name.lower()):
        return "a file of KIVA", f"convert it to GMV, then {_PARAVIEW}; or {_TABLES}"
    kinds = {ending: kind for endings, kind in _KINDS.items() for ending in endings.split()}
    matches = [ending for ending in kinds if path.name.lower().endswith(ending)]
    return kinds[max(matches, key=len)] if matches else None


def refuse_unknown(path: Path) -> None:
    """Raises an error that names the kind of a file, and which export is read."""
    kind = _kind(path)
    if kind is not None:
        name, way = kind
        raise SprayError(f"{path}: is {name}, which is not read; {way}")
    raise SprayError(f"{path}: is of no kind that is read; allowed: {_READ}")


def refuse_folder(path: Path) -> None:
    """Raises an error that names the first file of a known kind in a folder, or its content."""
    files = sorted(file for file in path.iterdir() if file.is_file())
    for file in files:
        if (kind := _kind(file)) is not None:
            name, way = kind
            raise SprayError(f"{path}: no case that is read; {file.name} is {name}: {way}")
    held = ", ".join(entry.name for entry in sorted(path.iterdir())[:8]) or "nothing"
    raise SprayError(f"{path}: no case that is read, but: {held}; allowed: {_READ}")
