"""Streams for libraries that write files by themselves and do not tell what fails."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any


class DataStream(io.BufferedRandom):
    """A file without a number, opened to write, for libraries that write NumPy's arrays.

    With a number they call `ndarray.tofile`, which does not notice when the end of an array finds
    no room on the disk; without one they call `write`, which does.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path, "w+"))

    def fileno(self) -> int:
        """Raises io.UnsupportedOperation: there is none."""
        raise io.UnsupportedOperation("this stream has no number")


class PatientStream(io.FileIO):
    """A file for HDF5, which ends the process where its last writes fail as it closes a file.

    From the first write that fails on, all is taken and dropped; `check` then raises the error.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._failed: OSError | None = None

    def write(self, data: Any) -> int:
        """Writes all of `data`, or drops it."""
        left = memoryview(data)
        size = left.nbytes
        try:
            while left and self._failed is None:
                left = left[super().write(left) :]
        except OSError as error:
            self._failed = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """As io.FileIO has it with `size`, but for the error."""
        try:
            return super().truncate(size)
        except OSError as error:
            self._failed = self._failed or error
            return size or 0

    def check(self) -> None:
        """Raises what a write failed with."""
        if self._failed is not None:
            raise self._failed
