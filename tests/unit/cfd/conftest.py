"""Writes small OpenFOAM cases: a block of cells, fields and a cloud, in every form read."""

from __future__ import annotations

import gzip
import itertools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DIMENSIONS = {"rho": "1 -3 0 0 0 0 0", "T": "0 0 0 1 0 0 0", "p": "1 -1 -2 0 0 0 0"}


@dataclass
class Block:
    """nx x ny x nz cells between the coordinates in `edges`, sheared along x by `shear` * y."""

    edges: tuple[Array, Array, Array]
    shear: float = 0.0
    faces: list[tuple[int, ...]] = field(default_factory=list)
    owner: list[int] = field(default_factory=list)
    neighbour: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        nx, ny, nz = self.shape = tuple(len(edge) - 1 for edge in self.edges)

        def point(i: int, j: int, k: int) -> int:
            return i + (nx + 1) * (j + (ny + 1) * k)

        def cell(i: int, j: int, k: int) -> int:
            return i + nx * (j + ny * k)

        inner, outer = [], []
        for k, j, i in itertools.product(range(nz), range(ny), range(nx)):
            for axis, side in itertools.product(range(3), (0, 1)):
                there = [i, j, k]
                there[axis] += 2 * side - 1
                a, b = [(1, 2), (2, 0), (0, 1)][axis]
                corners = []
                for da, db in [(0, 0), (1, 0), (1, 1), (0, 1)][:: 2 * side - 1]:
                    corner = [i, j, k]
                    corner[axis] += side
                    corner[a] += da
                    corner[b] += db
                    corners.append(point(*corner))
                if not 0 <= there[axis] < self.shape[axis]:
                    outer.append((tuple(corners), cell(i, j, k)))
                elif side == 1:
                    inner.append((tuple(corners), cell(i, j, k), cell(*there)))
        self.faces = [face for face, *_ in inner] + [face for face, _ in outer]
        self.owner = [face[1] for face in inner] + [face[1] for face in outer]
        self.neighbour = [face[2] for face in inner]
        z, y, x = np.meshgrid(*self.edges[::-1], indexing="ij")
        self.points = np.stack([x + self.shear * y, y, z], axis=-1).reshape(-1, 3)

    @property
    def cells(self) -> int:
        return int(np.prod(self.shape))

    @property
    def hexahedra(self) -> NDArray[np.int64]:
        """Corners (N, 8) of the cells in the order of EnSight and vtk."""
        nx, ny, nz = self.shape
        corner = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nz + 1, ny + 1, nx + 1)
        low, high = slice(None, -1), slice(1, None)
        ring = [(low, low), (low, high), (high, high), (high, low)]
        layers = [layer[:, y, x] for layer in (corner[:-1], corner[1:]) for y, x in ring]
        return np.stack(layers, axis=-1).reshape(-1, 8)

    @property
    def volume(self) -> Array:
        """By the edges alone: shearing keeps volume."""
        x, y, z = (np.diff(edge) for edge in self.edges)
        return (z[:, None, None] * y[None, :, None] * x[None, None, :]).reshape(-1)

    @property
    def centre(self) -> Array:
        """Mean of the eight corners, the centroid of a parallelepiped."""
        corners: list[set[int]] = [set() for _ in range(self.cells)]
        for cell, face in itertools.chain(
            zip(self.owner, self.faces, strict=True), zip(self.neighbour, self.faces, strict=False)
        ):
            corners[cell] |= set(face)
        return np.array([self.points[sorted(own)].mean(axis=0) for own in corners])

    def barycentric(self, position: Array) -> tuple[Array, NDArray[np.int64]]:
        """Weights (N, 4) and labels (N, 3) of cell, face and tet point, by trying every tet."""
        labels, corners = [], []
        for index, face in enumerate(self.faces):
            cells = [self.owner[index], *self.neighbour[index : index + 1]]
            for cell, turn in itertools.product(cells, range(1, len(face) - 1)):
                labels.append((cell, index, turn))
                way = 1 if cell == self.owner[index] else -1
                corners.append([face[0], *face[turn : turn + 2][::way]])
        known = np.array(labels)
        tets = np.concatenate([self.centre[known[:, :1]], self.points[np.array(corners)]], axis=1)
        matrix = np.concatenate([tets, np.ones((len(tets), 4, 1))], axis=2).transpose(0, 2, 1)
        right = np.column_stack([position, np.ones(len(position))]).T
        weights = np.linalg.solve(matrix, np.broadcast_to(right, (len(tets), *right.shape)))
        best = weights.min(axis=1).argmax(axis=0)
        chosen = weights[best, :, np.arange(len(position))]
        assert chosen.min() > -1e-9, "the test's parcel lies outside the block"
        return chosen, known[best]


@dataclass
class Form:
    """How files are written."""

    binary: bool = False
    gz: bool = False
    label: int = 32
    scalar: int = 64

    def write(self, path: Path, kind: str, body: bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        arch = f'arch "LSB;label={self.label};scalar={self.scalar}";' if self.binary else ""
        mode = "binary" if self.binary else "ascii"
        head = f"FoamFile {{ version 2.0; format {mode}; {arch} class {kind}; "
        head += f"object {path.name}; }}\n// * * (1) //\n\n"
        content = head.encode() + body + b"\n\n// ****** //\n"
        if self.gz:
            path.with_name(path.name + ".gz").write_bytes(gzip.compress(content))
        else:
            path.write_bytes(content)

    def numbers(self, values: NDArray[np.generic]) -> bytes:
        """A list of scalars, vectors or labels."""
        kind = "i" if values.dtype.kind == "i" else "f"
        size = self.label if kind == "i" else self.scalar
        if self.binary:
            inside = values.astype(f"<{kind}{size // 8}").tobytes()
        elif values.ndim == 1:
            inside = b"\n" + b"\n".join(repr(v).encode() for v in values.tolist()) + b"\n"
        else:
            rows = (" ".join(map(repr, row)) for row in values.tolist())
            inside = b"\n" + b"\n".join(f"({row})".encode() for row in rows) + b"\n"
        return f"{len(values)}\n(".encode() + inside + b")\n"

    def faces(self, faces: list[tuple[int, ...]]) -> bytes:
        if self.binary:
            start = np.cumsum([0, *map(len, faces)])
            return self.numbers(start) + self.numbers(np.concatenate(faces))
        rows = (f"{len(face)}({' '.join(map(str, face))})" for face in faces)
        return f"{len(faces)}\n(\n".encode() + "\n".join(rows).encode() + b"\n)\n"

    def records(self, reals: Array, labels: NDArray[np.int64]) -> bytes:
        """Parcels: reals in brackets, then labels."""
        rows = []
        for real, label in zip(reals, labels, strict=True):
            if self.binary:
                raw = real.astype(f"<f{self.scalar // 8}").tobytes()
                rows.append(b"(" + raw + label.astype(f"<i{self.label // 8}").tobytes() + b")")
            else:
                rows.append(
                    f"({' '.join(map(repr, real.tolist()))}) {' '.join(map(str, label))}".encode()
                )
        return f"{len(rows)}\n(\n".encode() + b"\n".join(rows) + b"\n)\n"


def write_case(
    root: Path,
    block: Block,
    *,
    gas: Mapping[str, Array | float],
    cloud: Mapping[str, Array] | None = None,
    barycentric: str = "",
    form: Form | None = None,
    time: str = "0.001",
    name: str = "sprayCloud",
) -> Path:
    """A case of one time.

    `gas` holds values for every cell, or one for all; `cloud` has `position` and the fields;
    `barycentric` names the file for barycentric coordinates, which then replace the positions.
    """
    form = form or Form()
    mesh = root / "constant" / "polyMesh"
    form.write(mesh / "points", "vectorField", form.numbers(block.points))
    kind = "faceCompactList" if form.binary else "faceList"
    form.write(mesh / "faces", kind, form.faces(block.faces))
    form.write(mesh / "owner", "labelList", form.numbers(np.array(block.owner)))
    neighbour = np.array(block.neighbour, dtype=np.int64)
    form.write(mesh / "neighbour", "labelList", form.numbers(neighbour))
    patch = f"1\n(\nwalls {{ type wall; nFaces {len(block.owner) - len(neighbour)}; "
    patch += f"startFace {len(neighbour)}; }}\n)\n"
    Form().write(mesh / "boundary", "polyBoundaryMesh", patch.encode())
    control = b"startTime 0; endTime 1; deltaT 1e-3; writeControl timeStep; writeInterval 1;"
    Form().write(root / "system" / "controlDict", "dictionary", control)
    for key, values in gas.items():
        inside = f"uniform {values!r}".encode()
        if isinstance(values, np.ndarray):
            inside = b"nonuniform List<scalar>\n" + form.numbers(values)
        named = (d for n, d in DIMENSIONS.items() if re.search(f"(?i)(^|_){n}", key))
        powers = next(named, "0 0 0 0 0 0 0").encode()
        body = b"dimensions [" + powers + b"];\n\ninternalField " + inside + b";\n\n"
        body += b"boundaryField { walls { type zeroGradient; } }"
        form.write(root / time / key, "volScalarField", body)
    if cloud is not None:
        folder = root / time / "lagrangian" / name
        reals, labels = cloud["position"], np.zeros((len(cloud["position"]), 1), dtype=np.int64)
        if barycentric:
            reals, labels = block.barycentric(reals)
        form.write(
            folder / (barycentric or "positions"),
            "Cloud<passiveParticle>",
            form.records(reals, labels),
        )
        for key, values in cloud.items():
            if key != "position":
                kind = "vectorField" if values.ndim == 2 else "scalarField"
                form.write(folder / key, kind, form.numbers(values))
    return root


def changed(fields: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Fields with others, which are values, functions of those of the same name, or None."""
    others = {
        name: change(fields[name]) if callable(change) else change
        for name, change in changes.items()
    }
    return {name: values for name, values in {**fields, **others}.items() if values is not None}


@dataclass(frozen=True)
class Foam:
    """What the tests of this folder share."""

    block: type[Block] = Block
    form: type[Form] = Form
    write: Callable[..., Path] = write_case

    def case(
        self,
        folder: Path,
        *,
        gas: Mapping[str, Any] | None = None,
        cloud: Mapping[str, Any] | Literal[False] | None = None,
        **keys: Any,
    ) -> Path:
        """The sample as a case, with `keys` of `write_case`; cloud: False for gas alone.

        gas, cloud: fields that differ, as values, functions of the sample's, or None for none.
        """
        block, fields, parcels = self.sample(keys.pop("shear", 0.0))
        drops = None if cloud is False else changed(parcels, cloud or {})
        return self.write(folder, block, gas=changed(fields, gas or {}), cloud=drops, **keys)

    def sample(self, shear: float = 0.0) -> tuple[Block, dict[str, Array], dict[str, Array]]:
        """Block of 3 x 4 x 2 uneven cells, gas and 17 parcels, the same every time."""
        random = np.random.default_rng(7)
        edges = tuple(
            np.cumsum([start, *random.uniform(1e-3, 3e-3, count)])
            for start, count in ((-4e-3, 3), (0.0, 4), (-1e-3, 2))
        )
        block = Block((edges[0], edges[1], edges[2]), shear)
        gas = {
            "T": random.uniform(500.0, 800.0, block.cells),
            "p": random.uniform(4e6, 5e6, block.cells),
            "rho": random.uniform(15.0, 30.0, block.cells),
            "C7H16": random.uniform(0.0, 0.3, block.cells),
        }
        low, high = np.array([edge[0] for edge in edges]), np.array([edge[-1] for edge in edges])
        position = random.uniform(low, high, (17, 3))
        position[:, 0] += shear * position[:, 1]
        cloud = {
            "position": position,
            "d": random.uniform(2e-6, 4e-5, 17),
            "nParticle": random.uniform(0.5, 2e4, 17),
            "T": random.uniform(320.0, 500.0, 17),
            "rho": random.uniform(500.0, 660.0, 17),
            "U": random.normal((0.0, -80.0, 0.0), 5.0, (17, 3)),
        }
        return block, gas, cloud


foam = Foam()
