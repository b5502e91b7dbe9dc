"""Pictures out of the files that cameras and other programs write: TIFF, HDF5 and NeXus, .hcc.

A file is named as it is; a data set within HDF5 or NeXus as `run.nxs::/entry/data/frames`, of which
`[10:20]` at the end takes a part.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import tifffile
from numpy.typing import NDArray

from cldit.acquisition.hcc import HccError, HccReader
from cldit.errors import EvaluationError, FileError
from cldit.files import check_regular, open_regular

_PLACE = re.compile(r"^(?P<dataset>[^\[\]]+?)(\[(?P<first>\d*):(?P<last>\d*)\])?$")
_TIFF = (".tif", ".tiff")
_HCC = (".hcc",)
_HDF5 = (".h5", ".hdf5", ".hdf", ".nxs", ".nx", ".nexus")


@dataclass(frozen=True)
class Source:
    """A file, and where in it; `text` as the user wrote it."""

    path: Path
    dataset: str = ""
    first: int = 0
    last: int | None = None

    @property
    def text(self) -> str:
        """The file and the data set in it, as the user names them."""
        return f"{self.path}::{self.dataset}" if self.dataset else str(self.path)


class Stack(Protocol):
    """Pictures of one file."""

    def __len__(self) -> int: ...

    def read(self, number: int) -> NDArray[Any]:
        """Picture `number`, (rows, columns)."""

    def close(self) -> None:
        """Closes the file."""


def parse_source(text: str) -> tuple[str, Source]:
    """The pattern of the file's name, and a source with what stands behind `::`.

    Raises:
        EvaluationError: what stands behind `::` is no data set.
    """
    pattern, _, place = text.partition("::")
    if not place:
        return pattern, Source(Path(pattern))
    found = _PLACE.match(place)
    if found is None:
        raise EvaluationError(
            f"{text}: {place!r} is no data set; allowed is /group/name, with [first:last] or not"
        )
    first, last = found["first"], found["last"]
    source = Source(
        Path(pattern), found["dataset"], int(first) if first else 0, int(last) if last else None
    )
    return pattern, source


class _Tiff:
    """One page a picture; of a page with several pictures (ImageJ's), each."""

    def __init__(self, source: Source) -> None:
        self._stream = open_regular(source.path)
        self._stack: NDArray[Any] | None = None
        try:
            self._file = tifffile.TiffFile(self._stream)
            self._pages = len(self._file.pages)
            first = self._file.series[0]
            if self._pages == 1 and first.ndim == 3 and first.axes.endswith("YX"):
                self._stack = tifffile.memmap(source.path, mode="r")
            self._check_whole()
        except BaseException:
            self._stream.close()
            raise

    def _check_whole(self) -> None:
        """Raises ValueError where a file holds fewer pictures than it says.

        A file that was cut off still opens: its readers stop at the last page that they find.
        """
        file = self._file
        told = (file.imagej_metadata or {}).get("images", 1)
        if len(self) < told:
            raise ValueError(f"ImageJ says {told} pictures, {len(self)} are there; it is cut off")
        if self._follows(file.pages[-1].offset):
            raise ValueError(f"another page follows the last of {self._pages}; it is cut off")
        if file.is_ome:
            missing = sum(page is None for series in file.series for page in series.pages)
            if missing:
                raise ValueError(f"OME lists {missing} pictures that are not there")

    def _follows(self, offset: int) -> int:
        """Where a page's directory at `offset` says that the next one is; 0 for none."""
        form = self._file.tiff
        self._stream.seek(offset)
        (tags,) = struct.unpack(form.tagnoformat, self._stream.read(form.tagnosize))
        self._stream.seek(offset + form.tagnosize + tags * form.tagsize)
        (following,) = struct.unpack(form.offsetformat, self._stream.read(form.offsetsize))
        return int(following)

    def __len__(self) -> int:
        return self._pages if self._stack is None else len(self._stack)

    def read(self, number: int) -> NDArray[Any]:
        if self._stack is not None:
            return np.asarray(self._stack[number])
        page: Any = self._file.pages[number]
        size = os.fstat(self._stream.fileno()).st_size
        ends = (at + count for at, count in zip(page.dataoffsets, page.databytecounts, strict=True))
        if max(ends, default=0) > size:  # missing strips would be read as zeros
            raise ValueError("its pixels end before the page does; the file is cut off")
        return np.asarray(page.asarray())

    def close(self) -> None:
        self._stack = None
        self._file.close()
        self._stream.close()


class _Hdf5:
    """A data set (frames, rows, columns), or (rows, columns)."""

    def __init__(self, source: Source) -> None:
        try:
            import h5py
        except ImportError:
            raise EvaluationError(
                f"{source.path}: HDF5 and NeXus need h5py; pip install 'cldit[cfd]'"
            ) from None
        check_regular(source.path)
        self._file = h5py.File(source.path, "r")
        if source.dataset not in self._file:
            known = _datasets(self._file, h5py.Dataset)
            self._file.close()
            raise EvaluationError(
                f"{source.text}: no such data set; the file has {', '.join(known) or 'none'}"
            )
        self._data = self._file[source.dataset]
        shape: tuple[int, ...] = getattr(self._data, "shape", ())
        if len(shape) not in (2, 3):
            self._file.close()
            raise EvaluationError(f"{source.text}: shape {shape}, expected (frames, rows, columns)")
        self._flat = len(shape) == 2
        count = 1 if self._flat else shape[0]
        self._first = min(source.first, count)
        self._last = count if source.last is None else source.last
        if self._last > count:
            self._file.close()
            raise EvaluationError(f"{source.text}: has {count} frames, asked for {source.last}")

    def __len__(self) -> int:
        return int(max(self._last - self._first, 0))

    def read(self, number: int) -> NDArray[Any]:
        return np.asarray(self._data[()] if self._flat else self._data[self._first + number])

    def close(self) -> None:
        self._file.close()


class _Hcc:
    """A Telops film, read frame by frame."""

    def __init__(self, source: Source) -> None:
        check_regular(source.path)
        self._film = HccReader(source.path)

    def __len__(self) -> int:
        return len(self._film.headers)

    def read(self, number: int) -> NDArray[Any]:
        return np.asarray(self._film.frames(number, number + 1)[0])

    def close(self) -> None:
        self._film.close()


def _datasets(file: Any, kind: Any) -> list[str]:
    names: list[str] = []

    def note(name: str, item: Any) -> None:
        if isinstance(item, kind) and len(item.shape) in (2, 3):
            names.append(f"/{name}")

    file.visititems(note)
    return names


_READERS: tuple[tuple[tuple[str, ...], Callable[[Source], Stack]], ...] = (
    (_TIFF, _Tiff),
    (_HDF5, _Hdf5),
    (_HCC, _Hcc),
)


def open_stack(source: Source) -> Stack:
    """Opens a file of pictures; nothing of them is read yet.

    Raises:
        EvaluationError: of another kind, missing, damaged, or without the data set.
    """
    suffix = source.path.suffix.lower()
    for suffixes, reader in _READERS:
        if suffix in suffixes:
            if suffixes is _HDF5 and not source.dataset:
                raise EvaluationError(
                    f"{source.path}: name the data set too, as in {source.path.name}::/entry/data"
                )
            try:
                stack = reader(source)
                if len(stack) == 0:
                    stack.close()
                    raise EvaluationError(f"{source.text}: cannot be read (holds no picture)")
                return stack
            except EvaluationError:
                raise
            except (HccError, FileError) as error:
                raise EvaluationError(str(error)) from error
            except Exception as error:  # damaged headers lead the readers into errors of all kinds
                raise EvaluationError(f"{source.path}: cannot be read ({error})") from error
    allowed = ", ".join(one for suffixes, _ in _READERS for one in suffixes)
    raise EvaluationError(f"{source.path}: {suffix or 'no ending'}; allowed: {allowed}")


class FrameReader:
    """Reads pictures in any order, holding the last file open."""

    def __init__(self) -> None:
        self._source: Source | None = None
        self._stack: Stack | None = None

    def count(self, source: Source) -> int:
        """Number of pictures in a file."""
        return len(self._open(source))

    def read(self, source: Source, number: int) -> NDArray[Any]:
        """Picture `number` of the file `source`, (rows, columns).

        Raises:
            EvaluationError: it cannot be read.
        """
        stack = self._open(source)
        try:
            return stack.read(number)
        except Exception as error:
            raise EvaluationError(f"{source.text}: picture {number}: {error}") from error

    def close(self) -> None:
        """Lets go of the file; the next picture opens it again."""
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
