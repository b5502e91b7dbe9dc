"""Arrays by name: MATLAB's files up to version 7, netCDF 3, and Zarr."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.pictures.source import ArrayStack, Axis, Source, axes_named, pick
from cldit.errors import EvaluationError
from cldit.io.extras import needed
from cldit.io.files import check_regular
from cldit.io.hdf_files import check_chunks

MATLAB: tuple[Axis, ...] = ("rows", "columns", "frames")


def matlab_notes(source: Source, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Remark on the order of axes that is assumed for an array of MATLAB."""
    if source.axes is not None or len(shape) != 3:
        return ()
    return ("axes: rows, columns, frames, as is usual in MATLAB",)


class Matlab5(ArrayStack):
    """A variable (rows, columns, frames) of a .mat file of version 5 to 7."""

    def __init__(self, source: Source) -> None:
        from scipy.io import loadmat, whosmat

        check_regular(source.path)
        variables = {
            name: SimpleNamespace(name=name, shape=shape)  # not read yet
            for name, shape, kind in whosmat(source.path)
            if kind in ("single", "double") or "int" in kind
        }
        shapes = {name: variable.shape for name, variable in variables.items()}
        chosen = pick(source, variables, lambda: shapes, line=False)
        data = loadmat(source.path, variable_names=[chosen.name])[chosen.name]
        super().__init__(data, source.axes or MATLAB)
        self.notes += matlab_notes(source, data.shape)


class NetCdf3(ArrayStack):
    """A variable (..., rows, columns) of a netCDF file of version 3; it stays in the file."""

    def __init__(self, source: Source) -> None:
        from scipy.io import netcdf_file

        check_regular(source.path)
        self._file = netcdf_file(source.path, "r", mmap=False)
        try:
            shapes = {name: stored.shape for name, stored in self._file.variables.items()}
            variable = pick(source, self._file.variables, lambda: shapes, line=False)
            axes = source.axes or axes_named(variable.dimensions)
            super().__init__(variable.data, axes, attributes=variable._attributes)
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


class Zarr(ArrayStack):
    """An array (..., rows, columns) of a Zarr folder; chunks are read as they are needed."""

    def __init__(self, source: Source) -> None:
        array = _zarr(source, line=False)
        if not source.incomplete:
            check_chunks(source.text, array.nchunks, array.nchunks_initialized)
        attributes, dimensions = dict(array.attrs), getattr(array.metadata, "dimension_names", None)
        names = [str(name) for name in dimensions or attributes.get("_ARRAY_DIMENSIONS") or ()]
        super().__init__(array, source.axes or axes_named(names), attributes=attributes)


def read_line(source: Source) -> NDArray[np.float64]:
    """Reads the chosen numbers of a Zarr array with one axis, (N,)."""
    return np.asarray(_zarr(source, line=True)[...], float).ravel()[source.part]


def _zarr(source: Source, *, line: bool) -> Any:
    zarr = needed("zarr", extra="zarr", needed_by=f"{source.path}: Zarr", error=EvaluationError)
    root = zarr.open(str(source.path), mode="r")
    if isinstance(root, zarr.Array):
        return pick(source, {"": root, source.dataset.strip("/"): root}, lambda: {"": root.shape},
                    line=line)  # fmt: skip
    return pick(
        source,
        root,
        lambda: {name: array.shape for name, array in root.members(max_depth=None)
                 if isinstance(array, zarr.Array)},
        line=line,
    )  # fmt: skip
