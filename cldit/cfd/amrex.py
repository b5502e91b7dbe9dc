"""AMReX plotfiles (PeleLMeX): the finest cells of all levels, and particles with their fields.

Layout after AMReX's writers (WriteGenericPlotfileHeader, VisMF::Header, FABio,
WriteBinaryParticleData); names of the particles' fields are those of PelePhysics. Particles are in
the byte order of the machine that wrote them, which is taken to be little-endian.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from cldit.arrays import Floats, Ints, Mask
from cldit.cfd.case import CfdCase, Column, Listing, choose_cloud, choose_file
from cldit.cfd.inputs import HEAD_BYTES, Size, check_room, regular, text_of
from cldit.cfd.mapping.columns import Fields, MeshPart, join_gas, mapped_cloud
from cldit.cfd.mapping.file import ColumnMap, ParcelColumns
from cldit.cfd.mesh.cells import AnyFloats
from cldit.cfd.mesh.elements import BoxMesh
from cldit.cfd.tolerances import ROUNDED
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.io.progress import Watch
from cldit.scene.spray import CfdSpray

AMREX_NAMES = {
    "temperature": ("temp", "Temp"),
    "pressure": ("RhoRT",),
    "density": ("density",),
    "fuel": ("{}", "Y({})"),
}
AMREX_PARCELS = ParcelColumns.model_validate(
    {
        "diameter": "diam",
        "number": "number_density",
        "temperature": "temperature",
        "density": "rho",
        "velocity": ["xvel", "yvel", "zvel"],
    }
)
_SOLID = ("volFrac", "vfrac")  # share of a cell outside embedded boundaries
_CGS = "rho_E"  # a field of PeleC and Castro, whose units are cm, g, s
_TRIPLE = r"\(\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*\)"
_BOX = re.compile(rf"\(\s*{_TRIPLE}\s*{_TRIPLE}\s*\(0,0,0\)\s*\)")
_FAB = re.compile(rb"FAB (\(\(8, .*?\)\)\))(\(\(.*\)) (\d+)\n")
_REALS = {  # form and order of bytes in the head of a FAB
    b"((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1)))": "<f8",
    b"((8, (64 11 52 0 1 12 0 1023)),(8, (1 2 3 4 5 6 7 8)))": ">f8",
    b"((8, (32 8 23 0 1 9 0 127)),(4, (4 3 2 1)))": "<f4",
    b"((8, (32 8 23 0 1 9 0 127)),(4, (1 2 3 4)))": ">f4",
}


@dataclass(frozen=True)
class _Grid:
    """Box of cells from index low to high (3,), and its FAB: a file, and where it begins.

    size_m: edges (3,) of a cell; low_m: place (3,) of the corner of the cell of index 0. ranges:
    least and largest value (2, C) of each component. kept: mask (N,) of the cells that are used.
    """

    low: Ints
    high: Ints
    size_m: Floats
    low_m: AnyFloats
    grown: int
    data: tuple[Path, int]
    ranges: Floats
    kept: Mask


def plotfiles(path: Path) -> list[Path]:
    """Folder of a plotfile, by itself or its Header, or those in a folder of several."""
    folder = path.parent if path.name == "Header" else path
    if (folder / "Level_0").is_dir() and (folder / "Header").is_file():
        return [folder]
    return sorted(head.parent.parent for head in path.glob("*/Level_0/Cell_H"))


def read_amrex(spec: CfdSpray, names: ColumnMap, watch: Watch) -> CfdCase:
    """Reads one time: a plotfile, or one of several in a folder."""
    path = _chosen(spec)[1]
    field_names, time_s, lines = _head(path)
    levels, files = _levels(path, len(field_names), lines)
    grids = [grid for level in levels for grid in level]
    clouds = _clouds(path)
    chosen = choose_cloud(str(path), clouds, spec.cloud)
    cells = sum(grid.kept.size for grid in grids)
    data = [] if chosen is None else list(clouds[chosen].glob("Level_*/DATA_*"))
    stored = sum(file.stat().st_size for file in data)
    check_room(path, Size(cells, 0, 100.0 * cells + 5.0 * stored))
    for level, finer in pairwise(levels):
        _cover(level, finer)

    def read(name: str) -> Column:
        watch(f"reading {name}", 0, 1)
        values = [_values(grid, field_names, field_names.index(name))[grid.kept] for grid in grids]
        return Column(f"{path}: cell field {name}", np.concatenate(values))

    remarks: list[str] = []
    share: AnyFloats = np.ones(1)
    if (solid := next((name for name in _SOLID if name in field_names), None)) is not None:
        share = read(solid).values
        ends = np.cumsum([int(grid.kept.sum()) for grid in grids])[:-1]
        for grid, shares in zip(grids, np.split(share, ends), strict=True):
            grid.kept[grid.kept] = shares > 0.0
        if hidden := int(np.sum(share <= 0.0)):
            remarks.append(f"{path}: {hidden} cells in solid bodies ({solid}) were omitted.")
        share = share[share > 0.0]
    middle, edges = (np.concatenate(arrays) for arrays in zip(*map(_cells, grids), strict=True))
    half = edges / 2 * np.cbrt(share)[:, None]
    mesh = BoxMesh(middle - half, middle + half, str(path / "Header"))
    part = MeshPart(str(path), mesh, Fields(field_names, read))
    gas = join_gas(path, [part], names.cells, spec.fuel_field, AMREX_NAMES)
    cloud = None
    if chosen is not None:
        folder = clouds[chosen]
        place, columns, omitted = _particles(folder)
        cloud = mapped_cloud(chosen, str(folder), place, columns, names, AMREX_PARCELS)
        files, remarks = [*files, folder / "Header", *sorted(data)], [*remarks, *omitted]
    return replace(gas, time_s=time_s, cloud=cloud, files=tuple(files), remarks=tuple(remarks))


def list_amrex(spec: CfdSpray) -> Listing:
    """Lists times [s], cell fields, and clouds with their fields, at the time asked for."""
    times, path = _chosen(spec)
    clouds = {name: list(_particles(folder)[1]) for name, folder in _clouds(path).items()}
    return times, _head(path)[0], clouds


def _chosen(spec: CfdSpray) -> tuple[list[float], Path]:
    """Times of the plotfiles, and the plotfile at that asked for."""
    by_time: dict[float, list[Path]] = {}
    for path in plotfiles(spec.file):
        by_time.setdefault(_head(path)[1], []).append(path)
    return list(by_time), choose_file(str(spec.file), by_time, spec.time_s)[1]


def _clouds(path: Path) -> dict[str, Path]:
    heads = [head for head in path.glob("*/Header") if text_of(head).startswith("Version_")]
    return {head.parent.name: head.parent for head in heads}


def _damaged(file: Path, reason: str) -> SprayError:
    return SprayError(f"{file}: is damaged or truncated, or no plotfile of AMReX ({reason})")


def _head(path: Path) -> tuple[list[str], float, list[str]]:
    """Names of the fields, the time, and the lines that follow it."""
    lines = text_of(path / "Header").splitlines()
    try:
        count = int(lines[1])
        names = [line.strip() for line in lines[2 : 2 + count]]
        dimension, time, rest = int(lines[2 + count]), float(lines[3 + count]), lines[4 + count :]
    except (ValueError, IndexError) as error:
        raise _damaged(path / "Header", str(error)) from error
    if dimension != 3 or _CGS in names:
        units = f"{_CGS}, of PeleC, whose units are cm, g, s"
        fault = f"{dimension} dimensions" if dimension != 3 else units
        raise SprayError(f"{path / 'Header'}: has {fault}; allowed: three dimensions, in m, kg, s")
    return names, time, rest


def _levels(path: Path, fields: int, lines: list[str]) -> tuple[list[list[_Grid]], list[Path]]:
    """Boxes of each level, by the lines of the Header after the time; and the files read."""
    head = path / "Header"
    try:
        finest = int(lines[0])
        low_m = np.array([float(word) for word in lines[1].split()])
        domains = [np.array(box, np.int64) for box in _BOX.findall(lines[4])]
        sizes = [np.array([float(w) for w in line.split()]) for line in lines[6 : 7 + finest]]
        coordinates, places = int(lines[7 + finest]), []
        at = 9 + finest
        for _ in range(finest + 1):
            places.append(path / f"{lines[at + 2 + 3 * int(lines[at].split()[1])].strip()}_H")
            at += 3 + 3 * int(lines[at].split()[1])
    except (ValueError, IndexError) as error:
        raise _damaged(head, str(error)) from error
    if coordinates != 0 or len(domains) != finest + 1 or any(len(s) != 3 for s in (low_m, *sizes)):
        raise _damaged(head, f"coordinates {coordinates}, {len(domains)} levels of {finest + 1}")
    levels = []
    for domain, size, file in zip(domains, sizes, places, strict=True):
        levels.append(_grids(file, fields, size, low_m - size * domain[:3].astype(float)))
    domain_cells = int((domains[0][3:6] - domains[0][:3] + 1).prod())
    if (cells := sum(grid.kept.size for grid in levels[0])) != domain_cells:
        raise _damaged(places[0], f"{cells} cells of {domain_cells} of the domain")
    data = sorted({grid.data[0] for level in levels for grid in level})
    return levels, [head, *places, *data]


def _grids(file: Path, components: int, size_m: Floats, low_m: AnyFloats) -> list[_Grid]:
    """Boxes of a level by its Cell_H."""
    header = text_of(file)
    boxes = np.array(_BOX.findall(header), np.int64).reshape(-1, 6)
    places = re.findall(r"^FabOnDisk: (\S+) (\d+)$", header, re.MULTILINE)
    begin = [match.end() for match in re.finditer(r"^\d+,\d+\n", header, re.MULTILINE)]
    try:
        version, _, stated, grown = (int(line) for line in header.splitlines()[:4])
        shape = len(places), components
        tables = [header[place:].split("\n\n")[0].replace(",", " ").split() for place in begin]
        ranges = np.array(tables, np.float64).reshape(2, *shape)
    except ValueError as error:
        raise _damaged(file, str(error)) from error
    if version != 1 or stated != components or not len(boxes) == len(places) > 0:
        fault = f"version {version}; allowed: 1; {stated} components, {components} in the Header; "
        raise _damaged(file, f"{fault}{len(places)} arrays of {len(boxes)} boxes")
    where = [(file.parent / name, int(place)) for name, place in places]
    return [
        _Grid(
            box[:3], box[3:], size_m, low_m, grown, data, extremes,
            np.ones(int((box[3:] - box[:3] + 1).prod()), bool),
        )
        for box, data, extremes in zip(boxes, where, ranges.swapaxes(0, 1), strict=True)
    ]  # fmt: skip


def _cover(level: list[_Grid], finer: list[_Grid]) -> None:
    """Marks the cells of a level that boxes of the next one cover."""
    ratio = np.rint(level[0].size_m / finer[0].size_m).astype(np.int64)
    lows, ends = (np.array([getattr(grid, end) for grid in finer]) for end in ("low", "high"))
    low, high = lows // ratio, ends // ratio
    if np.any(lows % ratio) or np.any((ends + 1) % ratio):
        raise _damaged(finer[0].data[0].parent / "Cell_H", "boxes that cover parts of coarse cells")
    for grid in level:
        kept = grid.kept.reshape((grid.high - grid.low + 1)[::-1])
        for over in np.flatnonzero(np.all((low <= grid.high) & (high >= grid.low), axis=1)):
            begin, end = np.maximum(low[over] - grid.low, 0), high[over] - grid.low + 1
            kept[tuple(slice(a, b) for a, b in zip(begin[::-1], end[::-1], strict=True))] = False


def _cells(grid: _Grid) -> tuple[Floats, Floats]:
    """Middles and edges (N, 3) of the cells that are used, x fastest."""
    shape = (grid.high - grid.low + 1)[::-1]
    index = np.stack(np.unravel_index(np.flatnonzero(grid.kept), shape)[::-1], axis=1)
    middle = grid.low_m + (index + grid.low + 0.5) * grid.size_m
    return middle, np.broadcast_to(grid.size_m, middle.shape)


def _values(grid: _Grid, names: Sequence[str], part: int) -> AnyFloats:
    """Values (N,) of a component in all cells of a box, which must be in the range of Cell_H."""
    file, begin = grid.data
    shape = (grid.high - grid.low + 1 + 2 * grid.grown)[::-1]
    with open_regular(regular(file)) as stream:
        stream.seek(begin)
        head = _FAB.match(stream.read(HEAD_BYTES))
        box = None if head is None else _BOX.search(head.group(2).decode("latin-1"))
        if head is None or box is None or head.group(1) not in _REALS:
            raise _damaged(file, f"no FAB of 4 or 8 bytes a number at {begin}")
        bounds = np.array(box.groups(), np.int64)
        grown = np.concatenate([grid.low - grid.grown, grid.high + grid.grown])
        if int(head.group(3)) != len(names) or np.any(bounds != grown):
            fault = f"{head.group(3).decode()} components in {box.group()}"
            raise _damaged(file, f"{fault} at {begin}, but Cell_H has {len(names)} in another box")
        number, cells = np.dtype(_REALS[head.group(1)]), int(shape.prod())
        stream.seek(begin + head.end() + part * cells * number.itemsize)
        content = stream.read(cells * number.itemsize)
    if len(content) < cells * number.itemsize:
        have = len(content) // number.itemsize
        raise _damaged(file, f"{names[part]} ends after {have} of {cells} values")
    inner = slice(grid.grown, -grid.grown or None)
    values = np.frombuffer(content, number).reshape(shape)[inner, inner, inner]
    extremes = np.array([values.min(), values.max()], np.float64)
    stated = grid.ranges[:, part]
    # Cell_H has ranges of doubles; floats differ by 2^-24 = 6e-8
    if np.any(np.abs(extremes - stated) > ROUNDED * np.abs(stated).max()):
        shown, right = (f"{low:.9g} to {high:.9g}" for low, high in (extremes, stated))
        raise _damaged(file, f"{names[part]} at {begin} is {shown}, by Cell_H {right}")
    return values.reshape(-1).astype(values.dtype.newbyteorder("="))


def _particles(folder: Path) -> tuple[Column, dict[str, Column], list[str]]:
    """Positions (N, 3) and fields (N,) of the particles of all levels; remarks on omitted ones.

    A file has whole numbers of all particles of a box, then real ones, then those of the next box.
    """
    head = folder / "Header"
    words = text_of(head).split()
    kind = re.fullmatch(r"Version_Two_Dot_Zero_(single|double)", words[0])
    if kind is None:
        allowed = "Version_Two_Dot_Zero_single, _double (a plotfile, no checkpoint)"
        raise SprayError(f"{head}: is of {words[0]}; allowed: {allowed}")
    number = np.dtype("<f8" if kind.group(1) == "double" else "<f4")
    try:
        reals = int(words[2])
        integers = int(words[3 + reals])
        at = 4 + reals + integers
        real_names, integer_names = words[3 : 3 + reals], words[4 + reals : at]
        total, finest = int(words[at + 1]), int(words[at + 3])
        boxes = [int(word) for word in words[at + 4 : at + 5 + finest]]
        rows = np.array(words[at + 5 + finest :], np.int64).reshape(sum(boxes), 3)
    except (ValueError, IndexError) as error:
        raise _damaged(head, str(error)) from error
    if words[1] != "3" or rows[:, 1].sum() != total:
        raise _damaged(head, f"{rows[:, 1].sum()} particles of {total}, in {words[1]} dimensions")
    level = np.repeat(np.arange(finest + 1), boxes)
    width = 4 * (2 + integers), number.itemsize * (3 + reals)
    integer_parts, real_parts = [np.empty((0, 2 + integers))], [np.empty((0, 3 + reals))]
    filled = np.column_stack([level, rows])[rows[:, 1] > 0]
    for at_level, file_index in np.unique(filled[:, :2], axis=0):
        file = folder / f"Level_{at_level}" / f"DATA_{file_index:05d}"
        blocks = filled[np.all(filled[:, :2] == [at_level, file_index], axis=1), 1:]
        blocks = blocks[np.argsort(blocks[:, 2])]
        with open_regular(regular(file)) as stream:
            content = stream.read()
        ends = blocks[:, 2] + blocks[:, 1] * sum(width)
        if [0, *ends] != [*blocks[:, 2], len(content)]:
            stated = f"{blocks[:, 1].sum()} particles of {sum(width)} bytes"
            precision = f"{kind.group(1)} precision by {head}"
            raise _damaged(file, f"{len(content)} bytes, but {stated} in {precision}")
        for _, count, begin in blocks:
            split = begin + count * width[0]
            integer_parts.append(np.frombuffer(content[begin:split], "<i4").reshape(count, -1))
            held = np.frombuffer(content, number, count * (3 + reals), split)
            real_parts.append(held.reshape(count, -1))
    marks, values = np.concatenate(integer_parts), np.concatenate(real_parts)
    valid = marks[:, 0] > 0  # others are ghosts, or stand for those of finer levels
    marks, values = marks[valid], values[valid].astype(np.float64)
    label = f"{folder}: particle field"
    parts = zip([*real_names, *integer_names], [*values[:, 3:].T, *marks[:, 2:].T], strict=True)
    columns = {name: Column(f"{label} {name}", part) for name, part in parts}
    columns["particle_id"] = Column(f"{label} id of cpu", marks[:, 1] * 2.0**32 + marks[:, 0])
    lost = int(np.sum(~valid))
    remarks = [f"{folder}: {lost} particles without a valid id were omitted."] if lost else []
    return Column(f"{folder}: positions", values[:, :3]), columns, remarks
