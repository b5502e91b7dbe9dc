"""Tables kept on disk by the text of what they are made from."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Arrays = dict[str, Floats]


def digest(*arrays: NDArray[Any]) -> str:
    """A short text that stands for the content of arrays."""
    whole = hashlib.blake2b(digest_size=16)
    for array in arrays:
        whole.update(f"{array.dtype.str} {array.shape};".encode())
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def cached(folder: Path | None, *, kind: str, text: str, make: Callable[[], Arrays]) -> Arrays:
    """The arrays that `make` gives, kept as KIND-HASH.npz in a folder; None keeps nothing.

    A file that is damaged, or holds another text, is made anew; a folder that cannot be written
    costs only the time.
    """
    if folder is None:
        return make()
    path = Path(folder) / f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"
    kept = _read(path, text)
    if kept is None:
        kept = make()
        _write(path, text, kept)
    return kept


def _read(path: Path, text: str) -> Arrays | None:
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            if str(file["text"]) != text or int(file["count"]) != len(file.files) - 2:
                return None
            names = [name for name in file.files if name not in ("text", "count")]
            arrays = {name: np.asarray(file[name], dtype=float) for name in names}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    if not all(np.all(np.isfinite(array)) for array in arrays.values()):
        return None
    return arrays


def _write(path: Path, text: str, arrays: Arrays) -> None:
    """Appears whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(dir=path.parent, suffix=".part")
    except OSError:
        return
    try:
        with os.fdopen(handle, "wb") as stream:
            np.savez(stream, text=np.array(text), count=np.array(len(arrays)), **arrays)  # type: ignore[arg-type]
        os.replace(part, path)
    except OSError:
        Path(part).unlink(missing_ok=True)
