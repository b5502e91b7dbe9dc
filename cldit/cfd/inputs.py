"""Input files of a CFD case: regular files only; errors are `SprayError`."""

from __future__ import annotations

from pathlib import Path

from cldit.errors import FileError, SprayError
from cldit.io.files import check_regular, read_text


def regular(path: Path) -> Path:
    """Returns `path` if it is a readable regular file; a pipe would block its reader."""
    try:
        check_regular(path)
    except FileError as error:
        raise SprayError(str(error)) from error
    return path


def missing(path: Path, package: str) -> SprayError:
    """Error for a package of the extra `cfd` that is not installed."""
    return SprayError(f'{path}: needs {package}; install it with: pip install "cldit[cfd]"')


def text_of(path: Path) -> str:
    """Reads a file of text in UTF-8."""
    try:
        return read_text(path)
    except FileError as error:
        raise SprayError(str(error)) from error
