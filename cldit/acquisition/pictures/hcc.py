"""Films of Telops infrared cameras (.hcc), read with fasthcc frame by frame."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.pictures.source import ImageMetadata, Source
from cldit.errors import EvaluationError
from cldit.io.extras import needed
from cldit.io.files import check_regular

_COUNTS = (0, 1)  # calibration modes: raw, and corrected for the chip's non-uniformity


class Hcc:
    """Open film with checked headers.

    Raises EvaluationError: fasthcc is not installed; the file is damaged or truncated; frames are
    missing; or the pixels are temperatures or radiances, from which DIT cannot start.
    """

    def __init__(self, source: Source) -> None:
        fasthcc = needed(
            "fasthcc", extra="hcc", needed_by=f"{source.path}: Telops", error=EvaluationError
        )
        self._path, self._incomplete = source.path, source.incomplete
        check_regular(source.path)
        with self._damaged():
            self._film = fasthcc.HCCReader(source.path)
        try:
            with self._damaged():
                headers = [dict(header) for header in self._film.read_metadata()]
                mode = int(self._film.calibration_mode)
            self._check(mode, np.array([header["FrameID"] for header in headers], np.int64))
            self.metadata = tuple(_metadata(header) for header in headers)
        except EvaluationError:
            self._film.close()
            raise

    @contextmanager
    def _damaged(self) -> Iterator[None]:
        try:
            with warnings.catch_warnings():
                # of a file that is cut short
                warnings.simplefilter("ignore" if self._incomplete else "error")
                yield
        except (OSError, ValueError, KeyError, Warning) as error:
            raise EvaluationError(
                f"{self._path}: cannot be read as a Telops film ({error})"
            ) from error

    def _check(self, mode: int, ids: NDArray[np.int64]) -> None:
        if mode not in _COUNTS:
            raise EvaluationError(
                f"{self._path}: calibration mode {mode} holds no counts; record in the mode Raw "
                "(0) or NUC (1)"
            )
        gaps = np.flatnonzero(np.diff(ids) != 1)
        if len(gaps) and not self._incomplete:
            raise EvaluationError(
                f"{self._path}: frame {ids[gaps[0]] + 1} is missing, {len(gaps)} gaps in all; "
                "record again"
            )

    def __len__(self) -> int:
        return len(self.metadata)

    def read(self, number: int) -> NDArray[np.uint16]:
        """Image `number`, (rows, columns)."""
        with self._damaged():
            return np.asarray(self._film.read_frames(number, number + 1)[0], np.uint16)

    def close(self) -> None:
        """Closes the film."""
        self._film.close()


def _metadata(header: dict[str, Any]) -> ImageMetadata:
    """Time of a frame, of whole seconds and steps of 100 ns, and its exposure."""
    seconds = header.get("POSIXTime") or 0
    time_s = seconds + 1e-7 * header.get("SubSecondTime", 0) if seconds else None
    return ImageMetadata(time_s, 1e-6 * float(header["ExposureTime"]) or None)
