"""Digests of the files of a folder, in a JSON file that is written last and has its own."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cldit.errors import FileError, RunFolderError
from cldit.io.files import open_regular, write_text
from cldit.io.plain_data import parse_json, read_json

_KEY = "sha256"
UNVERIFIED = "written without digests, by cldit 0.2.0 or older: its files are not verified"


def sha256_of(path: Path) -> str:
    """SHA-256 of a file; FileError if it cannot be read."""
    with open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_sealed(path: Path, data: Mapping[str, Any], files: Iterable[Path]) -> None:
    """Writes `data` as JSON, with the digests of `files` below its folder and its own."""
    names = {file.relative_to(path.parent).as_posix(): sha256_of(file) for file in sorted(files)}
    plain = parse_json(json.dumps(data))
    sealed = {**plain, _KEY: {**names, "": _seal(plain, names)}}
    write_text(path, json.dumps(sealed, indent=2))


def read_sealed(path: Path) -> tuple[dict[str, Any], bool]:
    """Data of `write_sealed`, and True if they and the files are as written, False if there are no
    digests. Raises RunFolderError, which names the file that is missing or differs.
    """
    data = read_json(path)
    digests = data.pop(_KEY, None)
    if digests is None:
        return data, False
    if not isinstance(digests, dict):
        raise RunFolderError(f"{path}: is damaged ({_KEY} is no section)")
    seal = digests.pop("", None)
    if seal != _seal(data, digests):
        raise _damaged(path, path)
    for name, digest in digests.items():
        try:
            intact = sha256_of(path.parent / name) == digest
        except FileError as error:
            raise RunFolderError(str(error)) from error
        if not intact:
            raise _damaged(path.parent / name, path)
    return data, True


def _seal(data: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """Digest of the data and of the digests of the files."""
    serialised = json.dumps([data, names], sort_keys=True)
    return hashlib.sha256(serialised.encode()).hexdigest()


def _damaged(file: Path, path: Path) -> RunFolderError:
    return RunFolderError(f"{file}: is damaged: it differs from what was written ({path.name})")
