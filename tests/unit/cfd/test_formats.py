"""One small case in every format: the same masses, sizes and penetration; damage is noticed."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cldit.cli import main
from cldit.errors import SprayError
from cldit.scene.load import load_scene
from cldit.scene.schema import CfdSpray
from cldit.spray.cfd import read_cfd
from cldit.spray.formats import contents
from cldit.spray.result import Spray

if TYPE_CHECKING:
    from tests.unit.cfd.conftest import Foam

SET: dict[str, Any] = {"nozzle_m": (0.5e-3, 9e-3, 0.1e-3), "axis": "-y"}
FIGURES = (
    "liquid_mass_kg",
    "vapour_mass_kg",
    "sauter_mean_diameter_m",
    "liquid_penetration_m",
    "vapour_penetration_m",
    "droplets",
    "gas_temperature_max_K",
)
Sample = tuple[Any, dict[str, Any], dict[str, Any]]


def hexahedra(block: Any) -> Any:
    """Corners (N, 8) of the block's cells in the order of EnSight and vtk."""
    nx, ny, nz = block.shape
    corner = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nz + 1, ny + 1, nx + 1)
    lower, upper = slice(None, -1), slice(1, None)
    ring = [(lower, lower), (lower, upper), (upper, upper), (upper, lower)]
    layers = [layer[:, y, x] for layer in (corner[:-1], corner[1:]) for y, x in ring]
    return np.stack(layers, axis=-1).reshape(-1, 8)


class Out:
    """An EnSight file: text lines, or 80 characters and binary numbers."""

    def __init__(self, file: Path, binary: bool, order: str = "<", head: bool = False) -> None:
        self.file, self.binary, self.order, self.body = file, binary, order, b""
        if head and binary:
            self.text("C Binary")

    def text(self, line: str) -> None:
        self.body += line.encode().ljust(80) if self.binary else line.encode() + b"\n"

    def integers(self, values: Any, a_line: int = 1) -> None:
        values = np.asarray(values).reshape(-1)
        if self.binary:
            self.body += values.astype(f"{self.order}i4").tobytes()
            return
        for start in range(0, len(values), a_line):
            self.body += b"".join(b"%10d" % v for v in values[start : start + a_line]) + b"\n"

    def floats(self, values: Any, a_line: int = 1) -> None:
        values = np.asarray(values).reshape(-1)
        if self.binary:
            self.body += values.astype(f"{self.order}f4").tobytes()
            return
        for start in range(0, len(values), a_line):
            self.body += b"".join(b"%12.5e" % v for v in values[start : start + a_line]) + b"\n"

    def save(self) -> None:
        self.file.write_bytes(self.body)


def write_ensight(
    root: Path, sample: Sample, *, binary: bool, order: str = "<", polyhedra: bool = False
) -> Path:
    block, gas, cloud = sample
    root.mkdir(parents=True, exist_ok=True)
    lines = ["FORMAT", "type: ensight gold", "", "GEOMETRY", "model: case.geo"]
    lines += ["measured: 1 case.***.mgeo", "", "VARIABLE"]
    lines += [f"scalar per element: 1 {name} case.***.{name}" for name in gas]
    for name, values in cloud.items():
        if name != "position":
            kind = "vector" if values.ndim == 2 else "scalar"
            lines.append(f"{kind} per measured node: 1 {name} case.***.m_{name}")
    lines += ["", "TIME", "time set: 1", "number of steps: 2", "filename start number: 0"]
    lines += ["filename increment: 5", "time values: 0.0005", "0.001", ""]
    (root / "case.case").write_text("\n".join(lines))

    geo = Out(root / "case.geo", binary, order, head=True)
    for line in ("a block", "of cells", "node id off", "element id assign", "part"):
        geo.text(line)
    geo.integers(1)
    geo.text("internal")
    geo.text("coordinates")
    geo.integers(len(block.points))
    geo.floats(block.points.T)
    kind = "nfaced" if polyhedra else "hexa8"
    geo.text(kind)
    geo.integers(block.cells)
    if polyhedra:
        own: list[list[tuple[int, ...]]] = [[] for _ in range(block.cells)]
        for place, face in enumerate(block.faces):
            own[block.owner[place]].append(face)
            if place < len(block.neighbour):
                own[block.neighbour[place]].append(face[::-1])
        geo.integers([len(each) for each in own])
        geo.integers([len(face) for each in own for face in each])
        for face in itertools.chain.from_iterable(own):
            geo.integers(np.array(face) + 1, a_line=4)
    else:
        geo.integers(hexahedra(block) + 1, a_line=8)
    geo.text("part")  # walls, which hold no cell
    geo.integers(2)
    geo.text("walls")
    geo.text("coordinates")
    geo.integers(4)
    geo.floats(block.points[[0, 1, 5, 4]].T)
    geo.text("quad4")
    geo.integers(1)
    geo.integers([1, 2, 3, 4], a_line=4)
    geo.save()

    for number, share in ((0, 0.5), (5, 1.0)):
        for name, values in gas.items():
            out = Out(root / f"case.{number:03d}.{name}", binary, order)
            out.text(name)
            for part, many in ((1, values), (2, values[:1])):
                out.text("part")
                out.integers(part)
                out.text(kind if part == 1 else "quad4")
                out.floats(many * (share if name == "C7H16" else 1.0))
            out.save()
        out = Out(root / f"case.{number:03d}.mgeo", binary, order, head=True)
        out.text("parcels")
        out.text("particle coordinates")
        count = len(cloud["position"])
        if binary:
            out.integers(count)
            out.integers(np.arange(1, count + 1))
            out.floats(cloud["position"])
        else:
            out.body += b"%8d\n" % count
            for label, place in enumerate(cloud["position"], start=1):
                out.body += b"%8d%12.5e%12.5e%12.5e\n" % (label, *place)
        out.save()
        for name, values in cloud.items():
            if name != "position":
                out = Out(root / f"case.{number:03d}.m_{name}", binary, order)
                out.text(name)
                out.floats(values, a_line=6)
                out.save()
    return root / "case.case"


def write_converge(root: Path, sample: Sample, *, new: bool) -> Path:
    """Two times, one file each; radii; parcels as before 3.1 or after (`new`)."""
    h5py = pytest.importorskip("h5py")
    block, gas, cloud = sample
    root.mkdir(parents=True, exist_ok=True)
    for number, time in ((1, 0.0005), (2, 0.001)):
        with h5py.File(root / f"post{number:06d}_{time:.6e}.h5", "w") as file:
            file.attrs["OUTPUT_TIME"] = time
            file["BOUNDARIES/BOUNDARY_NAMES"] = np.array([b"walls"])
            file["BOUNDARIES/BOUNDARY_IDS"] = np.array([3], "i4")
            outer = len(block.owner) - len(block.neighbour)
            file["BOUNDARIES/NUM_ELEMENTS"] = np.array([outer], "i4")
            stream = file.create_group("STREAM_00")
            for name, column in zip("XYZ", block.points.T, strict=True):
                stream[f"VERTEX_COORDINATES/{name}"] = column.astype("f4")
            sides = np.full((len(block.owner), 2), -4)  # boundary 3
            sides[:, 1] = block.owner  # the boundary comes first: the face is turned
            sides[: len(block.neighbour), 0] = block.owner[: len(block.neighbour)]
            sides[: len(block.neighbour), 1] = block.neighbour
            faces = [
                face if place < len(block.neighbour) else face[::-1]
                for place, face in enumerate(block.faces)
            ]
            start = np.cumsum([0, *map(len, faces)])
            stream["CONNECTIVITY/POLYGON_OFFSET"] = start.astype("i4")
            stream["CONNECTIVITY/POLYGON_TO_VERTEX"] = np.concatenate(faces).astype("i4")
            stream["CONNECTIVITY/CONNECTED_CELLS"] = sides.reshape(-1).astype("i4")
            cells = {"T": "TEMPERATURE", "p": "PRESSURE", "rho": "DENSITY"}
            names = {cells.get(name, f"MASSFRAC_{name}"): name for name in gas}
            for name, key in names.items():
                stream[f"CELL_CENTER_DATA/{name}"] = gas[key].astype("f4")
            stream["VARIABLE_NAMES/CELL_VARIABLES"] = np.array([name.encode() for name in names])
            place = "PARCEL_DATA/LIQUID_PARCEL_DATA/LIQUID_1" if new else "PARCEL_DATA"
            parcel = {
                "RADIUS": cloud["d"] / 2,
                "NUM_DROP": cloud["nParticle"],
                "TEMP": cloud["T"],
                "DENSITY": cloud["rho"],
            }
            for letter, part, speed in zip("XYZ", cloud["position"].T, cloud["U"].T, strict=True):
                parcel |= {f"PARCEL_{letter}": part, f"VELOCITY_{letter}": speed}
            for name, values in parcel.items():
                stream[f"{place}/{name}"] = values.astype("f4")
            listed = "LIQUID_PARCEL_VARIABLES" if new else "PARCEL_VARIABLES"
            stream[f"VARIABLE_NAMES/{listed}"] = np.array([name.encode() for name in parcel])
    return root


def write_tables(root: Path, sample: Sample, **changes: Any) -> Path:
    """Centimetres, degrees Celsius, per cent, radii in um, parcels by their mass in mg."""
    block, gas, cloud = sample
    root.mkdir(parents=True, exist_ok=True)
    size = np.stack(np.meshgrid(*(np.diff(e) for e in block.edges), indexing="ij"), axis=-1)
    size = size.transpose(2, 1, 0, 3).reshape(-1, 3)
    mass = cloud["nParticle"] * cloud["rho"] * np.pi / 6 * cloud["d"] ** 3
    cells = [block.centre * 100, size * 100, gas["T"][:, None] - 273.15]
    cells += [gas["p"][:, None] / 1e5, gas["rho"][:, None], gas["C7H16"][:, None] * 100]
    drops = [cloud["position"] * 1000, cloud["d"][:, None] * 5e5, mass[:, None] * 1e6]
    drops += [cloud["T"][:, None], cloud["rho"][:, None], cloud["U"]]
    for name, header, columns, mark in (
        ("cells.csv", "x,y,z,dx,dy,dz,Temp,Pres,Dens,Fuel", cells, ","),
        ("drops.txt", "X Y Z R M T rho Ux Uy Uz", drops, " "),
    ):
        rows = np.concatenate(columns, axis=1).tolist()
        body = "".join(mark.join(map(repr, row)) + "\n" for row in rows)
        (root / name).write_text(f"made by a test\n{header.replace(',', mark)}\n{body}")
    mapping: dict[str, Any] = {
        "time_s": 0.001,
        "cells": {
            "file": "cells.csv",
            "header_line": 2,
            "position": {"columns": ["x", "y", "z"], "unit": "cm"},
            "size": {"columns": ["dx", "dy", "dz"], "unit": "cm"},
            "temperature": {"column": "Temp", "unit": "degC"},
            "pressure": {"column": "Pres", "unit": "bar"},
            "density": "Dens",
            "fuel": {"column": "Fuel", "unit": "%"},
        },
        "parcels": {
            "file": "drops.txt",
            "header_line": 2,
            "delimiter": " ",
            "position": {"columns": ["X", "Y", "Z"], "unit": "mm"},
            "velocity": ["Ux", "Uy", "Uz"],
            "radius": {"column": "R", "unit": "um"},
            "mass": {"column": "M", "unit": "mg"},
            "temperature": "T",
            "density": "rho",
        },
    }
    for key, value in changes.items():
        part, _, name = key.partition("_")
        mapping[part][name] = value
    file = root / "mapping.yaml"
    file.write_text(yaml.safe_dump(mapping))
    return file


# relative error of the figures: float64 text, float32, six digits in ascii, each through d^3 or V
WRITERS: dict[str, tuple[Callable[[Path, Sample], Path], float]] = {
    "tables": (write_tables, 1e-9),
    "ensight": (lambda root, sample: write_ensight(root, sample, binary=True), 5e-6),
    "ensight-big-endian": (
        lambda root, sample: write_ensight(root, sample, binary=True, order=">"),
        5e-6,
    ),
    "ensight-polyhedra": (
        lambda root, sample: write_ensight(root, sample, binary=True, polyhedra=True),
        5e-6,
    ),
    "ensight-ascii": (lambda root, sample: write_ensight(root, sample, binary=False), 5e-5),
    "ensight-ascii-polyhedra": (
        lambda root, sample: write_ensight(root, sample, binary=False, polyhedra=True),
        5e-5,
    ),
    "converge": (lambda root, sample: write_converge(root, sample, new=True), 5e-6),
    "converge-before-3.1": (lambda root, sample: write_converge(root, sample, new=False), 5e-6),
}


@pytest.mark.parametrize("kind", list(WRITERS))
def test_same_figures_in_every_format(tmp_path: Path, foam: Foam, kind: str) -> None:
    write, slack = WRITERS[kind]
    block, gas, cloud = sample = foam.sample()
    path = write(tmp_path / "other", sample)
    spray = read_cfd(CfdSpray(file=path, **SET))
    expected = read_cfd(
        CfdSpray(file=foam.write(tmp_path / "foam", block, gas=gas, cloud=cloud), **SET)
    )
    mass = np.sum(cloud["nParticle"] * cloud["rho"] * np.pi / 6 * cloud["d"] ** 3)
    assert spray.notes["liquid_mass_kg"] == pytest.approx(mass, rel=slack)
    vapour = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    assert spray.notes["vapour_mass_kg"] == pytest.approx(vapour, rel=slack)
    for name in FIGURES:
        assert spray.notes[name] == pytest.approx(expected.notes[name], rel=slack), name
    assert spray.notes["time_s"] == 0.001
    assert spray.parcels is not None
    assert expected.parcels is not None
    wanted = expected.parcels.position_m
    assert spray.parcels.position_m == pytest.approx(wanted, abs=10e-3 * slack, rel=0)
    found = contents(CfdSpray(file=path))
    assert found.format == kind.split("-")[0]
    assert found.times_s[-1] == 0.001
    assert len(found.clouds) == 1
    axis = {key: SET[key] for key in ("nozzle_m",)}
    inferred = read_cfd(CfdSpray(file=path, **axis))  # the velocity came over
    assert inferred.notes["axis_y"] == -1.0


def test_sheared_cells_and_earlier_time(tmp_path: Path, foam: Foam) -> None:
    block, gas, _ = sample = foam.sample(shear=0.4)
    vapour = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    for polyhedra in (False, True):
        path = write_ensight(tmp_path / str(polyhedra), sample, binary=True, polyhedra=polyhedra)
        now = read_cfd(CfdSpray(file=path, **SET)).notes
        assert now["vapour_mass_kg"] == pytest.approx(vapour, rel=5e-6)
        early = read_cfd(CfdSpray(file=path, time_s=0.0005, **SET)).notes
        assert early["vapour_mass_kg"] == pytest.approx(vapour / 2, rel=5e-6)
    folder = write_converge(tmp_path / "h5", sample, new=True)
    assert read_cfd(CfdSpray(file=folder, **SET)).notes["vapour_mass_kg"] == pytest.approx(
        vapour, rel=5e-6
    )
    first = min(folder.iterdir())
    assert read_cfd(CfdSpray(file=first, **SET)).notes["time_s"] == 0.0005
    with pytest.raises(SprayError, match=r"no time 0\.002 s .* available: 0\.0005, 0\.001"):
        read_cfd(CfdSpray(file=folder, time_s=0.002, **SET))


@pytest.mark.parametrize("new", [False, True])
def test_vtk_reads_the_same_post_file(tmp_path: Path, foam: Foam, new: bool) -> None:
    """That the layout written here is CONVERGE's is vtk's word, not the reader's own."""
    pytest.importorskip("vtk")
    from vtkmodules.vtkIOCONVERGECFD import vtkCONVERGECFDReader

    block, _, cloud = sample = foam.sample()
    folder = write_converge(tmp_path, sample, new=new)
    reader: Any = vtkCONVERGECFDReader()
    reader.SetFileName(str(min(folder.iterdir())))
    reader.Update()
    data = reader.GetOutputDataObject(0)
    parts = [data.GetPartition(n, 0) for n in range(data.GetNumberOfPartitionedDataSets())]
    mesh, parcels = parts[0], parts[-1]
    assert mesh.GetNumberOfCells() == block.cells
    assert parcels.GetNumberOfPoints() == len(cloud["d"])
    radius = parcels.GetPointData().GetArray("RADIUS").GetValue(3)
    assert 2 * radius == pytest.approx(cloud["d"][3], rel=1e-6)
    assert parcels.GetPointData().GetArray("VELOCITY").GetNumberOfComponents() == 3


@pytest.mark.parametrize("binary", [False, True])
def test_vtk_reads_the_same_ensight(tmp_path: Path, foam: Foam, binary: bool) -> None:
    pytest.importorskip("vtk")
    from vtkmodules.vtkIOEnSight import vtkEnSightGoldCombinedReader

    block, gas, cloud = sample = foam.sample()
    reader: Any = vtkEnSightGoldCombinedReader()
    reader.SetCaseFileName(str(write_ensight(tmp_path, sample, binary=binary)))
    reader.Update()
    data = reader.GetOutputDataObject(0)
    parts = [data.GetPartition(n, 0) for n in range(data.GetNumberOfPartitionedDataSets())]
    assert parts[0].GetNumberOfCells() == block.cells
    assert parts[0].GetCellData().GetArray("T").GetValue(5) == pytest.approx(gas["T"][5], rel=1e-5)
    drops = next(part for part in parts if part.GetPointData().GetArray("d") is not None)
    found = [drops.GetPointData().GetArray("d").GetValue(n) for n in range(17)]
    assert found == pytest.approx(cloud["d"], rel=1e-5)


@pytest.mark.parametrize("kind", ["ensight", "ensight-ascii", "converge", "tables"])
@pytest.mark.parametrize("left", [0.0, 0.3, 0.7, 0.97])
def test_truncated(tmp_path: Path, foam: Foam, kind: str, left: float) -> None:
    path = WRITERS[kind][0](tmp_path, foam.sample())
    early = [".000.", "post000001"]
    for file in sorted(tmp_path.iterdir()):
        if any(part in file.name for part in early) or file.suffix in (".case", ".yaml"):
            continue
        whole = file.read_bytes()
        file.write_bytes(whole[: int(left * len(whole))])
        with pytest.raises(SprayError, match=re.escape(str(file))):
            read_cfd(CfdSpray(file=path, **SET))
        file.write_bytes(whole)
    assert read_cfd(CfdSpray(file=path, **SET)).notes["parcels"] == 17


def changed(values: Any, entry: int, value: float) -> Any:
    return np.where(np.arange(len(values)) == entry, value, values)


WRONG: list[tuple[str, str, float, str]] = [
    ("cloud", "d", -9e-6, "(RADIUS|m_d|column R).*-"),
    ("cloud", "d", 9.0, "is outside 1e-09..0.005"),
    ("cloud", "T", np.nan, "nan .entry 3."),
    ("cloud", "nParticle", -5.0, "entry 3"),
    ("gas", "T", np.nan, "nan .entry 3."),
    ("gas", "C7H16", 1.5, "mass fraction"),
    ("gas", "rho", -1.0, "density in kg/m3"),
]


@pytest.mark.parametrize("kind", ["ensight", "ensight-ascii", "converge", "tables"])
@pytest.mark.parametrize(("part", "name", "value", "message"), WRONG)
def test_impossible_values(
    tmp_path: Path, foam: Foam, kind: str, part: str, name: str, value: float, message: str
) -> None:
    block, gas, cloud = foam.sample()
    values = {"gas": gas, "cloud": cloud}[part]
    values[name] = changed(values[name], 3, value)
    path = WRITERS[kind][0](tmp_path, (block, gas, cloud))
    with pytest.raises(SprayError, match=message) as caught:
        read_cfd(CfdSpray(file=path, **SET))
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize("kind", ["ensight", "ensight-ascii", "converge", "tables"])
def test_wrong_units(tmp_path: Path, foam: Foam, kind: str) -> None:
    def refused(message: str, block: Any, gas: Any, cloud: Any) -> None:
        path = WRITERS[kind][0](tmp_path, (block, gas, cloud))
        with pytest.raises(SprayError, match=message):
            read_cfd(CfdSpray(file=path, **SET))

    block, gas, cloud = foam.sample()
    far = cloud["position"] * 1000
    refused("parcel 0 at .* is outside the mesh", block, gas, cloud | {"position": far})
    refused("another unit than kg/m3, K, Pa", block, gas | {"rho": gas["rho"] / 1000}, cloud)
    refused("another unit than kg/m3, K, Pa", block, gas | {"p": gas["p"] / 1e5}, cloud)
    refused("mass fraction", block, gas | {"C7H16": gas["C7H16"] * 100}, cloud)
    big = foam.block(tuple(edge * 5000 for edge in block.edges))  # type: ignore[arg-type]
    refused("m wide, allowed is 10 m; .* metres", big, gas, cloud | {"position": far * 5})


def test_mapping_of_ensight_and_converge(tmp_path: Path, foam: Foam) -> None:
    block, gas, cloud = foam.sample()
    expected = np.sum(cloud["nParticle"] * 700.0 * np.pi / 6 * cloud["d"] ** 3)
    odd = {"position": cloud["position"], "halfmicron": cloud["d"] * 5e5} | {
        "n": cloud["nParticle"],
        "temp": cloud["T"],
    }
    path = write_ensight(tmp_path, (block, gas, odd), binary=True)
    with pytest.raises(SprayError, match=r"halfmicron, n, temp.*: cloud .* has no field 'd'"):
        read_cfd(CfdSpray(file=path, **SET))
    mapping = tmp_path / "names.yaml"
    mapping.write_text(
        "parcels: {radius: {column: halfmicron, unit: um}, number: n, temperature: temp,\n"
        "  density: 700}\n"
    )
    notes = read_cfd(CfdSpray(file=path, mapping=mapping, **SET)).notes
    assert notes["liquid_mass_kg"] == pytest.approx(expected, rel=1e-6)
    h5py = pytest.importorskip("h5py")
    folder = write_converge(tmp_path / "h5", (block, gas, cloud), new=False)
    with h5py.File(max(folder.iterdir()), "r+") as file:
        del file["STREAM_00/PARCEL_DATA/DENSITY"]
    with pytest.raises(SprayError, match="has no field 'rho'"):
        read_cfd(CfdSpray(file=folder, **SET))
    mapping.write_text("parcels: {density: 700}")
    notes = read_cfd(CfdSpray(file=folder, mapping=mapping, **SET)).notes
    assert notes["liquid_mass_kg"] == pytest.approx(expected, rel=1e-6)
    case = foam.write(tmp_path / "foam", block, gas=gas, cloud=cloud)
    with pytest.raises(SprayError, match=r"spray.mapping is for ensight and converge"):
        read_cfd(CfdSpray(file=case, mapping=mapping, **SET))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("cells_temperature", "Tmp", r"cells.csv: no column 'Tmp' \(cells.temperature\); it has:"),
        ("cells_fuel", {"column": "Fuel", "unit": "ppm"}, "unit 'ppm' is unknown; allowed .* 1, %"),
        ("cells_fuel", None, "no cell field 'C7H16'"),
        ("cells_file", "none.csv", r"none\.csv: cannot be read"),
        ("cells_volume", "dx", "either size or volume"),
        ("cells_size", ["dx", "dy", "Zero"], "no column 'Zero'"),
        ("cells_header_line", 3, "none of the mapped columns"),
        ("cells_colour", 3, "cells.colour: unknown key; allowed: "),
        ("parcels_diameter", "R", "diameter and radius are both given"),
        ("parcels_density", None, "has no field 'nParticle'"),
        ("parcels_density", 0.7, "density"),
    ],
)
def test_mapping_that_is_wrong(
    tmp_path: Path, foam: Foam, key: str, value: Any, message: str
) -> None:
    path = write_tables(tmp_path, foam.sample(), **{key: value})
    with pytest.raises(SprayError, match=message):
        read_cfd(CfdSpray(file=path, **SET))


def test_cells_by_volume(tmp_path: Path, foam: Foam) -> None:
    block, gas, cloud = foam.sample()
    path = write_tables(tmp_path, (block, gas, cloud))
    lines = (tmp_path / "cells.csv").read_text().splitlines()
    volumes = ["Vol", *(repr(value) for value in (block.volume * 1e9).tolist())]
    joined = [f"{line},{volume}" for line, volume in zip(lines[1:], volumes, strict=True)]
    (tmp_path / "cells.csv").write_text("\n".join(["x", *joined, ""]))
    mapping = yaml.safe_load(path.read_text())
    del mapping["cells"]["size"]
    mapping["cells"]["volume"] = {"column": "Vol", "unit": "mm3"}
    path.write_text(yaml.safe_dump(mapping))
    notes = read_cfd(CfdSpray(file=path, **SET)).notes
    mass = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    assert notes["vapour_mass_kg"] == pytest.approx(mass, rel=1e-9)
    (tmp_path / "cells.csv").write_text("\n".join(["x", joined[0], ""]))
    with pytest.raises(SprayError, match=r"cells\.csv: holds no row below its header"):
        read_cfd(CfdSpray(file=path, **SET))
    (tmp_path / "cells.csv").write_text("\n".join(["x", *joined, "1,2,3,4,5,6,oops,1,1,1,1", ""]))
    with pytest.raises(SprayError, match=r"cells\.csv: its columns .* are not all numbers"):
        read_cfd(CfdSpray(file=path, **SET))


def same(one: Spray, two: Spray) -> bool:
    assert one.parcels is not None
    assert two.parcels is not None
    assert one.vapour is not None
    assert two.vapour is not None
    return (
        one.notes == two.notes
        and one.remarks == two.remarks
        and all(
            np.array_equal(getattr(one.parcels, name), getattr(two.parcels, name))
            for name in ("position_m", "diameter_m", "droplets", "temperature_K", "density_kg_m3")
        )
        and np.array_equal(one.vapour.cells.lower_m, two.vapour.cells.lower_m)
        and np.array_equal(one.vapour.number_density_m3, two.vapour.number_density_m3)
    )


def test_command(tmp_path: Path, foam: Foam) -> None:
    block, gas, cloud = foam.sample()
    case = foam.write(tmp_path / "case", block, gas=gas, cloud=cloud)
    out = tmp_path / "spray.npz"

    def called(*arguments: str, code: int = 0) -> str:
        result = CliRunner().invoke(main, ["import", *arguments])
        assert result.exit_code == code, result.output
        return result.output

    text = called(str(case), "--list")
    assert "format: openfoam" in text
    assert "times in s: 0.001" in text
    assert "cell fields: C7H16, T, p, rho" in text
    assert "cloud sprayCloud: T, U, d, nParticle, positions, rho" in text
    place = ["--nozzle", "0.0005", "0.009", "0.0001", "--axis", "0,-1,0"]
    text = called(str(case), *place, "--out", str(out))
    told = read_cfd(CfdSpray(file=case, **SET))
    assert re.search(rf"liquid mass +{told.notes['liquid_mass_kg'] * 1e6:.5g} mg", text)
    assert re.search(r"Sauter mean diameter +\d", text)
    assert re.search(r"liquid penetration .* mm", text)
    assert same(read_cfd(CfdSpray(file=out)), told)
    assert "format: cldit" in called(str(out), "--list")
    assert "is no direction" in called(str(case), "--axis", "0,-1,up", code=2)
    assert not list(tmp_path.glob("*.part"))
    wrong = called(str(case), "--fuel-field", "fuel", "--out", str(tmp_path / "no.npz"), code=1)
    assert "no cell field 'fuel'" in wrong
    assert not (tmp_path / "no.npz").exists()
    assert "ends in .npz" in called(str(case), *place, "--out", str(tmp_path / "a.h5"), code=1)


def test_own_file_that_is_damaged(tmp_path: Path, foam: Foam) -> None:
    block, gas, cloud = foam.sample()
    case = foam.write(tmp_path / "case", block, gas=gas, cloud=cloud)
    out = tmp_path / "spray.npz"
    result = CliRunner().invoke(main, ["import", str(case), "--axis", "-y", "--out", str(out)])
    assert result.exit_code == 0, result.output
    whole = out.read_bytes()
    for left in (0.0, 0.3, 0.9, 0.99):
        out.write_bytes(whole[: int(left * len(whole))])
        with pytest.raises(SprayError, match=re.escape(str(out))):
            read_cfd(CfdSpray(file=out))
    out.write_bytes(whole)
    expected, noticed = read_cfd(CfdSpray(file=out)), 0
    places = np.linspace(0, len(whole) - 1, 60).astype(int).tolist()
    for place in places:  # some hit only dates in the archive, which do not matter
        flipped = bytearray(whole)
        flipped[place] ^= 0xFF
        out.write_bytes(bytes(flipped))
        try:
            assert same(read_cfd(CfdSpray(file=out)), expected)
        except SprayError as error:
            assert str(out) in str(error)
            noticed += 1
    assert noticed > len(places) / 2
    out.write_bytes(whole)
    with pytest.raises(SprayError, match=r"spray\.axis was settled when the case was imported"):
        read_cfd(CfdSpray(file=out, axis="-y"))
    with pytest.raises(SprayError, match=r"no time 0\.5 s"):
        read_cfd(CfdSpray(file=out, time_s=0.5))
    with np.load(out) as archive:
        arrays = dict(archive)
    for name, change, message in (
        ("parcels/diameter_m", lambda v: -v, r"spray\.npz: parcels\.diameter_m: -"),
        ("vapour/temperature_K", lambda v: v * np.nan, r"vapour\.temperature_K: .* not finite"),
        ("parcels/droplets", None, r"spray\.npz: parcels/droplets is missing"),
        ("about", lambda v: np.array(str(v).replace('"layout": 1', '"layout": 9')), "layout 9"),
    ):
        kept = {key: value for key, value in arrays.items() if key != name}
        if change is not None:
            kept[name] = change(arrays[name])
        np.savez_compressed(out, **kept)
        with pytest.raises(SprayError, match=message):
            read_cfd(CfdSpray(file=out))


@pytest.mark.parametrize("points", [2, 7, 16])
def test_spread_keeps_mass_and_place(tmp_path: Path, foam: Foam, points: int) -> None:
    block, gas, cloud = foam.sample()
    case = foam.write(tmp_path, block, gas=gas, cloud=cloud)
    keys: dict[str, Any] = {"file": case, "spread_points": points, **SET}
    one = read_cfd(CfdSpray(**keys)).parcels
    two = read_cfd(CfdSpray(spread_m=0.3e-3, **keys)).parcels
    assert one is not None
    assert two is not None
    assert len(two.droplets) == points * len(one.droplets)
    # sums of rounded shares: 17 x 16 of them
    assert two.mass_kg == pytest.approx(one.mass_kg, rel=1e-13)
    assert two.sauter_mean_diameter_m == pytest.approx(one.sauter_mean_diameter_m, rel=1e-13)
    cloudlets = two.position_m.reshape(-1, points, 3)
    assert cloudlets.mean(axis=1) == pytest.approx(one.position_m, abs=1e-15)
    away = np.linalg.norm(cloudlets - one.position_m[:, None], axis=2)
    assert away.max() <= 0.3e-3 * (1 + 1e-12)
    again = read_cfd(CfdSpray(spread_m=0.3e-3, **keys)).parcels
    other = read_cfd(CfdSpray(spread_m=0.3e-3, seed=2, **keys)).parcels
    assert again is not None
    assert other is not None
    assert np.array_equal(again.position_m, two.position_m)
    assert not np.array_equal(other.position_m, two.position_m)


def test_spread_fills_the_ball_evenly() -> None:
    """Half of the droplets lie within the radius of half the volume."""
    from cldit.spray.result import Parcels
    from cldit.spray.spread import spread

    one = Parcels(np.zeros((1, 3)), *(np.array([v]) for v in (1e-5, 1e6, 300.0, 700.0)))
    many = spread(one, radius_m=1e-3, points=20_000, seed=5)
    away = np.linalg.norm(many.position_m, axis=1)
    # 10000 independent pairs: standard error of the share 0.005, four of them
    assert np.mean(away < 1e-3 * 0.5 ** (1 / 3)) == pytest.approx(0.5, abs=0.02)


def test_scene_finds_its_files(tmp_path: Path, foam: Foam) -> None:
    path = write_ensight(tmp_path / "data", foam.sample(), binary=True)
    (tmp_path / "names.yaml").write_text("parcels: {density: 700}")
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "name: s\nspray: {model: cfd, format: ensight, file: data/case.case,\n"
        "  mapping: names.yaml, axis: -y}\n"
    )
    spray = load_scene(scene).spray
    assert isinstance(spray, CfdSpray)
    assert spray.file == path
    assert spray.mapping == tmp_path / "names.yaml"
    assert read_cfd(spray).notes["parcels"] == 17
