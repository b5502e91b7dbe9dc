"""Reads images from files of cameras and other programs, through installed readers."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.hcc import HccError
from cldit.acquisition.pictures.source import AXES, ArrayStack, Source, Stack, Told
from cldit.errors import EvaluationError, FileError

GROUP = "cldit.readers"

Reader = Callable[[Source], Any]

_TEMPERATURES = {
    "k",
    "kelvin",
    "c",
    "°c",
    "degc",
    "celsius",
    "deg_c",
    "f",
    "°f",
    "degf",
    "mk",
    "ck",
}
_EXPORT = "export raw counts as TIFF of 16 bits"
_WAY_OUT = {
    "seq": f"a film of FLIR; {_EXPORT} with Research Studio or ResearchIR",
    "csq": f"a compressed film of FLIR; {_EXPORT} with Research Studio or ResearchIR",
    "ptw": f"a film of Cedip and FLIR; {_EXPORT} with Altair or ResearchIR",
    "sfmov": f"a film of FLIR; {_EXPORT} with ResearchIR",
    "irb": f"a film of InfraTec; {_EXPORT} with IRBIS",
    "fits": "astronomers' format; save its data with astropy and numpy.save as .npy",
    "jpg": f"loses what it was compressed of; {_EXPORT}",
    "jpeg": f"loses what it was compressed of; {_EXPORT}",
    "avi": f"a film of a display; {_EXPORT}",
    "mp4": f"a film of a display; {_EXPORT}",
}


def installed_readers() -> dict[str, EntryPoint]:
    """Every reader that is installed, by the ending of its files."""
    return {entry.name.lower(): entry for entry in sorted(entry_points(group=GROUP))}


@cache
def _seen_readers(path: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Readers installed when a file was first opened; searching all installed packages takes longer
    than reading an image.
    """
    return installed_readers()


def open_stack(source: Source) -> Stack:
    """Opens a file of images, without reading them if its reader allows that. Raises
    EvaluationError for another kind of file, a missing or damaged one, a missing data set, or
    temperatures.
    """
    reader = _reader(source)
    try:
        stack = _arranged(reader(source), source)
    except EvaluationError:
        raise
    except (HccError, FileError) as error:
        raise EvaluationError(str(error)) from error
    except Exception as error:  # damaged headers lead the readers into errors of all kinds
        raise EvaluationError(f"{source.path}: cannot be read ({error})") from error
    try:
        _check(stack, source)
        return _Part(stack, source) if source.first or source.last is not None else stack
    except BaseException:
        stack.close()
        raise


def _reader(source: Source) -> Reader:
    ending = source.path.suffix.lower().removeprefix(".")
    known = _seen_readers(tuple(sys.path))
    if ending not in known:
        known = installed_readers()  # also what was installed since
    if ending not in known:
        allowed = ", ".join(f".{name}" for name in known) or "none: reinstall cldit"
        way_out = _WAY_OUT.get(ending)
        raise EvaluationError(
            f"{source.path}: {f'.{ending}' if ending else 'no ending'}"
            + (f" is {way_out}" if way_out else "")
            + f"; allowed: {allowed}, and readers of your own (docs/extending.md)"
        )
    try:
        reader: Reader = known[ending].load()
    except (ImportError, AttributeError) as error:
        raise EvaluationError(
            f"{source.path}: its reader {known[ending].value} cannot be loaded: {error}"
        ) from error
    return reader


def _arranged(opened: Any, source: Source) -> Stack:
    if not hasattr(opened, "read"):
        return ArrayStack(opened, source.axes)
    stack: Stack = opened
    if source.axes == AXES or isinstance(stack, ArrayStack):
        return stack
    try:  # pages that are no images: all of them are needed for one
        whole = np.stack([stack.read(number) for number in range(len(stack))])
    finally:
        stack.close()
    return ArrayStack(whole, source.axes, unit=getattr(stack, "unit", ""))


def _check(stack: Stack, source: Source) -> None:
    count = len(stack)
    if count == 0:
        raise EvaluationError(f"{source.text}: cannot be read (holds no image)")
    if source.last is not None and source.last > count:
        raise EvaluationError(f"{source.text}: has {count} frames, asked for {source.last}")
    if source.first >= (count if source.last is None else source.last):
        raise EvaluationError(f"{source.text}: [{source.first}:..] of {count} holds no image")
    unit = str(getattr(stack, "unit", ""))
    if unit.strip().lower() in _TEMPERATURES:
        raise EvaluationError(
            f"{source.text}: holds temperatures (unit {unit}), not counts; {_EXPORT}"
        )


class _Part:
    """Some images of a file."""

    def __init__(self, stack: Stack, source: Source) -> None:
        self._stack = stack
        self._first = source.first
        self._last = len(stack) if source.last is None else source.last
        self.notes = getattr(stack, "notes", ())
        self.unit = getattr(stack, "unit", "")
        self.told = tuple(getattr(stack, "told", ()))[self._first : self._last]

    def __len__(self) -> int:
        return self._last - self._first

    def read(self, number: int) -> NDArray[Any]:
        return self._stack.read(self._first + number)

    def close(self) -> None:
        self._stack.close()


class FrameReader:
    """Reads images in any order, holding the last file open."""

    def __init__(self) -> None:
        self._source: Source | None = None
        self._stack: Stack | None = None

    def count(self, source: Source) -> int:
        """Number of images in a file."""
        return len(self._open(source))

    def notes(self, source: Source) -> tuple[str, ...]:
        """Remarks of the file about its images, a few words each."""
        stack = self._open(source)
        unit = str(getattr(stack, "unit", ""))
        return (*getattr(stack, "notes", ()), *([f"unit {unit}"] if unit else []))

    def told(self, source: Source) -> tuple[Told, ...]:
        """Time and exposure of each image, as far as the file contains them."""
        stack = self._open(source)
        found = tuple(getattr(stack, "told", ()))
        return found if len(found) == len(stack) else (Told(),) * len(stack)

    def read(self, source: Source, number: int) -> NDArray[Any]:
        """Image `number` of the file `source`, (rows, columns); raises EvaluationError if it cannot
        be read.
        """
        stack = self._open(source)
        try:
            return stack.read(number)
        except EvaluationError:
            raise
        except Exception as error:
            raise EvaluationError(f"{source.text}: image {number}: {error}") from error

    def close(self) -> None:
        """Closes the file; the next image opens it again."""
        if self._stack is not None:
            self._stack.close()
        self._source = self._stack = None

    def __del__(self) -> None:
        self.close()

    def _open(self, source: Source) -> Stack:
        if self._stack is None or source != self._source:
            self.close()
            self._stack = open_stack(source)
            self._source = source
        return self._stack
