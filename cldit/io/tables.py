"""Tables kept on disk, by the text of the data that they are made from."""

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
    whole = hashlib.sha256()  # in hardware: twice as fast as blake2b
    for array in arrays:
        whole.update(f"{array.dtype.str} {array.shape};".encode())
        whole.update(np.ascontiguousarray(array).data.cast("B") if array.size else b"")
    return whole.hexdigest()


def cached(folder: Path | None, *, kind: str, text: str, make: Callable[[], Arrays]) -> Arrays:
    """Arrays of `make`, kept in a folder as KIND-HASH.table with the `text` that determines them.

    A file that is damaged or has another text is made again. Without a folder, or if it cannot be
    written, nothing is kept.
    """
    if folder is None:
        return make()
    path = Path(folder) / f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:24]}.table"
    arrays = _read(path, text)
    if arrays is None:
        arrays = make()
        _write(path, text, arrays)
    return arrays


def _read(path: Path, text: str) -> Arrays | None:
    """Reads a line of JSON, {text, shapes, check}, and float64 values, much faster than .npz."""
    try:
        line, _, values = path.read_bytes().partition(b"\n")
        head = json.loads(line)
        if head["text"] != text or head["check"] != zlib.crc32(values):
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


def _write(path: Path, text: str, arrays: Arrays) -> None:
    """Writes the file, which appears whole or not at all."""
    values = b"".join(np.asarray(array, "<f8").tobytes() for array in arrays.values())
    shapes = {name: np.shape(array) for name, array in arrays.items()}
    head = json.dumps({"text": text, "shapes": shapes, "check": zlib.crc32(values)})
    with suppress(OSError):
        make_folder(path.parent)
        write_bytes(path, head.encode() + b"\n" + values, sync=False)
