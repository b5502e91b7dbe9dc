"""Location of images, and the interface of a reader of a kind of file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.errors import EvaluationError

Axis = Literal["frames", "rows", "columns"]
AXES: tuple[Axis, ...] = ("frames", "rows", "columns")

_PART = re.compile(r"^(?P<name>.*)\[(?P<first>\d*):(?P<last>\d*)\]$")


@dataclass(frozen=True)
class Source:
    """A file, and where in it.

    dataset: within HDF5 and the like. first, last: which images. axes: order of the stack's axes.
    """

    path: Path
    dataset: str = ""
    first: int = 0
    last: int | None = None
    axes: tuple[Axis, ...] = AXES

    @property
    def text(self) -> str:
        """The file and the data set in it, as the user names them."""
        return f"{self.path}::{self.dataset}" if self.dataset else str(self.path)


@dataclass(frozen=True)
class Told:
    """Metadata of one image; None if its file has none. time_s: since 1970, of the file's clock."""

    time_s: float | None = None
    integration_time_s: float | None = None


# Units that files name, with both signs of Unicode for micro.
SECONDS_OF_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
SECONDS_OF_UNIT |= {"min": 60.0, "h": 3600.0}


def moment_s(text: str) -> float:
    """Seconds since 1970 of an ISO 8601 date, in UTC if it has no zone; raises ValueError
    otherwise.
    """
    found = datetime.fromisoformat(text.strip())
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


class Stack(Protocol):
    """Images of one file. `notes`, `unit` and `told`, a `Told` an image, may be there too: what
    the file says of them."""

    def __len__(self) -> int: ...

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns)."""

    def close(self) -> None:
        """Closes the file."""


class ArrayStack:
    """Images of anything that numpy can index: an array, a map of a file, a data set."""

    def __init__(self, data: Any, axes: tuple[Axis, ...] = AXES, *, unit: str = "") -> None:
        """Takes (rows, columns), or three axes in the order of `axes`, or raises ValueError."""
        shape: tuple[int, ...] = data.shape
        if len(shape) not in (2, 3):
            raise ValueError(f"shape {shape}, expected (frames, rows, columns)")
        self._data = data
        self._frames = axes.index("frames") if len(shape) == 3 else None
        self._turned = axes.index("columns") < axes.index("rows")
        self.unit = unit
        self.notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return 1 if self._frames is None else int(self._data.shape[self._frames])

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns)."""
        place: Any = ()
        if self._frames is not None:
            place = (slice(None),) * self._frames + (number,)
        picture = np.asarray(self._data[place])
        return picture.T if self._turned else picture

    def close(self) -> None:
        """Does nothing: an array has no file."""


def parse_source(text: str) -> tuple[str, Source]:
    """Splits a name into the pattern of the file's name and a source with the parts after `::` and
    in `[:]`. Raises EvaluationError if the part after `::` is no data set.
    """
    part = _PART.match(text)
    name, first, last = (part["name"], part["first"], part["last"]) if part else (text, "", "")
    pattern, separator, dataset = name.partition("::")
    if separator and (not dataset or "[" in dataset or "]" in dataset):
        raise EvaluationError(
            f"{text}: {dataset!r} is no data set; allowed: /group/name, with [first:last] or not"
        )
    place = int(first) if first else 0, int(last) if last else None
    return pattern, Source(Path(pattern), dataset, *place)
