"""TIFF: one image per page, or several images in one page as ImageJ writes them."""

import logging
import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any
from xml.etree import ElementTree

import numpy as np
import tifffile
from numpy.typing import NDArray

from cldit.acquisition.pictures.source import (
    CUT_OFF,
    SECONDS_OF_UNIT,
    ImageMetadata,
    Source,
    moment_s,
)
from cldit.errors import EvaluationError
from cldit.io.extras import install_line
from cldit.io.files import open_regular
from cldit.io.plain_data import parse_json

_ORIENTATION, _TIME = 274, 306  # tags of TIFF 6.0
_OME_AXES = ("TheT", "TheZ", "TheC")


class Tiff:
    """Images of a TIFF file, rotated according to its orientation tags."""

    def __init__(self, source: Source) -> None:
        self._path = source.path
        self._incomplete = source.incomplete
        self._stream = open_regular(source.path)
        self._stack: NDArray[Any] | None = None
        try:
            with _quiet():
                self._file = tifffile.TiffFile(self._stream)
                self._imagej = self._file.imagej_metadata or {}
                self._pages: Sequence[int] = range(len(self._file.pages))
                series = self._file.series[0]
                self._size = os.fstat(self._stream.fileno()).st_size
                declared = self._imagej.get("images", 1)
                in_page = series.ndim > 2 and series.axes.endswith("YX")
                if len(self._pages) == 1 and (in_page or (self._incomplete and declared > 1)):
                    if not self._incomplete:
                        self._check_end(series.dataoffset, series.nbytes)
                    self._stack = self._of_one_page(series, declared)
                elif self._incomplete:
                    self._pages = [n for n in self._pages if self._end(n) <= self._size]
                if not self._incomplete:
                    self._check_whole()
            self._turn = self._tag(0, _ORIENTATION, 1)
            self.unit = self._info_unit()
            self.notes = self._notes()
            self.metadata = self._metadata()
        except BaseException:
            self._stream.close()
            raise

    def _of_one_page(self, series: Any, declared: int) -> NDArray[Any]:
        rows, columns = series.shape[-2:]
        if series.dataoffset is None:  # compressed
            return np.asarray(series.asarray()).reshape(-1, rows, columns)
        count = max(series.size // (rows * columns), declared if self._incomplete else 0)
        if self._incomplete:
            image_bytes = rows * columns * series.dtype.itemsize
            count = min(count, (self._size - series.dataoffset) // image_bytes)
        flat: NDArray[Any] = np.memmap(
            self._path,
            self._file.byteorder + series.dtype.char,
            "r",
            series.dataoffset,
            (count, rows, columns),
        )
        return flat

    def _check_end(self, offset: int | None, count: int) -> None:
        if offset is not None and offset + count > self._size:
            raise ValueError(
                f"its images end at byte {offset + count}, the file at {self._size}; {CUT_OFF}"
            )

    def _check_whole(self) -> None:
        """Raises ValueError if a file contains fewer images than it declares.

        A truncated file still opens: its readers stop at the last page that they find.
        """
        file = self._file
        declared = self._imagej.get("images", 1)
        if len(self) < declared:
            raise ValueError(f"ImageJ says {declared} images, {len(self)} are there; {CUT_OFF}")
        if self._follows(file.pages[-1].offset):
            raise ValueError(f"another page follows the last of {len(file.pages)}; {CUT_OFF}")
        if file.is_ome:
            missing = sum(page is None for series in file.series for page in series.pages)
            if missing:
                raise ValueError(f"OME lists {missing} images that are not there; {CUT_OFF}")

    def _end(self, number: int) -> int:
        page: Any = self._file.pages[number]
        ends = (at + count for at, count in zip(page.dataoffsets, page.databytecounts, strict=True))
        return max(ends, default=0)

    def _follows(self, offset: int) -> int:
        """Offset of the page after the directory at `offset`; 0 for none."""
        form = self._file.tiff
        self._stream.seek(offset)
        (tags,) = struct.unpack(form.tagnoformat, self._stream.read(form.tagnosize))
        self._stream.seek(offset + form.tagnosize + tags * form.tagsize)
        (following,) = struct.unpack(form.offsetformat, self._stream.read(form.offsetsize))
        return int(following)

    def _tag(self, number: int, code: int, default: Any) -> Any:
        page: Any = self._file.pages[self._pages[number]]
        tag = page.tags.get(code) if hasattr(page, "tags") else None
        return default if tag is None else tag.value

    def _info_unit(self) -> str:
        try:
            info = parse_json(self._imagej.get("Info", "{}"))
        except (ValueError, TypeError):
            return ""
        return str(info.get("unit", "")) if isinstance(info, dict) else ""

    def _notes(self) -> tuple[str, ...]:
        notes = []
        if self._turn != 1:
            notes.append(f"turned as orientation tag {self._turn} says")
        if taken := self._tag(0, _TIME, ""):
            notes.append(f"file made {taken}")
        series = self._file.series[0]
        if series.axes.endswith("CYX") and series.shape[-3] > 1:
            channels = series.shape[-3]
            notes.append(f"{channels} channels in turns; [0::{channels}] takes the first")
        return tuple(notes)

    def _metadata(self) -> tuple[ImageMetadata, ...]:
        return ome_metadata(self._file.ome_metadata, len(self)) if self._file.ome_metadata else ()

    def __len__(self) -> int:
        return len(self._pages) if self._stack is None else len(self._stack)

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns); raises EvaluationError if its compression needs a
        package that is not installed, and ValueError if the file is truncated.
        """
        if self._stack is not None:
            return turned(np.asarray(self._stack[number]), self._turn)
        page: Any = self._file.pages[self._pages[number]]
        if self._end(self._pages[number]) > self._size:  # missing strips would be read as zeros
            raise ValueError(f"its pixels end before the page does; {CUT_OFF}")
        try:
            picture = np.asarray(page.asarray())
        except (ImportError, ValueError) as error:
            if page.compression == 1 or find_spec("imagecodecs") is not None:
                raise
            raise EvaluationError(
                f"{self._path}: compressed as {page.compression.name}, which needs imagecodecs; "
                f"install it with: {install_line('files')}"
            ) from error
        if picture.ndim != 2:
            raise EvaluationError(
                f"{self._path}: image of shape {picture.shape} holds colours, not counts; "
                "export grey images of 16 bits"
            )
        return turned(picture, self._tag(number, _ORIENTATION, self._turn))

    def close(self) -> None:
        """Closes the file."""
        self._stack = None
        self._file.close()
        self._stream.close()


def ome_metadata(xml: str, count: int) -> tuple[ImageMetadata, ...]:
    """Time and exposure of each image, if the file's one OME image has a plane for each along one
    axis.

    `AcquisitionDate`, `DeltaT` and `ExposureTime` are those of the OME data model (2016-06), whose
    default unit is the second. Empty if planes and the `count` of images do not match.
    """
    try:
        images = ElementTree.fromstring(xml).findall("{*}Image")
    except ElementTree.ParseError:
        return ()
    if len(images) != 1:
        return ()
    planes = images[0].findall("{*}Pixels/{*}Plane")
    varying = [axis for axis in _OME_AXES if len({plane.get(axis) for plane in planes}) > 1]
    if len(planes) != count or len(varying) > 1:
        return ()
    try:
        if varying:
            planes.sort(key=lambda plane: int(plane.get(varying[0]) or 0))
        date = images[0].findtext("{*}AcquisitionDate")
        start_s = moment_s(date) if date else None
        return tuple(_of_plane(plane, start_s) for plane in planes)
    except ValueError:
        return ()


def _of_plane(plane: Any, start_s: float | None) -> ImageMetadata:
    later_s, exposed_s = (_seconds(plane, name) for name in ("DeltaT", "ExposureTime"))
    taken_s = None if start_s is None or later_s is None else start_s + later_s
    return ImageMetadata(taken_s, exposed_s)


def _seconds(plane: Any, name: str) -> float | None:
    value, unit = plane.get(name), plane.get(f"{name}Unit", "s")
    if value is None or unit not in SECONDS_OF_UNIT:
        return None
    return float(value) * SECONDS_OF_UNIT[unit]


def turned(picture: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Rotates a stored (rows, columns) image for viewing, by its `orientation` from 1 to 8 (TIFF
    6.0, tag 274). Raises ValueError for another orientation.
    """
    if orientation not in range(1, 9):
        raise ValueError(f"orientation tag {orientation}; allowed: 1 to 8")
    if orientation > 4:  # rows of the file are columns
        picture = picture.T
    if orientation in (3, 4, 7, 8):
        picture = picture[::-1]
    if orientation in (2, 3, 6, 7):
        picture = picture[:, ::-1]
    return picture


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppresses tifffile's log of damage; `_check_whole` reports it in full."""
    logger = logging.getLogger("tifffile")
    keep = _Nothing()
    logger.addFilter(keep)
    try:
        yield
    finally:
        logger.removeFilter(keep)


class _Nothing(logging.Filter):
    def filter(self, record: logging.LogRecord) -> bool:
        return False
