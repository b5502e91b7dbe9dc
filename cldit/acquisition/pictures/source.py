"""Location of images, and the interface of a reader of a kind of file."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.errors import EvaluationError
from cldit.io.files import natural_order

Axis = Literal["frames", "rows", "columns"]
AXES: tuple[Axis, ...] = ("frames", "rows", "columns")

_NAMES: dict[Axis, str] = {  # of dimensions in files that name them
    "frames": "t time frame frames n shot shots number image images",
    "rows": "y row rows z height line lines",
    "columns": "x column columns col cols width",
}
CUT_OFF = "it is cut off; `incomplete: true` in measured.yaml reads what is there"

_PART = re.compile(r"^(?P<name>.*)\[(?P<first>\d*):(?P<last>\d*)(?::(?P<step>[1-9]\d*))?\]$")


@dataclass(frozen=True)
class Source:
    """A file, and where in it.

    dataset: within HDF5 and the like. first, last, step: which images. axes: order of the stack's
    axes; None for the usual one of the kind of file. incomplete: True reads what is there of a file
    that ended early, or that lists images in other files.
    """

    path: Path
    dataset: str = ""
    first: int = 0
    last: int | None = None
    step: int = 1
    axes: tuple[Axis, ...] | None = None
    incomplete: bool = False

    @property
    def part(self) -> slice:
        """The chosen images."""
        return slice(self.first, self.last, self.step)

    @property
    def text(self) -> str:
        """The file and the data set in it, as the user names them."""
        return f"{self.path}::{self.dataset}" if self.dataset else str(self.path)


@dataclass(frozen=True)
class ImageMetadata:
    """Metadata of one image; None if its file has none. time_s: since 1970, of the file's clock."""

    time_s: float | None = None
    integration_time_s: float | None = None


# Units that files name, with both signs of Unicode for micro.
SECONDS_OF_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
SECONDS_OF_UNIT |= {"min": 60.0, "h": 3600.0}


def moment_s(iso: str) -> float:
    """Seconds since 1970 of an ISO 8601 date, in UTC if it has no zone; raises ValueError
    otherwise.
    """
    moment = datetime.fromisoformat(iso.strip())
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


class Stack(Protocol):
    """Images of one file; optional attributes are `notes`, `unit` and `metadata`, an
    `ImageMetadata` for each image."""

    def __len__(self) -> int: ...

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns)."""

    def close(self) -> None:
        """Closes the file."""


def axes_named(names: Sequence[str]) -> tuple[Axis, ...] | None:
    """Order of axes by the names of two or three dimensions; None unless all of them are clear."""
    axes: list[Axis] = ["frames"] if len(names) == 2 else []
    for name in names:
        axes += [axis for axis, aliases in _NAMES.items() if name.lower() in aliases.split()]
    return tuple(axes) if sorted(axes) == sorted(AXES) else None


class NoDataSet(EvaluationError):
    """A source needs the name of one of the `known` data sets."""

    def __init__(self, source: Source, available: Sequence[str]) -> None:
        self.known = tuple(available)
        advice = f"name the data set too, as in {source.path.name}::/entry/data"
        super().__init__(
            f"{source.text}: {'no such data set' if source.dataset else advice}; the file has "
            + (", ".join(available) or "none")
        )


class ArrayStack:
    """Images of anything that numpy can index: an array, a map of a file, a data set."""

    def __init__(
        self,
        data: Any,
        axes: tuple[Axis, ...] | None = None,
        *,
        unit: str = "",
        attributes: Mapping[str, Any] | None = None,
    ) -> None:
        """Takes (..., rows, columns), or three axes in the order of `axes`, or raises ValueError.

        Of the attributes `units`, and `scale_factor` and `add_offset` of the CF conventions, which
        turn stored numbers into values, are used.
        """
        shape: tuple[int, ...] = data.shape
        if len(shape) < 2 or (len(shape) > 3 and axes not in (None, AXES)):
            raise ValueError(f"shape {shape}, expected (frames, rows, columns)")
        self._data = data
        self._frames = shape[:-2]
        self._last = (AXES if axes is None else axes).index("frames") if len(shape) == 3 else 0
        if self._last:
            self._frames = (shape[self._last],)
        self._turned = axes is not None and axes.index("columns") < axes.index("rows")
        stated = attributes or {}
        self._scale, self._shift = (
            float(np.ravel(stated.get(name, default))[0])
            for name, default in (("scale_factor", 1.0), ("add_offset", 0.0))
        )
        self.unit = unit or as_text(stated.get("units"))
        self.notes: tuple[str, ...] = ()
        if (self._scale, self._shift) != (1.0, 0.0):
            self.notes = (f"stored numbers times {self._scale:g}, plus {self._shift:g}",)

    def __len__(self) -> int:
        return int(np.prod(self._frames))

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns)."""
        place: Any = np.unravel_index(number, self._frames) if self._frames else ()
        if self._last:
            place = (slice(None),) * self._last + (number,)
        image = np.asarray(self._data[tuple(place)])
        if (self._scale, self._shift) != (1.0, 0.0):
            image = image * self._scale + self._shift
        return image.T if self._turned else image

    def close(self) -> None:
        """Does nothing: an array has no file."""


def as_text(value: Any) -> str:
    """Text of an attribute, which may be bytes; empty for None."""
    return value.decode() if isinstance(value, bytes) else str("" if value is None else value)


def pick(
    source: Source, group: Any, shapes: Callable[[], Mapping[str, tuple[int, ...]]], *, line: bool
) -> Any:
    """Data set of a `group` by the source's name, or its only one that can have images; with
    `line`, numbers along one axis.

    `shapes` are those of all data sets with numbers, by name. Raises EvaluationError if there is
    none, more than one, or one of another shape.
    """
    name = source.dataset.strip("/")

    def fits(shape: tuple[int, ...]) -> bool:
        if line:
            return len(shape) > 0 and max(shape) == np.prod(shape)
        return len(shape) > 1 and (bool(name) or sum(size > 1 for size in shape) > 1)

    if not name or name not in group:
        fitting = [dataset.strip("/") for dataset, shape in shapes().items() if fits(shape)]
        if name or len(fitting) != 1:
            raise NoDataSet(source, [f"/{dataset}" for dataset in fitting])
        name = fitting[0]
    data = group[name]
    shape: tuple[int, ...] = getattr(data, "shape", ())
    if not fits(shape):
        expected = "one axis" if line else "(frames, rows, columns)"
        raise EvaluationError(f"{source.text}: shape {shape}, expected {expected}")
    return data


def parse_source(reference: str) -> tuple[str, Source]:
    """Splits a name into the pattern of the file's name and a source with the parts after `::` and
    in `[:]`. Raises EvaluationError if the part after `::` is no data set.
    """
    part = _PART.match(reference)
    name, start, stop, step = (
        part.group("name", "first", "last", "step") if part else (reference, "", "", "")
    )
    pattern, separator, dataset = name.partition("::")
    if separator and (not dataset or "[" in dataset or "]" in dataset):
        raise EvaluationError(
            f"{reference}: {dataset!r} is no data set; allowed: /group/name, with [first:last], "
            "[first:last:step] or not"
        )
    place = int(start or 0), int(stop) if stop else None, int(step or 1)
    return pattern, Source(Path(pattern), dataset, *place)


def find_sources(
    folder: Path, patterns: tuple[str, ...], where: str, axes: tuple[Axis, ...] | None = None
) -> list[Source]:
    """Files by name, those of a pattern in natural order: frame_2 before frame_10. Raises
    EvaluationError, which begins with `where`, if a pattern matches none.
    """
    sources: list[Source] = []
    for reference in patterns:
        pattern, place = parse_source(reference)
        paths = [folder / pattern]  # a name may have brackets
        if not paths[0].exists():
            plain = Path(pattern.replace("[", "[[]"))
            root = Path(plain.anchor) if plain.is_absolute() else folder
            inside = plain.relative_to(plain.anchor) if plain.is_absolute() else plain
            paths = sorted(root.glob(str(inside)), key=natural_order)
        if not paths:
            raise EvaluationError(f"{where}: no file matches {reference} in {folder}")
        sources += [replace(place, path=path, axes=axes) for path in paths]
    return sources
