"""HDF5 and NeXus: data sets of images and of temperatures."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.pictures.source import (
    SECONDS_OF_UNIT,
    ArrayStack,
    Source,
    Told,
    moment_s,
)
from cldit.errors import EvaluationError
from cldit.io.files import check_regular

_INSTALL = 'pip install "cldit[files]"'


class Hdf5(ArrayStack):
    """A data set (frames, rows, columns), or (rows, columns)."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._file, data = _open(source, (2, 3))
        super().__init__(data, source.axes, unit=str(data.attrs.get("units", "")))
        self.told = _told(data.parent, len(self))

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns)."""
        try:
            return super().read(number)
        except OSError as error:
            raise _undecoded(self._source, error) from error

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def _told(group: Any, count: int) -> tuple[Told, ...]:
    """Times and exposures according to NeXus' NXdetector: `count_time`, and `start_time` with its
    attribute `start`.
    """
    if _text(group.attrs.get("NX_class")) != "NXdetector":
        return ()
    exposed_s, begun_s = (_seconds(group, name, count) for name in ("count_time", "start_time"))
    start_s: float | None = None
    if "start_time" in group and (start := _text(group["start_time"].attrs.get("start"))):
        try:
            start_s = moment_s(start)
        except ValueError:
            start_s = None
    return tuple(
        Told(
            None if start_s is None or begun_s is None else start_s + float(begun_s[number]),
            None if exposed_s is None else float(exposed_s[number]),
        )
        for number in range(count)
    )


def _seconds(group: Any, name: str, count: int) -> NDArray[np.float64] | None:
    """(count,) values of a field in a unit of time; None if missing, or of another length."""
    if name not in group:
        return None
    unit = SECONDS_OF_UNIT.get(_text(group[name].attrs.get("units")))
    values = np.asarray(group[name][()], float).ravel()
    if unit is None or values.size not in (1, count) or not np.all(np.isfinite(values)):
        return None
    return np.broadcast_to(values * unit, (count,))


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value or "")


def read_line(source: Source) -> NDArray[np.float64]:
    """Reads (N,) numbers of a data set with one axis, from `first` to `last`. Raises
    EvaluationError if there is no such data set, or it has another shape.
    """
    file, data = _open(source, (1,))
    try:
        return np.asarray(data[source.first : source.last], float)
    except OSError as error:
        raise _undecoded(source, error) from error
    finally:
        file.close()


def _undecoded(source: Source, error: OSError) -> EvaluationError:
    hint = f"; {_INSTALL}, which brings filters" if "filter" in str(error) else ""
    return EvaluationError(f"{source.text}: {error}{hint}")


def _open(source: Source, axes: tuple[int, ...]) -> tuple[Any, Any]:
    try:
        h5py = import_module("h5py")
    except ImportError:
        raise EvaluationError(f"{source.path}: HDF5 and NeXus need h5py; {_INSTALL}") from None
    try:
        import_module("hdf5plugin")  # its filters (blosc, bitshuffle, zstd) work once imported
    except ImportError:
        pass
    if not source.dataset:
        raise EvaluationError(
            f"{source.path}: name the data set too, as in {source.path.name}::/entry/data"
        )
    check_regular(source.path)
    file = h5py.File(source.path, "r")
    if source.dataset not in file:
        known = _datasets(file, h5py.Dataset, axes)
        file.close()
        raise EvaluationError(
            f"{source.text}: no such data set; the file has {', '.join(known) or 'none'}"
        )
    data = file[source.dataset]
    shape: tuple[int, ...] = getattr(data, "shape", ())
    if len(shape) not in axes:
        file.close()
        expected = "(frames, rows, columns)" if 3 in axes else "one axis"
        raise EvaluationError(f"{source.text}: shape {shape}, expected {expected}")
    return file, data


def _datasets(file: Any, kind: Any, axes: tuple[int, ...]) -> list[str]:
    names: list[str] = []

    def note(name: str, item: Any) -> None:
        if isinstance(item, kind) and len(item.shape) in axes:
            names.append(f"/{name}")

    file.visititems(note)
    return names
