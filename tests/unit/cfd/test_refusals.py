"""Faults of files and the messages that refuse them: one table for all formats."""

from __future__ import annotations

import gzip
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests.unit.cfd.composites import ZONE, keys_of, node, write_format
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import notes_of, read, refused

Change = Callable[[Path], None]
Row = tuple[str, Change, str]
CLOUD = "0.001/lagrangian/sprayCloud"
FIRST = rb"\n\(\n[^\n]+\n"  # the first number of a list of OpenFOAM


def gone(file: Path) -> None:
    file.unlink()


def pattern(old: bytes, new: bytes) -> Change:
    """Replaces the first match of a regular expression."""

    def change(file: Path) -> None:
        content, count = re.subn(old, new, file.read_bytes(), count=1)
        assert count, "the test must change something"
        file.write_bytes(content)

    return change


def text(old: str, new: str) -> Change:
    """Replaces the first place of a text."""
    return pattern(re.escape(old.encode("latin-1")), new.encode("latin-1").replace(b"\\", rb"\\"))


def first(number: str) -> Change:
    return pattern(FIRST, f"\n(\n{number}\n".encode())


def content(edit: Callable[[bytes], bytes]) -> Change:
    def change(file: Path) -> None:
        file.write_bytes(edit(file.read_bytes() if file.exists() else b""))

    return change


def pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def cut(count: int) -> Change:
    """Removes the last bytes."""
    return content(lambda whole: whole[:-count])


def xml(inside: str) -> Change:
    return content(lambda _: f"<VTKFile>{inside}".encode())


def hdf(edit: Callable[[Any], object]) -> Change:
    def change(file: Path) -> None:
        with h5py.File(file, "r+") as root:
            edit(root)

    return change


def array(name: str, values: Any = None) -> Change:
    """Removes an array of HDF5, or replaces it by others or by a function of its own."""

    def edit(root: Any) -> None:
        stored = root.pop(name)
        if values is not None:
            root[name] = values(stored[()]) if callable(values) else np.array(values)

    return hdf(edit)


def unwritten(name: str) -> Change:
    """An array that is announced, but was never written."""

    def edit(root: Any) -> None:
        stored = root.pop(name)
        root.create_dataset(name, stored.shape, stored.dtype)

    return hdf(edit)


def record(edit: Callable[[list[str]], None]) -> Change:
    """Changes the first parcel in barycentric coordinates: four weights, cell, face, point."""

    def change(file: Path) -> None:
        lines = file.read_text().split("\n")
        at = lines.index("(") + 1
        words = re.sub("[()]", "", lines[at]).split()
        edit(words)
        lines[at] = f"({' '.join(words[:4])}) {' '.join(words[4:])}"
        file.write_text("\n".join(lines))

    return change


def dimensions(powers: str, *, last: bool = False) -> Change:
    """Dimensions of a field of OpenFOAM, before or behind its values."""

    def change(file: Path) -> None:
        before, after = re.split(r"dimensions \[[^\]]*\];", file.read_text())
        entry = f"dimensions [{powers}];"
        file.write_text(f"{before}{after}{entry}" if last else f"{before}{entry}{after}")

    return change


def field(code: str) -> Change:
    """A field of OpenFOAM with these entries alone."""
    return lambda file: foam.form().write(file, "volScalarField", code.encode())


def exponents(powers: list[int]) -> Change:
    place = f"{ZONE}/Solution/Pressure"
    label = "DimensionalExponents_t"
    return hdf(lambda root: node(root[place], "DimensionalExponents", label, powers))


def units(name: str, unit: str) -> Change:
    return hdf(lambda root: root[name].attrs.__setitem__("Units", unit))


def located(time: str) -> Change:
    """Time that the header of an OpenFOAM file states."""
    return text("version", f'location "{time}/x"; version')


def cgns_node(name: str, label: str, data: bytes) -> Change:
    """A node of a zone with these bytes, in place of one that is there."""

    def edit(root: Any) -> None:
        held = root[ZONE].require_group(name)
        held.attrs.create("label", np.bytes_(label.encode()), dtype="S33")
        held.pop(" data", None)
        held[" data"] = np.frombuffer(data, "i1")

    return hdf(edit)


def two_times(root: Any) -> None:
    node(
        node(root["Base"], "Times", "BaseIterativeData_t"), "TimeValues", "DataArray_t", [0.1, 0.2]
    )


def open_pmd(root: Any) -> None:
    del root["STREAM_00"]
    root.attrs["openPMD"] = "1.1.0"


POINT = rb"\n\(\(?\n?\([^)]+\)"
FOAM: list[Row] = [
    ("0.001/T", gone, "0.001: no cell field 'T'; it has: C7H16, p, rho"),
    ("0.001/C7H16", gone, r"no cell field 'C7H16' \(spray.fuel_field\); it has: T, p, rho"),
    ("0.001/rho 0.001/p", gone, r"0\.001: neither rho nor p among the cell fields"),
    ("constant/polyMesh/points", gone, "constant/polyMesh/points: is missing"),
    (f"{CLOUD}/d", gone, "cloud 'sprayCloud' has no field 'd'; it has: T, U, nParticle, rho"),
    (f"{CLOUD}/nParticle", gone, "has no field 'nParticle'"),
    (f"{CLOUD}/positions", gone, "the cloud 'sprayCloud' has neither positions nor coord"),
    ("0.001/T", first("nan"), r"T: nan \(entry 0\) is outside 1..5000 .*; this cell is at \("),
    ("0.001/T", first("90"), r"T: 90 \(entry 0\) is below the freezing point of the vapour"),
    ("0.001/T", first("abc"), "0.001/T: (truncated or|contains text)"),
    ("0.001/T", pattern(rb"\n24\n\(\n[^\n]+", b"\n24\n("), "damaged: 23 numbers, expected 24"),
    ("0.001/T", pattern(rb"\n24\n\(\n[^\n]+", b"\n23\n("), "23 values, but the mesh has 24 cells"),
    ("0.001/T", text("nonuniform", "uniform"), "0.001/T: internalField is .uniform List"),
    ("0.001/T", text("FoamFile", "Foam"), "0.001/T: is not an OpenFOAM file"),
    (
        "0.001/T",
        located("0.0005"),
        r"T: states the time 0\.0005, .*0\.001 the time 0\.001; .*accept",
    ),
    ("0.001/C7H16", first("1.2"), "C7H16: 1.2 .* it must be the mass fraction"),
    ("0.001/rho", first("inf"), r"0.001/rho: inf \(entry 0\) is outside 0..2000"),
    (f"{CLOUD}/d", first("9"), "sprayCloud/d: 9 .* diameter of a droplet in metres"),
    (f"{CLOUD}/positions", located("0.0005"), r"positions: states the time 0\.0005, .*0\.001 the"),
    (f"{CLOUD}/d", located("0.0005"), r"sprayCloud/d: states the time 0\.0005, .*0\.001 the time"),
    (f"{CLOUD}/nParticle", first("-1"), "sprayCloud/nParticle: -1 "),
    (f"{CLOUD}/T", first("1e5"), r"sprayCloud/T: 100000 \(entry 0\) .*in K"),
    (f"{CLOUD}/rho", first("38"), r"sprayCloud/rho: 38 .* outside 100\.\.3000; .* in kg/m3"),
    (f"{CLOUD}/rho", pattern(rb"\n17\n\(\n[^\n]+", b"\n16\n("), "rho: 16 values for 17 parcels"),
    (f"{CLOUD}/positions", pattern(POINT, b"\n(\n(0 5 0)"), "positions: parcel 0 at .0, 5, 0"),
    (f"{CLOUD}/positions", pattern(POINT, b"\n(\n(nan 0 0)"), "positions: parcel 0 at .nan, 0"),
    (f"{CLOUD}/positions", pattern(rb"(?s)\n17\n\(.*\)\n", b"\n0()\n"), "has no parcel; choose"),
    ("constant/polyMesh/owner", first("-1"), "polyMesh: owner labels -1 to 23"),
    ("constant/polyMesh/owner", first("0.5"), "owner: a label is no whole"),
    ("constant/polyMesh/neighbour", first("900"), "24 values, but the mesh has 901 cells"),
    ("constant/polyMesh/faces", pattern(rb"\n\(\n4\(\d+", b"\n(\n4(99999"), "Mesh: point labels"),
    ("constant/polyMesh/faces", pattern(rb"\n\(\n4\(", b"\n(\n7("), "faces: truncated or damaged"),
    ("constant/polyMesh/points", pattern(POINT, b"\n(\n(nan 0 0)"), "a point of the mesh"),
    # a corner pulled out of place leaves a cell that is crooked, not open
    ("constant/polyMesh/points", pattern(POINT, b"\n(\n(9 9 9)"), ""),
]
FOAM += [
    (f"0.001/{name}", dimensions(powers, last=last), f"/{name}: cells.{message}")
    for name, powers, message in (
        ("p", "0 2 -2 0 0 0 0", r"pressure: unit '\[0 2 -2 0 0 0 0\]' is unknown; allow"),
        ("C7H16", "1 -3 0 0 0 0 0", r"fuel: unit 'kg/m3' is unknown; allowed: 1"),
        ("rho", "0 0 0 0 0 0 0", r"density: unit '1' is unknown; allowed: kg/m3"),
        ("T", "0 0 0 0 0", r"temperature: unit '1' is unknown; allowed: K"),
    )
    for last in (False, True)
]
FOAM += [
    ("0.001/T", field(code), message)
    for code, message in (
        ("internalField uniform $T0;", r"0\.001/T: the macro \$T0 has no entry above it"),
        ("T0 $T0; internalField uniform $T0;", r"the macro \$T0 names itself"),
        ('#include "none"\ninternalField uniform $T0;', r'"none", which it includes, is missing'),
        ("inside { internalField uniform 690; }", r"0\.001/T: has no internalField"),
        ('internalField uniform #calc "1+2";', "T: internalField is .uniform #calc.*foamDict"),
    )
]
FOAM_BINARY: list[Row] = [
    ("0.001/T", pattern(rb"\n24\n?\(", b"\n("), "T: a binary list without its length"),
    ("constant/polyMesh/owner", text("label=32", "label=64"), "constant/polyMesh/owner"),
    ("0.001/T", text("scalar=64", "scalar=32"), "0.001/T"),
    (f"{CLOUD}/positions", text("label=32", "label=64"), f"{CLOUD}/positions"),
]
FOAM_GZ: list[Row] = [("0.001/T.gz", content(gzip.decompress), r"0\.001/T\.gz: cannot be read")]
BARYCENTRIC: list[Row] = [
    (f"{CLOUD}/coordinates", record(edit), f"{CLOUD}/coordinates: .*{message}")
    for edit, message in (
        (lambda row: row.__setitem__(4, "24"), "a parcel in cell 24, but the mesh has 24"),
        (lambda row: row.__setitem__(5, "9999"), "a parcel in face 9999"),
        (lambda row: row.__setitem__(4, str((int(row[4]) + 7) % 24)), r"face \d+ does not belong"),
        (lambda row: row.__setitem__(6, "3"), "parcel 0: point 3 of a face of 4 points"),
        (lambda row: row.__setitem__(0, "7.0"), "do not sum to one"),
    )
]
ENSIGHT: list[Row] = [
    ("case.case", text("type: ensight gold", "type: ensight"), "not `type: ensight gold`"),
    ("case.case", text("model: case.geo", "model: 1 1 case.geo"), "several times in one file"),
    ("case.case", text("measured: 1 case.***.mgeo", ""), "GEOMETRY: no `measured` file for the"),
    ("case.case", text("measured: 1", "measured: 7"), "no time set 7"),
    ("case.case", text("time values: 0.0005", "time values: soon"), "no EnSight case file .*soon"),
    ("case.case", text("per element: 1 T", "per node: 1 T"), r"case\.005\.T: 'hexa8' where a part"),
    ("case.case", text("TIME\n", "FILE\nfile set: 1\n\nTIME\n"), "several times in one file"),
    ("case.case", text("T case.***.T", "T case.***.Tmp"), r"case\.005\.Tmp: cannot be read"),
    ("case.case", text("values: 0.0005", "values: 0.001"), r"2 claim to be .* time 0\.001: .*005"),
    ("case.geo", text("C Binary", "Fortran Binary"), "case.geo: is in Fortran binary"),
    ("case.geo", text("node id off", "\0" * 11), "'', expected `node id` and off, given, assign"),
    ("case.geo", text("coordinates", "block curvi"), "part 1 is a block 'curvi'; allowed:"),
    ("case.geo", text("hexa8 ", "hexa20"), "elements of type 'hexa20' are not read"),
    ("case.005.T", text("\x01\0\0\0", "\x09\0\0\0"), r"case\.005\.T: part 9 is not in the geometr"),
    ("case.005.mgeo", text("particle coord", "atoms coord   "), "expected `particle coordinates`"),
    ("case.005.mgeo", text("\x11\0\0\0", "\x10\0\0\0"), "mgeo: continues after its 16 parcels"),
]
POST = "post000002_1.000000e-03.h5"
STREAM = "STREAM_00"
CONVERGE: list[Row] = [
    (POST, array(STREAM), "no STREAM_00, so no post file of CONVERGE"),
    (POST, hdf(open_pmd), "is openPMD, which is not read; convert fields"),
    (POST, array(f"{STREAM}/CELL_CENTER_DATA/TEMPERATURE"), "no cell field 'T'; it has: DENSITY"),
    (POST, array(f"{STREAM}/VERTEX_COORDINATES/Y", [0.0]), "COORDINATES/Y: 1 values, expected 60"),
    (
        POST,
        array(f"{STREAM}/CONNECTIVITY/POLYGON_OFFSET", [0, 4]),
        "CONNECTED_CELLS: .* expected 2",
    ),
    (POST, array(f"{STREAM}/PARCEL_DATA/RADIUS"), "has no field 'd'"),
    (POST, array(f"{STREAM}/PARCEL_DATA/PARCEL_Z"), "PARCEL_Z is missing"),
    (POST, array(f"{STREAM}/PARCEL_DATA/TEMP", [[300.0]]), "TEMP: no list of numbers"),
    (POST, unwritten(f"{STREAM}/PARCEL_DATA/NUM_DROP"), "NUM_DROP: was never written"),
    (POST, units(f"{STREAM}/VERTEX_COORDINATES/X", "mm"), "COORDINATES/X: is in mm; expected: m"),
    (POST, units(f"{STREAM}/PARCEL_DATA/PARCEL_X", "mm"), "PARCEL_X: is in mm; expected: m"),
    (POST, units(f"{STREAM}/CELL_CENTER_DATA/PRESSURE", "m"), "PRESSURE: .*unit 'm' is unknown"),
    (
        POST,
        content(lambda whole: whole + b"more"),
        "its head states",
    ),
]
UNITS = b"Kilogram".ljust(32) + b"Foot".ljust(32)
GRIDS = hdf(lambda root: root[ZONE].copy("GridCoordinates", "GridCoordinates0001"))
CGNS: list[Row] = [
    ("a.cgns", cgns_node("Units", "DimensionalUnits_t", UNITS), "is in Foot"),
    ("a.cgns", cgns_node("Class", "DataClass_t", b"NondimensionalParameter"), "dimensional data"),
    ("a.cgns", cgns_node("Solution/Rind", "Rind_t", b"\0\1"), "has ghost cells"),
    ("a.cgns", cgns_node("More", "Elements_t", b"\x12\0"), "elements of type 18; allowed:"),
    ("a.cgns", cgns_node("Solution/GridLocation", "GridLocation_t", b"FaceCenter"), "at FaceCente"),
    ("a.cgns", exponents([1, -1, -2, 0, 0]), ""),
    (
        "a.cgns",
        exponents([0, 2, -2, 0, 0]),
        r"Pressure: cells\.pressure: unit '\[0, 2, -2, 0, 0\]'",
    ),
    ("a.cgns", hdf(two_times), "2 times in it"),
    ("a.cgns", GRIDS, "2 sets of coordinates, of a mesh that moves"),
    ("a.cgns", unwritten(f"{ZONE}/Solution/Pressure/ data"), "Pressure/ data: was never written"),
    (
        "a.cgns",
        content(lambda _: b"ADF Database" + bytes(99)),
        "CGNS in ADF",
    ),
]
POLYHEDRA: list[Row] = [
    ("a.cgns", array(f"{ZONE}/{name}/ElementConnectivity/ data", change), message)
    for name, change, message in (
        ("C", np.abs, "belongs to cells in the same sense"),
        ("C", lambda values: values + 1000, "a face that does not exist"),
        ("A", lambda values: values * 0 + 10_000, "point labels .* allowed: 0"),
        ("A", lambda values: values[:-1], "offsets 0 to .* numbers"),
    )
]
FLUENT: list[Row] = [
    # sections in any order of their names
    ("run.cas.h5", hdf(lambda f: f.move("meshes/1/faces/c0/1", "meshes/1/faces/c0/9")), ""),
    ("run.cas.h5", hdf(lambda f: f.create_group("special/Overset_DCI")), "an overset mesh"),
    ("run.cas.h5", hdf(lambda f: f.create_group("meshes/1/cells/tree")), "hanging nodes"),
    ("run.cas.h5", hdf(lambda f: f.__delitem__("meshes/1/nodes")), "no nodes/coords in it"),
    ("run.cas.h5", hdf(lambda f: f["meshes/1"].attrs.__setitem__("cellCount", 7)), "do not exist"),
    ("run.dat.h5", hdf(lambda f: f["results/1"].create_group("phase-2")), "phase-2 in addition to"),
    ("run.dat.h5", gone, r"run\.dat\.h5 is missing"),
    ("drops.dpm", text("(outflow", "outflow"), "does not begin with Fluent's two lines"),
    ("drops.dpm", text("((", "("), "line 3: expected: 10 numbers"),
    ("drops.dpm", cut(1), "is cut off"),
    ("drops.dpm", text("(x y z", "(x x z"), "its header has the column .x. twice"),
]
DOUBLE, SINGLE = "64 11 52 0 1 12 0 1023", "32 8 23 0 1 9 0 127"
AMREX: list[Row] = [
    (
        "Header",
        content(lambda whole: whole[:60]),
        "Header: is damaged or trun",
    ),
    ("Level_0/Cell_H", text("\n5\n", "\n4\n"), "4 components, 5 in the Header"),
    ("Level_0/Cell_H", text("((0,0,8) (7,7,15)", "((0,0,0) (7,7,7)"), "has 5 in another box"),
    ("Level_0/Cell_H", text("((0,0,8) (7,7,15) (0,0,0))\n", ""), "2 arrays of 1 boxes"),
    ("Level_1/Cell_H", cut(90), "Level_1/Cell_H: is damaged"),
    (
        "Level_1/Cell_H",
        text("((4,4,0)", "((5,4,0)"),
        "Level_1/Cell_H: .*cover parts of coarse cells",
    ),
    ("Level_0/Cell_D_00000", cut(800), r"Y\(NC7H16\) ends after 412 of 512 values"),
    ("Level_1/Cell_D_00000", text(DOUBLE, SINGLE), "no FAB of 4 or 8 bytes a number at 0"),
    ("particles/Header", text("double", "single"), "in single precision by"),
    ("particles/Level_0/DATA_00000", cut(8), r"DATA_00000: .*3512 bytes, but 40 particles"),
]
COLLECTION: list[Row] = [
    ("all.vtm", xml(inside), rf"all\.vtm.*{message}")
    for inside, message in (
        ("<vtkMultiBlockDataSet>", "is damaged or truncated"),
        ("</VTKFile>", "names no file"),
        ('<DataSet file="none.vtu"/></VTKFile>', r"names .*none\.vtu, which is missing"),
        ('<DataSet file="all.vtm"/></VTKFile>', "names itself"),
        ('<DataSet file="a.xyz"/></VTKFile>', r"names .*a\.xyz, of a kind that is not"),
    )
]
OFFSETS = "VTKHDF/Steps/CellDataOffsets/C7H16"
STEPS: list[Row] = [
    ("a.vtkhdf", content(lambda _: bytes(99)), "a.vtkhdf: cannot be read as HDF5"),
    ("a.vtkhdf", array(OFFSETS, [0, 0]), r"C7H16: 24 of 48 rows belong to no step"),
    *(
        ("a.vtkhdf", array("VTKHDF/Steps/Values", times), r"times \[.*\] of the steps do not rise")
        for times in ([1e-3, 5e-4], [1e-3, 1e-3])
    ),
]
TABLE: dict[str, list[Row]] = {
    "openfoam": FOAM,
    "openfoam-binary": FOAM_BINARY,
    "openfoam-gz": FOAM_GZ,
    "openfoam-barycentric": BARYCENTRIC,
    "ensight": ENSIGHT,
    "converge-before-3.1": CONVERGE,
    "cgns": CGNS,
    "cgns-polyhedra": POLYHEDRA,
    "fluent-dpm": FLUENT,
    "amrex": AMREX,
    "vtm": COLLECTION,
    "vtkhdf-steps": STEPS,
}


PIPES = [  # at which a reader would wait
    ("openfoam", "constant/polyMesh/owner", "owner: is missing"),
    ("openfoam", "0.001/T", "no cell field 'T'"),
    ("openfoam-gz", "constant/polyMesh/owner.gz", "owner: is missing"),
    ("openfoam-gz", "0.001/T.gz", "no cell field 'T'"),
    ("cgns", "a.cgns", r"a\.cgns: .*pipe"),
    ("vtkhdf-steps", "a.vtkhdf", r"a\.vtkhdf: .*pipe"),
    ("fluent-dpm", "run.cas.h5", r"run\.cas\.h5: .*pipe"),
    ("fluent-dpm", "drops.dpm", r"drops\.dpm: .*pipe"),
]
if hasattr(os, "mkfifo"):
    for kind, name, message in PIPES:
        TABLE[kind].append((name, pipe, message))


@pytest.mark.parametrize(
    ("kind", "files", "change", "message"),
    [(kind, *row) for kind, rows in TABLE.items() for row in rows],
)
def test_a_wrong_file_is_named(
    tmp_path: Path, kind: str, files: str, change: Change, message: str
) -> None:
    case = write_format(kind, tmp_path / "case", foam.sample())
    folder = case if case.is_dir() else case.parent
    keys = keys_of(kind, folder)
    for name in files.split():
        change(folder / name)
    if message:
        refused(case, message, **keys)
    else:
        assert notes_of(case, **keys)["gas_cells"] == 24


@pytest.mark.parametrize("times", [(0.001, 0.0005), (0.001, 0.001)])
def test_tables_that_state_their_times(tmp_path: Path, times: tuple[float, float]) -> None:
    case = write_format("tables", tmp_path, foam.sample())
    for name, mark, time in zip(("cells.csv", "drops.txt"), ", ", times, strict=True):
        remark, head, *rows = (tmp_path / name).read_text().splitlines()
        columns = [f"{head}{mark}Time", *(f"{row}{mark}{time}" for row in rows)]
        (tmp_path / name).write_text("\n".join([remark, *columns, ""]))
    if times[0] == times[1]:
        read(case)
    else:
        refused(case, r"drops\.txt: states the time 0\.0005, .*cells\.csv the time 0\.001")
