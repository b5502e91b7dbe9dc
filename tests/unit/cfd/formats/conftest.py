"""Writes one small case in every format that is not OpenFOAM's or vtk's own."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

Sample = tuple[Any, dict[str, Any], dict[str, Any]]


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

    def variable(self, name: str, *parts: tuple[int, str, Any]) -> None:
        """A whole variable: part, kind of its elements, and values, for each part."""
        self.text(name)
        for number, kind, values in parts:
            self.text("part")
            self.integers(number)
            self.text(kind)
            self.floats(values)
        self.save()

    def save(self) -> None:
        self.file.write_bytes(self.body)


def write_geometry(geo: Out, block: Any, *, polyhedra: bool) -> None:
    """A part of the cells of a block, and one of walls."""
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
        geo.integers(block.hexahedra + 1, a_line=8)
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

    write_geometry(Out(root / "case.geo", binary, order, head=True), block, polyhedra=polyhedra)
    kind = "nfaced" if polyhedra else "hexa8"
    for number, share in ((0, 0.5), (5, 1.0)):
        for name, values in gas.items():
            now = values * (share if name == "C7H16" else 1.0)
            out = Out(root / f"case.{number:03d}.{name}", binary, order)
            out.variable(name, (1, kind, now), (2, "quad4", now[:1]))
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
