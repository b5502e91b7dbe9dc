"""The files of a CFD case as they are opened: regular ones only, and errors are SprayError."""

from __future__ import annotations

from pathlib import Path

from cldit.errors import FileError, SprayError
from cldit.io.files import check_regular, read_text


def regular(path: Path) -> Path:
    """The file itself, for whoever opens it next: a pipe would keep them waiting.

    Raises:
        SprayError: it is missing, not a regular file, or not to be read.
    """
    try:
        check_regular(path)
    except FileError as error:
        raise SprayError(str(error)) from error
    return path


def text_of(path: Path) -> str:
    """The text of a file in UTF-8.

    Raises:
        SprayError: as `regular`; it is too large, or not in UTF-8.
    """
    try:
        return read_text(path)
    except FileError as error:
        raise SprayError(str(error)) from error
