"""HDF5 and NeXus: data sets of images and of temperatures."""

from contextlib import suppress
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.pictures.arrays import MATLAB, matlab_notes
from cldit.acquisition.pictures.source import (
    SECONDS_OF_UNIT,
    ArrayStack,
    ImageMetadata,
    Source,
    as_text,
    axes_named,
    moment_s,
    pick,
)
from cldit.errors import EvaluationError, FileError
from cldit.io.extras import install_line, needed
from cldit.io.files import check_regular
from cldit.io.hdf_files import check_links, check_sources


class Hdf5(ArrayStack):
    """A data set (..., rows, columns); MATLAB's (rows, columns, frames) is stored transposed."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._file, data = _open(source, line=False)
        matlab = "MATLAB_class" in data.attrs
        names = [dim.keys()[0].rpartition("/")[2] if len(dim) else dim.label for dim in data.dims]
        axes = (source.axes or MATLAB)[::-1] if matlab else source.axes or axes_named(names)
        super().__init__(data, axes, attributes=data.attrs)
        self.notes += matlab_notes(source, data.shape) if matlab else ()
        self.metadata = _metadata(data.parent, len(self))

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns)."""
        try:
            return super().read(number)
        except OSError as error:
            raise _undecoded(self._source, error) from error

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def _metadata(group: Any, count: int) -> tuple[ImageMetadata, ...]:
    """Times and exposures according to NeXus' NXdetector: `count_time`, and `start_time` with its
    attribute `start`.
    """
    if as_text(group.attrs.get("NX_class")) != "NXdetector":
        return ()
    exposed_s, begun_s = (_seconds(group, name, count) for name in ("count_time", "start_time"))
    start_s: float | None = None
    if "start_time" in group and (start := as_text(group["start_time"].attrs.get("start"))):
        try:
            start_s = moment_s(start)
        except ValueError:
            start_s = None
    return tuple(
        ImageMetadata(
            None if start_s is None or begun_s is None else start_s + float(begun_s[number]),
            None if exposed_s is None else float(exposed_s[number]),
        )
        for number in range(count)
    )


def _seconds(group: Any, name: str, count: int) -> NDArray[np.float64] | None:
    """(count,) values of a field in a unit of time; None if missing, or of another length."""
    if name not in group:
        return None
    unit = SECONDS_OF_UNIT.get(as_text(group[name].attrs.get("units")))
    values = np.asarray(group[name][()], float).ravel()
    if unit is None or values.size not in (1, count) or not np.all(np.isfinite(values)):
        return None
    return np.broadcast_to(values * unit, (count,))


def read_line(source: Source) -> NDArray[np.float64]:
    """Reads the chosen numbers of a data set with one axis, (N,). Raises EvaluationError if there
    is no such data set, or it has another shape.
    """
    file, data = _open(source, line=True)
    try:
        return np.asarray(data[()], float).ravel()[source.part]
    except OSError as error:
        raise _undecoded(source, error) from error
    finally:
        file.close()


def _undecoded(source: Source, error: OSError) -> EvaluationError:
    hint = f"; filters: {install_line('files')}" if "filter" in str(error) else ""
    return EvaluationError(f"{source.text}: {error}{hint}")


def _open(source: Source, *, line: bool) -> tuple[Any, Any]:
    h5py = needed("h5py", extra="files", needed_by=f"{source.path}: HDF5", error=EvaluationError)
    with suppress(ImportError):
        import_module("hdf5plugin")  # its filters (blosc, bitshuffle, zstd) work once imported
    check_regular(source.path)
    file = h5py.File(source.path, "r")

    def shapes() -> dict[str, tuple[int, ...]]:
        by_name: dict[str, tuple[int, ...]] = {}

        def note(name: str, item: Any) -> None:
            numbers = isinstance(item, h5py.Dataset) and item.dtype.kind in "uif"
            if numbers and not name.startswith("#"):  # of MATLAB's own
                by_name[name] = item.shape

        file.visititems(note)
        return by_name

    try:
        check_links(source.path, file, complete=False)
        data = pick(source, file, shapes, line=line)
        check_sources(source.path, data, complete=not source.incomplete)
        return file, data
    except FileError as error:
        file.close()
        raise EvaluationError(str(error)) from error
    except BaseException:
        file.close()
        raise
