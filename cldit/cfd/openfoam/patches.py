"""Patches of an OpenFOAM mesh: those at which it is cut, and the temperature of its walls."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import Boundary
from cldit.cfd.inputs import AT_ONCE
from cldit.cfd.mesh.faces import Mesh
from cldit.cfd.openfoam.file import Root, find_foam, read_foam
from cldit.cfd.openfoam.injectors import dictionary, dictionary_blocks
from cldit.errors import SprayError
from cldit.io.files import open_regular

CUTS = ("wedge", "symmetry", "symmetryPlane", "cyclic", "cyclicAMI", "empty")


def cut_boundaries(
    meshes: Sequence[tuple[Root, Mesh]], region: str
) -> tuple[tuple[Boundary, ...], tuple[Path, ...]]:
    """Patches of a type in `CUTS`, each once, and the files that list them."""
    by_name: dict[str, Boundary] = {}
    files: list[Path] = []
    for root, mesh in meshes:
        file, patches = _patches(root, region)
        if file is None:
            continue  # a moving mesh keeps its list elsewhere; its geometry is used instead
        files.append(file)
        for name, patch in patches.items():
            kind = patch.get("type", "")
            if kind not in CUTS or name in by_name:
                continue
            try:
                count, start = int(patch["nFaces"]), int(patch["startFace"])
            except (KeyError, ValueError) as error:
                raise SprayError(f"{file}: patch {name}: no nFaces and startFace") from error
            if start < 0 or count < 0 or start + count > len(mesh.owner):
                span = f"patch {name}: faces {start} to {start + count}"
                raise SprayError(f"{file}: {span}, but the mesh has {len(mesh.owner)}")
            if count:
                normal, place = _plane(mesh, start, count)
                by_name[name] = Boundary(name, kind, normal, place)
    return tuple(by_name.values()), tuple(files)


def _patches(root: Root, region: str) -> tuple[Path | None, dict[str, dict[str, str]]]:
    """File with the list of patches, and the patches by name."""
    path = root.path / "constant" / region / "polyMesh" / "boundary"
    file = find_foam(path)
    return file, {} if file is None else dictionary_blocks(file, read_foam(path, root.block).body)


def check_processors(roots: Sequence[Root], region: str) -> None:
    """Refuses a decomposed case of which a processor is missing that others have a side with."""
    if roots[0].block is not None:
        return  # the folder's name gives their number, and each file has all of them
    numbers = {int(match[1]) for root in roots if (match := _PROCESSOR.match(root.path.name))}
    if len(numbers) < len(roots):
        return  # the case itself
    named_by: dict[int, Path] = dict.fromkeys(range(max(numbers)), roots[-1].path)
    for root in roots:
        file, patches = _patches(root, region)
        for patch in patches.values():
            if file is not None and patch.get("neighbProcNo", "").isdigit():
                named_by[int(patch["neighbProcNo"])] = file
    if missing := sorted(set(named_by) - numbers):
        case, absent = roots[0].path.parent, missing[0]
        raise SprayError(
            f"{case}: processor{absent} is missing, which {named_by[absent]} implies; restore it "
            f"(there are {', '.join(root.path.name for root in roots[:8])}), or reconstruct it"
        )


_PROCESSOR = re.compile(r"processor(\d+)$")


def _plane(mesh: Mesh, start: int, count: int) -> tuple[Floats, Floats]:
    """Unit normal (zeros if it is not plane) and a point of consecutive faces."""
    begin = mesh.start[start : start + count + 1]
    corners = mesh.corners[begin[0] : begin[-1]]
    points = mesh.points_m[corners]
    following = np.arange(1, len(corners) + 1)
    following[begin[1:] - begin[0] - 1] = begin[:-1] - begin[0]
    middle = points.mean(axis=0)
    triangles = 0.5 * np.cross(points - middle, points[following] - middle)
    faces = np.add.reduceat(triangles, begin[:-1] - begin[0], axis=0)
    total = faces.sum(axis=0)
    length = float(np.linalg.norm(total))
    plane = length > 0.999 * float(np.linalg.norm(faces, axis=1).sum()) > 0.0
    return (total / length if plane else np.zeros(3)), middle


def wall_temperature_K(root: Root, region: str, folder: str) -> float | None:
    """Mean temperature of the walls that are held at one fixed temperature each; else None.

    The boundary is at the end of a file, after the values of its cells. None also where it is
    not known: values that differ from face to face, packed files.
    """
    field = find_foam(root.path / folder / "T")
    if field is None or field.suffix == ".gz" or root.block is not None:
        return None
    _, patches = _patches(root, region)
    walls = [name for name, patch in patches.items() if patch.get("type") == "wall"]
    with open_regular(field) as stream:
        stream.seek(max(0, field.stat().st_size - AT_ONCE))
        held = _fixed_values(stream.read())
    walls_K = [next((T for key, T in held.items() if _names(key, wall)), None) for wall in walls]
    fixed = [T for T in walls_K if T is not None]
    return sum(fixed) / len(fixed) if fixed else None


def _names(key: str, patch: str) -> bool:
    """True if an entry is for a patch; an entry in quotes is a regular expression."""
    if not key.startswith('"'):
        return key == patch
    try:
        return re.fullmatch(key.strip('"'), patch) is not None
    except re.error:
        return False


def _fixed_values(body: bytes) -> dict[str, float]:
    """Entries of the boundary field that have one fixed value."""
    _, start, rest = body.rpartition(b"boundaryField")
    if not start:
        return {}
    try:
        inside = dictionary(rest.decode("latin-1").strip().removeprefix("{").rpartition("}")[0])
    except IndexError:  # binary values may hold anything
        return {}
    held: dict[str, float] = {}
    for name, patch in inside.items():
        match patch:
            case {"type": ["fixedValue"], "value": ["uniform", str(number)]}:
                try:
                    held[name] = float(number)
                except ValueError:
                    continue
    return held
