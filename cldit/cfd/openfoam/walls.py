"""The temperature at which an OpenFOAM case holds its walls, where it holds them at one."""

from __future__ import annotations

import re

from cldit.cfd.inputs import regular
from cldit.cfd.openfoam.collated import Root
from cldit.cfd.openfoam.file import find_foam, read_foam
from cldit.cfd.openfoam.injectors import dictionary, dictionary_blocks

_END = 100_000  # bytes at the end of a file, behind the values of its cells


def wall_temperature_K(root: Root, region: str, folder: str) -> float | None:
    """Mean over the patches of type `wall` that are held at one fixed temperature each.

    Args:
        root: the case, or one of its processors.
        region: "" is the case's own mesh.
        folder: of the fields, below the root.

    Returns:
        None where no wall is held: zeroGradient takes the temperature of the gas. So also for
        what is not told here: values that differ from face to face, files that are packed.

    Raises:
        SprayError: the list of patches is damaged.
    """
    path = root.path / "constant" / region / "polyMesh" / "boundary"
    file, field = find_foam(path), find_foam(root.path / folder / "T")
    if file is None or field is None or field.suffix == ".gz" or root.block is not None:
        return None
    patches = dictionary_blocks(file, read_foam(path, root.block).body)
    walls = [name for name, patch in patches.items() if patch.get("type") == "wall"]
    with regular(field).open("rb") as stream:
        stream.seek(max(0, field.stat().st_size - _END))
        held = _held(stream.read())
    found = [next((T for key, T in held.items() if _names(key, wall)), None) for wall in walls]
    known = [T for T in found if T is not None]
    return sum(known) / len(known) if known else None


def _names(key: str, patch: str) -> bool:
    """Whether an entry is for a patch; one in quotes is a regular expression."""
    if not key.startswith('"'):
        return key == patch
    try:
        return re.fullmatch(key.strip('"'), patch) is not None
    except re.error:
        return False


def _held(body: bytes) -> dict[str, float]:
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
