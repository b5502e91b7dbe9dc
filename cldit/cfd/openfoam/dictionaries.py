"""Dictionaries of an OpenFOAM case: its injectors, the patches that cut it, and its walls."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import Boundary, Injector
from cldit.cfd.inputs import AT_ONCE, content
from cldit.cfd.mesh.faces import Mesh
from cldit.cfd.openfoam.file import Root, find_foam, open_foam, read_foam
from cldit.errors import SprayError
from cldit.io.files import MOST_TEXT_BYTES, open_regular

# a comment that is not closed ends with the text, so that each place is read once
_SKIP = re.compile(r"/\*(?>.*?\*/|.*)|//[^\n]*+|^[^\S\n]*+#[^\n]*+", re.DOTALL | re.MULTILINE)
_TOKEN = re.compile(r'"[^"]*"|[{}();]|[^\s{}();"]+')


def read_injectors(path: Path) -> tuple[Injector, ...]:
    """Injectors of the dictionary that state a fixed position and direction.

    Supported: `position (x y z); direction (x y z);`, also with the word `constant` before the
    vector, and `positionAxis ( ((x y z) (x y z)) .. );`. Directives and macros are not expanded: an
    injector that needs them is ignored.
    """
    text = _file_content(path).decode("latin-1")
    try:
        entries = dictionary(text)
    except IndexError as error:
        way = "set spray.nozzle_m and spray.axis instead"
        raise SprayError(f"{path}: brackets do not match; {way}") from error
    pairs = _positions_and_directions(entries.get("subModels", entries))
    return tuple(Injector(str(path), np.array(place), np.array(along)) for place, along in pairs)


def case_injectors(
    case: Path, cloud: str | None, region: str = ""
) -> tuple[tuple[Injector, ...], tuple[Path, ...]]:
    """Injectors from the cloud's dictionary, else from the only one with any; and its file."""
    if cloud is None:
        return (), ()
    folder = case / "constant" / region
    if region and not any(folder.glob("*[pP]roperties*")):
        folder = case / "constant"
    properties = folder / f"{cloud}Properties"
    candidates = [properties] if find_foam(properties) else sorted(folder.glob("*[pP]roperties*"))
    files = [existing for file in candidates if (existing := find_foam(file)) is not None]
    by_file = {
        file: read_injectors(file) for file in files if b"injectionModel" in _file_content(file)
    }
    return (next(iter(by_file.values())), tuple(by_file)) if len(by_file) == 1 else ((), ())


def _file_content(path: Path) -> bytes:
    with open_foam(path) as stream:
        data = content(stream, path, MOST_TEXT_BYTES + 1)
    if len(data) > MOST_TEXT_BYTES:
        raise SprayError(f"{path}: is larger than {MOST_TEXT_BYTES / 1e6:g} MB: no dictionary")
    return data


def dictionary_blocks(path: Path, body: bytes) -> dict[str, dict[str, str]]:
    """Dictionaries in a list by name, `2 ( walls { type wall; } .. )`: entries of one word."""
    _, _, inside = _SKIP.sub(" ", body.decode("latin-1")).partition("(")
    try:
        blocks = dictionary(inside[: inside.rindex(")")])
    except (IndexError, ValueError) as error:
        raise SprayError(f"{path}: brackets do not match") from error
    return {
        name: {k: str(v[0]) for k, v in block.items() if isinstance(v, list) and len(v) == 1}
        for name, block in blocks.items()
        if isinstance(block, dict)
    }


_CLOSED = {"(": ")", "{": "}"}


def dictionary(text: str) -> dict[str, object]:
    """Entries of a dictionary without its own braces, words in lists, inner ones as mappings.

    An `IndexError` means that brackets do not match.
    """
    stack: list[tuple[str, list[object]]] = [("", [])]
    for token in _TOKEN.findall(_SKIP.sub(" ", text)):
        if token in _CLOSED:
            stack.append((token, []))
        elif token in "({)}" or (token == ";" and stack[-1][0] == "("):
            opened, inside = stack.pop()
            if _CLOSED.get(opened) != token:
                raise IndexError
            stack[-1][1].append(_entries(inside) if token == "}" else inside)
        else:
            stack[-1][1].append(token)
    if len(stack) > 1:
        raise IndexError
    return _entries(stack[0][1])


def _entries(items: list[object]) -> dict[str, object]:
    """Mapping of `key value .. ;` and `key { .. }`."""
    mapping: dict[str, object] = {}
    words: list[object] = []
    for item in items:
        if item == ";" or (isinstance(item, dict) and len(words) == 1):
            if words:
                mapping[str(words[0])] = item if item != ";" else words[1:]
            words = []
        else:
            words.append(item)
    if words:
        raise IndexError
    return mapping


def _vector(value: object) -> tuple[float, float, float] | None:
    """Three numbers, alone, in a list of one, or after the word `constant`."""
    if isinstance(value, list) and value and value[0] in ("constant", "uniform"):
        value = value[1:]
    if isinstance(value, list) and len(value) == 1:
        value = value[0]
    if not isinstance(value, list) or len(value) != 3:
        return None
    try:
        x, y, z = (float(part) for part in value)
    except (TypeError, ValueError):
        return None
    return (x, y, z)


def _positions_and_directions(
    block: object,
) -> Iterator[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Pairs of position and direction, in this block and those inside it, in order."""
    blocks = [block]
    while blocks:
        if not isinstance(inner := blocks.pop(), dict):
            continue
        pairs = [(inner.get("position"), inner.get("direction"))]
        axes = inner.get("positionAxis")
        if isinstance(axes, list) and len(axes) == 1 and isinstance(axes[0], list):
            pairs += [tuple(pair) for pair in axes[0] if isinstance(pair, list) and len(pair) == 2]
        for position, direction in pairs:
            place, along = _vector(position), _vector(direction)
            if place is not None and along is not None and any(along):
                yield place, along
        blocks += reversed(inner.values())


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
