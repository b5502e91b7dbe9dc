"""What foamToVTK writes: internal.vtu (or legacy .vtk), and one .vtp (.vtk) for each cloud."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cldit.cfd.case import CfdCase, choose_cloud, complete_cloud, nearest_time
from cldit.cfd.vtk.datasets import (
    cell_columns,
    cell_names,
    load_vtk,
    point_columns,
    time_value,
    vtk_mesh,
)
from cldit.errors import SprayError
from cldit.progress import Watch, silent

_NUMBER = re.compile(r"_(\d+)$")
_TIME = re.compile(rb"\btime='([^']+)'")
_MESHES = ("*.vtu", "*.vtk", "*/internal.vtu", "internal.vtu")
_CLOUDS = tuple(
    f"{place}.{kind}"
    for place in ("lagrangian/*/*", "lagrangian/*", "*/lagrangian/*/*", "*/lagrangian/*")
    for kind in ("vtp", "vtk")
)
_SERIES = ("*.series", "lagrangian/*/*.series")


@dataclass
class _Step:
    """The files of one time step."""

    mesh: Path | None = None
    clouds: dict[str, Path] = field(default_factory=dict)


def read_vtk(
    path: Path,
    *,
    time_s: float | None,
    fields: Sequence[str],
    cloud: str | None,
    watch: Watch = silent,
) -> CfdCase:
    """Reads one time of foamToVTK output.

    Args:
        path: the folder that foamToVTK wrote (`CASE/VTK`), or any file in it: then the step that
            the file belongs to.
        time_s: the latest where None. Times come from the `.series` files, else from the comment
            or the `TimeValue` in the mesh file.
        fields: names of the cell fields to take, where there are such.
        cloud: name of the cloud; the only one where None.
        watch: told how far the work is.

    Raises:
        SprayError: vtk is not installed; a file is missing or damaged; the time or the cloud is
            not there, or the cloud is empty.
    """
    if not path.exists():
        raise SprayError(f"{path}: no such file or folder (spray.file)")
    folder, own = _place(path.resolve())
    steps = _steps(folder)
    spray = any(step.clouds for step in steps.values())
    if own is not None:
        steps = {key: step for key, step in steps.items() if key == own}
    meshes = {key: step.mesh for key, step in steps.items() if step.mesh is not None}
    if not meshes:
        raise SprayError(
            f"{path}: neither an OpenFOAM case (constant/polyMesh) nor foamToVTK output "
            "(internal.vtu, or .vtk), EnSight (.case), CONVERGE (.h5) or a mapping file (.yaml)"
        )
    listed = _listed_times(folder)
    alone: Any = None  # the only mesh, where its time is in it: it is not read twice
    if len(meshes) == 1 and not listed.keys() & meshes.keys():
        (file,) = meshes.values()
        alone = load_vtk(file, "vtkUnstructuredGrid", cell_fields=fields, watch=watch)
    times = {listed[key] if key in listed else _own_time(meshes[key], alone): key for key in meshes}
    known = {time: key for time, key in times.items() if time is not None}
    if len(known) == len(meshes):
        at: float | None = nearest_time(str(path), known, time_s)
    elif len(meshes) == 1 and time_s is None:
        at = None
    else:
        raise SprayError(
            f"{path}: some mesh files do not say their time; give the path of one, without "
            "spray.time_s"
        )
    key = times[at]
    mesh, clouds = meshes[key], steps[key].clouds
    if spray and not clouds:
        raise SprayError(f"{mesh}: no cloud file of the same step {key!r}, but other steps have")
    chosen = choose_cloud(str(path), clouds, cloud)
    grid = alone or load_vtk(mesh, "vtkUnstructuredGrid", cell_fields=fields, watch=watch)
    cells = cell_columns(mesh, grid)
    parcels = None
    if chosen is not None:
        file = clouds[chosen]
        position, columns = point_columns(file, load_vtk(file, "vtkPolyData", watch=watch))
        parcels = complete_cloud(chosen, str(file), position, columns)
    return CfdCase(
        source=str(mesh),
        time_s=at,
        mesh=vtk_mesh(mesh, grid),
        gas={name: cells[name] for name in fields if name in cells},
        available=tuple(cell_names(mesh)),
        cloud=parcels,
    )


def list_vtk(
    path: Path, time_s: float | None
) -> tuple[list[float], list[str], dict[str, list[str]]]:
    """Times, cell fields, and clouds with their fields, of `time_s` or the last step.

    Args:
        path: a file, or foamToVTK's folder.
        time_s: None is the latest.

    Returns:
        Times [s], cell fields, and the fields of each cloud.

    Raises:
        SprayError: there is no such file or time, or a file is damaged.
    """
    if not path.exists():
        raise SprayError(f"{path}: no such file or folder (spray.file)")
    folder, own = _place(path.resolve())
    steps = {key: step for key, step in _steps(folder).items() if own is None or key == own}
    listed = _listed_times(folder)
    times = {
        key: listed[key] if key in listed else _own_time(step.mesh)
        for key, step in steps.items()
        if step.mesh is not None
    }
    if not times:
        raise SprayError(f"{path}: no .vtu or .vtk file of a mesh")
    known = {time: key for key, time in times.items() if time is not None}
    key = known[nearest_time(str(path), known, time_s)] if known else max(times)
    mesh = steps[key].mesh
    assert mesh is not None
    clouds = {
        name: sorted(point_columns(file, load_vtk(file))[1])
        for name, file in steps[key].clouds.items()
    }
    return list(known), cell_names(mesh), clouds


def _number(path: Path) -> str:
    """Step number in the name of a file, or of the nearest folder that has one; else ""."""
    names = [path.name.split(".")[0], *path.parts[-2::-1]]
    return next((found[1] for name in names if (found := _NUMBER.search(name))), "")


def _place(path: Path) -> tuple[Path, str | None]:
    """The folder in which foamToVTK's layout begins, and the step if the path belongs to one."""
    if path.is_dir() and not (path / "internal.vtu").is_file():
        return path, None
    if path.suffix == ".series":
        return _top(path.parent), None
    folder = _top(path if path.is_dir() else path.parent)
    return folder, _number(path.relative_to(folder))


def _top(folder: Path) -> Path:
    """Goes up from `CASE_12` or `lagrangian/cloud` to the folder that holds the steps."""
    for here in (folder, folder.parent):
        if here.name == "lagrangian":
            folder = here.parent
    return folder.parent if (folder / "internal.vtu").is_file() else folder


def _steps(folder: Path) -> dict[str, _Step]:
    """Steps by number; boundary patches, which lie deeper or elsewhere, are not looked at."""
    steps: dict[str, _Step] = {}
    for pattern in _MESHES:
        for file in sorted(folder.glob(pattern)):
            steps.setdefault(_number(file.relative_to(folder)), _Step()).mesh = file
    for pattern in _CLOUDS:
        for file in sorted(folder.glob(pattern)):
            inside = file.relative_to(folder)
            name = inside.parts[inside.parts.index("lagrangian") + 1].split(".")[0]
            step = steps.setdefault(_number(inside), _Step())
            step.clouds.setdefault(_NUMBER.sub("", name), file)
    return steps


def _listed_times(folder: Path) -> dict[str, float]:
    """Times by step number, from the JSON files for ParaView."""
    times: dict[str, float] = {}
    for file in (file for pattern in _SERIES for file in sorted(folder.glob(pattern))):
        try:
            for entry in json.loads(file.read_text(encoding="utf-8"))["files"]:
                times[_number(Path(entry["name"]))] = float(entry["time"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise SprayError(f"{file}: is no list of files and times ({error})") from error
    return times


def _own_time(file: Path, data: Any = None) -> float | None:
    """The time that a mesh file states in its comment, or as the field `TimeValue`.

    `data` is what the file holds, where it has been read.
    """
    with file.open("rb") as stream:
        comment = _TIME.search(stream.read(2000))
    if comment is None:
        return time_value(data or load_vtk(file, cell_fields=()))
    try:
        return float(comment.group(1))
    except ValueError as error:
        raise SprayError(f"{file}: states the time {comment.group(1)!r}") from error
