"""Tables kept on disk, by a description of the data that they are made from."""

import hashlib
import json
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.io.files import make_folder, write_bytes

Arrays = dict[str, Floats]


def digest(*arrays: NDArray[Any]) -> str:
    """Digest of the content of arrays."""
    hasher = hashlib.sha256()  # in hardware: twice as fast as blake2b
    for array in arrays:
        hasher.update(f"{array.dtype.str} {array.shape};".encode())
        hasher.update(np.ascontiguousarray(array).data.cast("B") if array.size else b"")
    return hasher.hexdigest()


def cached(
    folder: Path | None, *, kind: str, description: str, make: Callable[[], Arrays]
) -> Arrays:
    """Arrays of `make`, kept in a folder as KIND-HASH.table with their `description`.

    The description determines the arrays: a file that is damaged or has another one is made again.
    Without a folder, or if it cannot be written, nothing is kept.
    """
    if folder is None:
        return make()
    path = Path(folder) / f"{kind}-{hashlib.sha256(description.encode()).hexdigest()[:24]}.table"
    arrays = _read(path, description)
    if arrays is None:
        arrays = make()
        _write(path, description, arrays)
    return arrays


def _read(path: Path, description: str) -> Arrays | None:
    """Reads a line of JSON, {text, shapes, check}, and float64 values, much faster than .npz."""
    try:
        line, _, values = path.read_bytes().partition(b"\n")
        head = json.loads(line)
        if head["text"] != description or head["check"] != zlib.crc32(values):
            return None
        flat = np.frombuffer(values, "<f8").astype(float)
        arrays, begin = {}, 0
        for name, shape in head["shapes"].items():
            end = begin + int(np.prod(shape))
            arrays[name] = flat[begin:end].reshape(shape)
            begin = end
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return arrays if begin == flat.size and np.all(np.isfinite(flat)) else None


def _write(path: Path, description: str, arrays: Arrays) -> None:
    """Writes the file, which appears whole or not at all."""
    values = b"".join(np.asarray(array, "<f8").tobytes() for array in arrays.values())
    shapes = {name: np.shape(array) for name, array in arrays.items()}
    head = json.dumps({"text": description, "shapes": shapes, "check": zlib.crc32(values)})
    with suppress(OSError):
        make_folder(path.parent)
        write_bytes(path, head.encode() + b"\n" + values, sync=False)
