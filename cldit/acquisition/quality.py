"""Quality of a shot: complete frames in order, a live image, fuel in the air, the exposure."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.plan import Plan, Shot
from cldit.acquisition.preflight import Ready
from cldit.camera.calibration import Calibration
from cldit.optics.planck import band_radiance
from cldit.rig.protocols import Frame

_STANDS_OUT = 5.0  # standard deviations; by chance, 1 block of 1.7 million
_BY_CHANCE = 1  # blocks that may stand out all the same: a flickering pixel makes one
_BLOCK_pixels = 8  # side of a block: averages noise, and is smaller than any plume


def frame_problem(
    frames: Sequence[Frame], ready: Ready, *, expected_id: int | None = None
) -> str | None:
    """Problem of the frames of one shot, in the order of arrival, that forbids keeping it; None if
    there is none. `expected_id` is that of the first frame, None if unknown.
    """
    start = frames[0].frame_id if expected_id is None else expected_id
    for expected, frame in enumerate(frames, start=start):
        if frame.frame_id != expected:
            return f"missing frame: frame {frame.frame_id} came in place of {expected}"
        if frame.data.shape != ready.shape or frame.data.dtype != np.uint16:
            return (
                f"damaged frame: {frame.data.dtype} of shape {frame.data.shape}, expected uint16 "
                f"of {ready.shape}"
            )
        if frame.data.min() == frame.data.max() < ready.saturation_counts:
            return f"dead frame: every pixel shows {frame.data.min()}"
    return None


class References:
    """References of a background, filter and delay, against which an injection without fuel is
    recognised.

    Images are compared in blocks of pixels. A possible drift of the black body between two shots is
    removed first, as a change linear in the reference and no larger than the plan's drift_K allows;
    that is exact for a disc in front of walls. The rest is compared with shot noise, read noise and
    rounding. Fuel is present if more than one block exceeds them, so that noise unknown to the
    calibration lets a shot pass and never rejects a good one.
    """

    def __init__(self, plan: Plan, ready: Ready) -> None:
        self._plan = plan
        self._calibrations = ready.calibrations
        self._side = max(1, min(_BLOCK_pixels, min(ready.shape) // 32))
        self._sums: dict[tuple[int, ...], NDArray[np.float64]] = {}
        self._counts = Counter[tuple[int, ...]]()

    def learn(self, shot: Shot, image: NDArray[np.uint16]) -> None:
        """Learns from a kept reference `shot`; its `image` is (h, w) or (n, h, w)."""
        for frame in _frames(image):
            self._sums[_place(shot)] = self._sums.get(_place(shot), 0.0) + self._blocks(frame)
            self._counts[_place(shot)] += 1

    def problem(self, shot: Shot, image: NDArray[np.uint16]) -> str | None:
        """Problem of an injection `shot` with its `image`, (h, w) or (n, h, w), that forbids
        keeping it.

        None also if there is no reference to compare.
        """
        count = self._counts[_place(shot)]
        if not self._plan.expect_fuel or shot.kind != "injection" or count == 0:
            return None
        reference = self._sums[_place(shot)] / count
        camera = self._calibrations[shot.filter]
        deviation = np.sqrt(self._variance(camera, reference) * (1.0 + 1.0 / count))
        for frame in _frames(image):
            change = self._blocks(frame) - reference
            change -= self._drift(camera, reference, change, deviation, shot.background_K)
            if np.count_nonzero(np.abs(change) > _STANDS_OUT * deviation) > _BY_CHANCE:
                return None
        return "failed injection: the image equals the reference within its noise"

    def _blocks(self, frame: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Sums of counts over the whole blocks of a frame."""
        side = self._side
        rows, columns = (size // side for size in frame.shape)
        cut = frame[: rows * side, : columns * side].reshape(rows, side, columns, side)
        # One axis after the other: four times as fast as both at once.
        return np.asarray(cut.sum(axis=1, dtype=np.uint32).sum(axis=2), np.float64)

    def _variance(self, camera: Calibration, blocks: NDArray[np.float64]) -> NDArray[np.float64]:
        pixels = self._side**2
        signal = np.maximum(blocks / pixels - camera.offset_counts, 0.0)
        shot_noise = signal / camera.electrons_per_count
        read_noise = (camera.read_noise_electrons / camera.electrons_per_count) ** 2
        return np.asarray(pixels * (shot_noise + read_noise + 1.0 / 12.0))

    def _drift(
        self,
        camera: Calibration,
        reference: NDArray[np.float64],
        change: NDArray[np.float64],
        deviation: NDArray[np.float64],
        background_K: float,
    ) -> NDArray[np.float64]:
        half_K = 0.5 * self._plan.drift_K
        low, high = (
            float(band_radiance(end_K, filter_um=camera.filter_um))
            for end_K in (background_K - half_K, background_K + half_K)
        )
        limit = self._side**2 * camera.counts_per_radiance * (high - low)
        weight = deviation**-2
        total = float(weight.sum())
        centred = reference - float((weight * reference).sum()) / total
        mean = float((weight * change).sum()) / total
        spread = float((weight * centred**2).sum())
        slope = float((weight * centred * change).sum()) / spread if spread > 0.0 else 0.0
        return np.clip(mean + slope * centred, -limit, limit)


def _place(shot: Shot) -> tuple[int, ...]:
    return shot.background, shot.filter, shot.delay


def _frames(image: NDArray[np.uint16]) -> NDArray[np.uint16]:
    return image.reshape(-1, *image.shape[-2:])


def saturated_percent(image: NDArray[np.uint16], saturation_counts: float) -> float:
    """Pixels at or above `saturation_counts`, in % of a frame; the worst of `image` (..., h, w)."""
    full = max(np.count_nonzero(frame >= saturation_counts) for frame in _frames(image))
    return 100.0 * full / float(image.shape[-2] * image.shape[-1])


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """Distribution of the counts of a shot over the sensor's range.

    pixels: (N,) number of pixels in N equal parts of 0..saturation_counts; the last one includes
    everything above. lowest, median, highest: in counts.
    """

    pixels: NDArray[np.int64]
    lowest: int
    median: float
    highest: int
    saturation_counts: int
    saturated_percent: float


def exposure(image: NDArray[np.uint16], *, saturation_counts: int, bins: int = 64) -> Exposure:
    """Exposure of a shot, (h, w) or (n, h, w) counts, in a histogram of `bins` parts."""
    clipped = np.minimum(image, saturation_counts)
    pixels, _ = np.histogram(clipped, bins, range=(0.0, float(max(saturation_counts, 1))))
    return Exposure(
        pixels=pixels.astype(np.int64),
        lowest=int(image.min()),
        median=float(np.median(image)),
        highest=int(image.max()),
        saturation_counts=saturation_counts,
        saturated_percent=saturated_percent(image, saturation_counts),
    )
