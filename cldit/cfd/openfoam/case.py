"""OpenFOAM cases: ascii, binary or gz, whole, decomposed or collated, with any cloud of parcels.

Read with numpy rather than vtk's own readers: those return float32 and no parcels at all for
clouds that hold only barycentric coordinates.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cldit.cfd.case import (
    CfdCase,
    Cloud,
    Column,
    Injector,
    choose_cloud,
    complete_cloud,
    joined,
    nearest_time,
)
from cldit.cfd.mesh import Mesh, join
from cldit.cfd.openfoam.cloud import cloud_names, read_cloud
from cldit.cfd.openfoam.collated import Root, split_roots
from cldit.cfd.openfoam.file import faces, find_foam, internal_field, labels, read_foam, vectors
from cldit.cfd.openfoam.injectors import read_injectors
from cldit.cfd.openfoam.size import foam_size
from cldit.cfd.size import check_room
from cldit.errors import SprayError
from cldit.progress import Watch, silent

_TIME = re.compile(r"\d+(\.\d*)?([eE][+-]?\d+)?$")


def is_openfoam(path: Path) -> bool:
    """Whether the path is a case folder or the `.foam` file in one."""
    if path.suffix in (".foam", ".OpenFOAM"):
        return True
    parts = ("constant/polyMesh", "processor0/constant/polyMesh", "processors*/constant/polyMesh")
    return any(each.is_dir() for part in parts for each in path.glob(part))


def read_openfoam(
    path: Path,
    *,
    time_s: float | None,
    fields: Sequence[str],
    cloud: str | None,
    watch: Watch = silent,
) -> CfdCase:
    """Reads one time of a case.

    A decomposed case is read processor by processor where its own folder does not have the time.

    Args:
        path: the case folder, or the `.foam` file in it.
        time_s: the latest where None.
        fields: names of the volScalarFields to read, where there are such files.
        cloud: name of the cloud; the only one where None.
        watch: told how far the work is.

    Raises:
        SprayError: a file is missing or damaged, the time or the cloud is not there, the cloud
            is empty, or the case does not fit into memory.
    """
    case = path if path.is_dir() else path.parent
    if not case.is_dir():
        raise SprayError(f"{path}: no such case (spray.file)")
    processors = split_roots(case)
    own = _times(case, fields)
    split = _times(processors[0].path, fields) if processors else {}
    try:
        wanted = nearest_time(str(case), [*own, *split], time_s)
    except SprayError as error:
        hint = f"; its VTK output can be read as {case / 'VTK'}" if (case / "VTK").is_dir() else ""
        raise SprayError(f"{error}{hint}") from error
    roots, folder = ([Root(case)], own[wanted]) if wanted in own else (processors, split[wanted])

    names = {name for root in roots for name in cloud_names(root.path / folder)}
    chosen = choose_cloud(str(case / folder), names, cloud)
    places = [root.path / "constant" / "polyMesh" for root in roots]
    check_room(case, foam_size(places, fields=len(fields)))
    meshes: list[Mesh] = []
    for root in roots:
        watch("reading the mesh", len(meshes), len(roots))
        meshes.append(_mesh(root, wanted))
    gas: dict[str, Column] = {}
    for name in fields:
        watch(f"reading {name}", len(gas), len(fields))
        files = [root.path / folder / name for root in roots]
        if find_foam(files[0]) is None:
            continue
        parts = [
            Column(root.label(file), internal_field(read_foam(file, root.block), mesh.cells))
            for root, file, mesh in zip(roots, files, meshes, strict=True)
        ]
        gas[name] = joined(parts)
    return CfdCase(
        source=str(case / folder),
        time_s=wanted,
        mesh=join(meshes),
        gas=gas,
        available=tuple(sorted(_file_names(roots[0].path / folder))),
        cloud=None if chosen is None else _cloud(chosen, roots, folder, meshes),
        injectors=_injectors(case, chosen),
    )


def list_openfoam(
    path: Path, time_s: float | None
) -> tuple[list[float], list[str], dict[str, list[str]]]:
    """Times, cell fields, and clouds with their fields, of `time_s` or the last; nothing is read.

    Args:
        path: the case's folder, or a file in it.
        time_s: None is the latest.

    Returns:
        Times [s], cell fields, and the fields of each cloud.

    Raises:
        SprayError: there is no case, or no such time.
    """
    case = path if path.is_dir() else path.parent
    if not case.is_dir():
        raise SprayError(f"{path}: no such case (spray.file)")
    roots = [case, *dict.fromkeys(root.path for root in split_roots(case))]
    known = {
        float(each.name): each.name
        for root in roots
        for each in root.iterdir()
        if _TIME.match(each.name) and each.is_dir()
    }
    folder = known[nearest_time(str(case), known, time_s)]
    fields: set[str] = set()
    clouds: dict[str, set[str]] = {}
    for here in (root / folder for root in roots if (root / folder).is_dir()):
        fields |= _file_names(here)
        for name in cloud_names(here):
            clouds.setdefault(name, set()).update(_file_names(here / "lagrangian" / name))
    return list(known), sorted(fields), {name: sorted(found) for name, found in clouds.items()}


def _file_names(folder: Path) -> set[str]:
    return {each.name.removesuffix(".gz") for each in folder.iterdir() if each.is_file()}


def _times(root: Path, fields: Sequence[str]) -> dict[float, str]:
    """Folders named by a time that hold any of the fields."""
    return {
        float(each.name): each.name
        for each in root.iterdir()
        if _TIME.match(each.name) and any(find_foam(each / name) for name in fields)
    }


def _mesh(part: Root, time_s: float) -> Mesh:
    """The mesh at a time: each file from the latest folder not after it that has the file."""
    root, block = part.path, part.block
    before = sorted(
        (each for each in root.iterdir() if _TIME.match(each.name) and float(each.name) <= time_s),
        key=lambda each: -float(each.name),
    )
    folders = [each / "polyMesh" for each in (*before, root / "constant")]

    def latest(name: str) -> Path:
        found = (each / name for each in folders if find_foam(each / name) is not None)
        return next(found, folders[-1] / name)

    points = vectors(read_foam(latest("points"), block))
    corners, start = faces(read_foam(latest("faces"), block))
    owner = labels(read_foam(latest("owner"), block))
    inner = labels(read_foam(latest("neighbour"), block))
    if len(inner) > len(owner):
        raise SprayError(f"{folders[-1]}: {len(inner)} neighbours for {len(owner)} owners")
    neighbour = np.full(len(owner), -1, dtype=np.int32)
    neighbour[: len(inner)] = inner
    cells = int(max(owner.max(initial=-1), inner.max(initial=-1))) + 1
    return Mesh(points, corners, start, owner, neighbour, cells, str(latest("faces").parent))


def _cloud(name: str, roots: Sequence[Root], folder: str, meshes: Sequence[Mesh]) -> Cloud:
    """The cloud of all processors; those that the spray has not reached have no folder for it."""
    parts = [
        read_cloud(place, mesh, root.block)
        for root, mesh in zip(roots, meshes, strict=True)
        if (place := root.path / folder / "lagrangian" / name).is_dir()
    ]
    filled = [part for part in parts if len(part[0].values)] or parts[:1]
    for _, columns in filled:
        if missing := set(filled[0][1]) ^ set(columns):
            raise SprayError(
                f"{roots[0].path.parent}: only some processors have the field {min(missing)!r} of "
                f"cloud {name!r}"
            )
    source = str(Path(filled[0][0].label).parent)
    return complete_cloud(
        name,
        source,
        joined([position for position, _ in filled]),
        {key: joined([columns[key] for _, columns in filled]) for key in filled[0][1]},
    )


def _injectors(case: Path, cloud: str | None) -> tuple[Injector, ...]:
    """Injectors from the cloud's dictionary, or from the only one that has any."""
    if cloud is None:
        return ()
    own = case / "constant" / f"{cloud}Properties"
    files = [own] if own.is_file() else sorted((case / "constant").glob("*[pP]roperties"))
    found = [
        read_injectors(file)
        for file in files
        if file.is_file() and b"injectionModel" in file.read_bytes()
    ]
    return found[0] if len(found) == 1 else ()
