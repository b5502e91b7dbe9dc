"""Films of Telops infrared cameras (.hcc), read with fasthcc for the evaluation."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.errors import ClditError

_RAW, _NON_UNIFORMITY_CORRECTED = 0, 1  # calibration modes whose pixels are counts


class HccError(ClditError):
    """A film cannot be read, or contains no counts."""


@dataclass(frozen=True)
class HccFilm:
    """Content of a film.

    frames: (n, h, w) counts, row 0 at the top. integration_time_s, time: of each frame, in UTC.
    frame_ids: the camera's count; a gap is a lost frame. corrected: True if the camera has
    corrected the chip's non-uniformity. headers: all metadata of the camera, a dict per frame.
    """

    frames: NDArray[np.uint16]
    integration_time_s: NDArray[np.float64]
    frame_ids: NDArray[np.int64]
    time: tuple[datetime, ...]
    frame_rate_Hz: float
    corrected: bool
    headers: tuple[dict[str, Any], ...]


def read_hcc(path: str | Path) -> HccFilm:
    """Reads a film of raw or non-uniformity corrected counts; raises as `HccReader`."""
    with HccReader(Path(path)) as reader:
        headers = reader.headers
        return HccFilm(
            frames=reader.frames(0, len(headers)),
            integration_time_s=np.array(
                [1e-6 * float(header["ExposureTime"]) for header in headers]
            ),
            frame_ids=np.array([header["FrameID"] for header in headers], np.int64),
            time=tuple(frame_time(header) for header in headers),
            frame_rate_Hz=reader.frame_rate_Hz,
            corrected=reader.corrected,
            headers=headers,
        )


class HccReader:
    """Open film: its headers, checked, and its frames on request.

    Raises:
        HccError: fasthcc is not installed; the file is missing, damaged or truncated; frames are
            missing; or the pixels are temperatures or radiances, from which DIT cannot start.
    """

    def __init__(self, path: Path) -> None:
        try:
            import fasthcc
        except ImportError as error:
            raise HccError("Telops films need fasthcc: pip install cldit[hcc]") from error
        self._path = path
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # of a file that is cut short
                self._reader = fasthcc.HCCReader(path)
        except (OSError, ValueError, KeyError, Warning) as error:
            raise self._unreadable(error) from error
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                self.headers = tuple(dict(header) for header in self._reader.read_metadata())
                mode, scale = int(self._reader.calibration_mode), int(self._reader.data_exp)
                self.frame_rate_Hz = float(self._reader.frame_rate)
            self.corrected = mode == _NON_UNIFORMITY_CORRECTED
            self._check(mode, scale)
        except (OSError, ValueError, KeyError, Warning) as error:
            self._reader.close()
            raise self._unreadable(error) from error
        except HccError:
            self._reader.close()
            raise

    def _unreadable(self, error: Exception) -> HccError:
        return HccError(f"{self._path}: cannot be read as a Telops film ({error})")

    def _check(self, mode: int, scale: int) -> None:
        if mode not in (_RAW, _NON_UNIFORMITY_CORRECTED):
            raise HccError(
                f"{self._path}: calibration mode {mode} with exponent {scale} holds no counts; "
                "record in the mode Raw (0) or NUC (1)"
            )
        ids = np.array([header["FrameID"] for header in self.headers], np.int64)
        gaps = np.flatnonzero(np.diff(ids) != 1)
        if len(gaps):
            raise HccError(
                f"{self._path}: frame {ids[gaps[0]] + 1} is missing, {len(gaps)} gaps in all; "
                "record again"
            )

    def frames(self, first: int, last: int) -> NDArray[np.uint16]:
        """Counts (N, h, w) of the images from `first` up to `last`, exclusive, row 0 at the top."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                found = np.asarray(self._reader.read_frames(first, last))
        except (OSError, ValueError, KeyError, Warning) as error:
            raise self._unreadable(error) from error
        return found.astype(np.uint16, copy=False)

    def close(self) -> None:
        """Closes the film."""
        self._reader.close()

    def __enter__(self) -> HccReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def frame_time(header: dict[str, Any]) -> datetime:
    """Time of a frame in UTC, from whole seconds of its `header` and steps of 100 ns."""
    seconds = header.get("POSIXTime", 0) + 1e-7 * header.get("SubSecondTime", 0)
    return datetime.fromtimestamp(seconds, UTC)
