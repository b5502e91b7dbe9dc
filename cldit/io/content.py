"""Digests of the data and the code from which a stored result was made."""

import hashlib
import json
from collections.abc import Sequence
from functools import cache
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cldit.io.files import open_regular


def digest(*parts: Any) -> str:
    """24 hexadecimal digits of plain data; the order of mappings' keys is irrelevant."""
    serialised = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(serialised.encode()).hexdigest()[:24]


@cache
def code_digest(*packages: str) -> str:
    """Digest of cldit's version and all sources of these packages, subpackages included.

    A stored result is no longer found once the code that makes it has changed.
    """
    hasher = hashlib.sha256(version("cldit").encode())
    for package in sorted(packages):
        root = Path(str(resources.files(f"cldit.{package}")))
        for path in sorted(root.rglob("*")):
            if path.suffix in (".py", ".cl", ".h", ".csv", ".yaml"):
                hasher.update(path.relative_to(root).as_posix().encode())
                hasher.update(path.read_bytes())
    return hasher.hexdigest()[:24]


def file_content(paths: Sequence[Path]) -> list[Any]:
    """Data that change with files: their digests, and names, sizes and times in their folders.

    A case's file may refer to others in its folder. Missing files are omitted; their reader raises.
    """
    content: list[Any] = []
    for path in paths:
        if path.is_file():
            with open_regular(path) as stream:
                content.append(hashlib.file_digest(stream, "sha256").hexdigest())
        if path.exists():
            root = path if path.is_dir() else path.parent
            listing = sorted(root.rglob("*")) if path.is_dir() else sorted(root.iterdir())
            for entry in listing:
                if entry.is_file():
                    status = entry.stat()
                    content.append([str(entry), status.st_size, status.st_mtime_ns])
    return content
