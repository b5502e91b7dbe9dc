"""Streams for libraries that write files themselves and hide errors."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class DataStream(io.BufferedRandom):
    """Writable file without a descriptor, for libraries that write NumPy's arrays.

    With a descriptor they call `ndarray.tofile`, which ignores a full disk at the end of an array;
    without one they call `write`, which raises.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path, "w+"))

    def fileno(self) -> int:
        """Raises io.UnsupportedOperation."""
        raise io.UnsupportedOperation("this stream has no descriptor")


class PatientStream(io.FileIO):
    """File for HDF5, which ends the process if its last writes fail as it closes a file.

    After the first failed write, data are dropped; `check` then raises the error.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._failed: OSError | None = None

    def write(self, data: Any) -> int:
        """Writes or drops all of `data`."""
        remaining = memoryview(data)
        size = remaining.nbytes
        try:
            while remaining and self._failed is None:
                remaining = remaining[super().write(remaining) :]
        except OSError as error:
            self._failed = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Truncates like io.FileIO, but keeps the error for `check`."""
        try:
            return super().truncate(size)
        except OSError as error:
            self._failed = self._failed or error
            return size or 0

    def check(self) -> None:
        """Raises the error of the first failed write."""
        if self._failed is not None:
            raise self._failed


@contextmanager
def new_hdf(path: Path, h5py: Any) -> Iterator[tuple[Any, Callable[[], None]]]:
    """New HDF5 file of the module `h5py`, and a function that raises the error of a failed write,
    which is also raised at the end.
    """
    with PatientStream(path) as stream:
        try:
            with h5py.File(stream, "w") as file:
                yield file, stream.check
        except Exception:
            stream.check()  # HDF5 cannot read back what was not written: the disk is the cause
            raise
        stream.check()
