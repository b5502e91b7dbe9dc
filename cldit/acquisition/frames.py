"""Reads images from files of cameras and other programs, through installed readers."""

import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.pictures.kinds import ALLOWED, EXPORT, by_ending, kind_of
from cldit.acquisition.pictures.source import AXES, ArrayStack, ImageMetadata, Source, Stack
from cldit.errors import EvaluationError, FileError, reason

GROUP = "cldit.readers"

Reader = Callable[[Source], Any]

_TEMPERATURES = set("k kelvin c °c degc celsius deg_c f °f degf fahrenheit mk ck".split())


@cache
def _named(path: tuple[str, ...], ending: str) -> EntryPoint | None:
    """Installed reader of files with an ending; `path` is where packages are searched.

    Raises LookupError, which is not cached, for an ending that is unknown altogether: another
    search finds what is installed later.
    """
    for entry in entry_points(group=GROUP, name=ending):
        if not entry.value.startswith("cldit.") or not by_ending(ending):  # of older versions
            return entry
    if by_ending(ending):
        return None
    raise LookupError(ending)


def own_reader(path: Path) -> EntryPoint | None:
    """Reader of another package for the ending of a file; it comes before those of cldit."""
    try:
        return _named(tuple(sys.path), path.suffix.lower().removeprefix("."))
    except LookupError:
        return None


def open_stack(source: Source) -> "Images":
    """Opens a file of images, without reading them if its reader allows that. Raises
    EvaluationError for another kind of file, a missing or damaged one, a missing data set, or
    temperatures.
    """
    reader = _reader(source)
    try:
        stack = _arranged(reader(source), source)
    except EvaluationError:
        raise
    except FileError as error:
        raise EvaluationError(str(error)) from error
    except Exception as error:  # damaged headers lead the readers into errors of all kinds
        raise EvaluationError(f"{source.path}: cannot be read ({reason(error)})") from error
    try:
        return Images(stack, source)
    except BaseException:
        stack.close()
        raise


def _reader(source: Source) -> Reader:
    """Reader of the file: an installed one for its ending, or by its content."""
    if (entry := own_reader(source.path)) is not None:
        try:
            reader: Reader = entry.load()
        except (ImportError, AttributeError) as error:
            raise EvaluationError(
                f"{source.path}: its reader {entry.value} cannot be loaded: {error}"
            ) from error
        return reader
    kind = kind_of(source.path)
    if kind is None or not kind.reader:
        raise EvaluationError(
            f"{source.path}: {source.path.suffix or 'no ending'}"
            + (f" is {kind.name}; {kind.way_out}" if kind else "")
            + f"; allowed: {ALLOWED}, and readers of your own (docs/extending.md)"
        )
    return kind.load(kind.reader)


def _arranged(opened: Any, source: Source) -> Stack:
    if not hasattr(opened, "read"):
        return ArrayStack(opened, source.axes)
    stack: Stack = opened
    if source.axes in (None, AXES) or isinstance(stack, ArrayStack):
        return stack
    try:  # pages that are no images: all of them are needed for one
        pages = np.stack([stack.read(number) for number in range(len(stack))])
    finally:
        stack.close()
    return ArrayStack(pages, source.axes, unit=getattr(stack, "unit", ""))


class Images:
    """Images of a file that its source selects, with the file's remarks.

    unit: of their values. notes: remarks, a few words each. metadata: of each image, as far as the
    file has them.
    """

    def __init__(self, stack: Stack, source: Source) -> None:
        """Raises EvaluationError if there is none of them, or they are temperatures."""
        count = len(stack)
        if count == 0:
            raise EvaluationError(f"{source.text}: cannot be read (holds no image)")
        if source.last is not None and source.last > count:
            raise EvaluationError(f"{source.text}: has {count} frames, asked for {source.last}")
        if source.first >= (count if source.last is None else source.last):
            raise EvaluationError(f"{source.text}: [{source.first}:..] of {count} holds no image")
        self._stack = stack
        self._numbers = range(count)[source.part]
        self.unit = str(getattr(stack, "unit", ""))
        if self.unit.replace(" ", "").lower() in _TEMPERATURES:
            raise EvaluationError(
                f"{source.text}: holds temperatures (unit {self.unit}), not counts; {EXPORT}"
            )
        unit = (f"unit {self.unit}",) if self.unit else ()
        self.notes: tuple[str, ...] = (*getattr(stack, "notes", ()), *unit)
        metadata = tuple(getattr(stack, "metadata", ()))
        self.metadata: tuple[ImageMetadata, ...] = (
            metadata[source.part] if len(metadata) == count else (ImageMetadata(),) * len(self)
        )

    def __len__(self) -> int:
        return len(self._numbers)

    def read(self, number: int) -> NDArray[Any]:
        """Image `number` of the selected ones, (rows, columns)."""
        return self._stack.read(self._numbers[number])

    def close(self) -> None:
        """Closes the file."""
        self._stack.close()


class FrameReader:
    """Reads images in any order, holding the last file open."""

    def __init__(self) -> None:
        self._source: Source | None = None
        self._images: Images | None = None

    def notes(self, source: Source) -> tuple[str, ...]:
        """Remarks of the file about its images, a few words each."""
        return self._open(source).notes

    def metadata(self, source: Source) -> tuple[ImageMetadata, ...]:
        """Time and exposure of each image, as far as the file contains them."""
        return self._open(source).metadata

    def read(self, source: Source, number: int) -> NDArray[Any]:
        """Image `number` of the file `source`, (rows, columns); raises EvaluationError if it cannot
        be read.
        """
        images = self._open(source)
        try:
            return images.read(number)
        except EvaluationError:
            raise
        except Exception as error:
            raise EvaluationError(f"{source.text}: image {number}: {reason(error)}") from error

    def close(self) -> None:
        """Closes the file; the next image opens it again."""
        if self._images is not None:
            self._images.close()
        self._source = self._images = None

    def __del__(self) -> None:
        self.close()

    def _open(self, source: Source) -> Images:
        if self._images is None or source != self._source:
            self.close()
            self._images = open_stack(source)
            self._source = source
        return self._images
