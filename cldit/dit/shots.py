"""Protocols of recorded shots, and sums of their images by background and kind."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.dit.chance import NEARLY_ALL
from cldit.dit.drift_axis import Place
from cldit.dit.fingerprint import Fingerprint, inner
from cldit.errors import EvaluationError
from cldit.radiance.boundary import Surroundings

_LEAST_PIXELS = 16  # with noise of one count they are equal in one of 10^6 images
THUMBNAIL = 32  # blocks along either axis, at most: 1,000 of them show a spray
_WHOLE = slice(None)  # all rows of an image


class Shot(Protocol):
    """One recorded image; `time_s` and `stable_s` are optional (`cldit.dit.drift_axis`)."""

    @property
    def id(self) -> str:
        """Name of the shot."""

    @property
    def kind(self) -> str:
        """`reference` or `injection`."""
        ...

    @property
    def background_setpoint_K(self) -> float:
        """Set point of the background; shots of one set point are averaged."""
        ...

    @property
    def background_K(self) -> float:
        """Measured temperature of the background."""
        ...


class Acquisition(Protocol):
    """Recorded data as the evaluation needs them."""

    @property
    def calibration(self) -> Mapping[str, Any]:
        """Calibration of the camera, as plain data."""

    @property
    def surroundings(self) -> Surroundings:
        """Walls, windows and patches around the spray."""

    @property
    def bad_pixels(self) -> Mask | None:
        """Mask (rows, columns) of pixels that are not used; None: all are used."""

    @property
    def shots(self) -> Sequence[Any]:
        """The recorded shots, `Shot` each."""
        ...

    def load(self, shot: Any) -> NDArray[Any]:
        """Counts (rows, columns) of one shot."""
        ...


@dataclass
class Sums:
    """Sums of the images (h, w) of one kind at one background.

    total, squares, course, glow: sums of counts, of their squares, and of counts times the place of
    the shot on the drift's axis, or times the mean of its image (levels), relative to the first.
    largest: maximum of all exposures. rounded: True if all counts are whole numbers. Lists have an
    entry per shot.
    """

    temperatures_K: list[float]
    total: Floats
    squares: Floats
    course: Floats
    glow: Floats
    largest: NDArray[np.float32]
    saturation_counts: float
    thumbnails: list[NDArray[np.float32]]
    ids: list[str]
    frames: list[Fingerprint]
    places: list[Place]
    levels: list[float]
    rounded: bool = True

    @classmethod
    def empty(cls, shape: tuple[int, ...], saturation_counts: float) -> "Sums":
        """Sums without any shot yet."""
        total, squares, course, glow = np.zeros((4, *shape))
        low = np.full(shape, -np.inf, np.float32)
        return cls([], total, squares, course, glow, low, saturation_counts, [], [], [], [], [])

    @property
    def full(self) -> Mask:
        """Pixels (h, w) that were saturated at least once."""
        return np.asarray(self.largest >= self.saturation_counts)

    def add(self, image: NDArray[Any], shot: Shot, *, place: Place) -> None:
        """Adds the image (h, w) of a shot at its `place` on the drift's axis."""
        self.places.append(place)
        self.levels.append(float(np.mean(image)))
        counts = image.astype(np.float64)
        if later := place.at - self.places[0].at:
            self.course += later * counts
        if brighter := self.levels[-1] - self.levels[0]:
            self.glow += brighter * counts
        self.total += counts
        self.squares += counts**2
        np.maximum(self.largest, image, out=self.largest, casting="unsafe")
        self.frames.append(Fingerprint.of(image))
        if image.dtype.kind == "f" and self.rounded:
            self.rounded = bool(np.all(image == np.rint(image)))
        self.temperatures_K.append(shot.background_K)
        self.thumbnails.append(thumbnail(counts))
        self.ids.append(shot.id)

    @property
    def exposures(self) -> float:
        """Effective number of exposures, (sum w)^2 / sum w^2; repeated images count once."""
        repeats = np.array(list(Counter(frame.digest for frame in self.frames).values()), float)
        return float(repeats.sum() ** 2 / np.sum(repeats**2))

    @property
    def temperature_K(self) -> float:
        """Mean of the background's temperature [K]."""
        return float(np.mean(self.temperatures_K))

    @property
    def temperature_variance_K2(self) -> float:
        """Variance of the mean reading, from the scatter of readings; 0 for one exposure."""
        if len(self.temperatures_K) < 2:
            return 0.0
        return float(np.var(self.temperatures_K, ddof=1) / len(self.temperatures_K))

    def mean(self, rows: slice = _WHOLE) -> Floats:
        """Mean (R, w) of the counts in `rows`."""
        return np.asarray(self.total[rows] / len(self.ids))

    def variance(
        self, rows: slice = _WHOLE, *, steady: bool = False, common_removed: bool = False
    ) -> Floats:
        """Sample variance (R, w) of one exposure in `rows`, counts^2; 0 for a single exposure.

        With `steady` it is that about each pixel's straight line over the places of the shots, so
        that a steady drift does not count as scatter; with `common_removed` about a line over the
        means of the images, so that it is without what all pixels share.
        """
        spare = self.spare(steady=steady, common_removed=common_removed)
        if not spare > 0.0:
            return np.zeros_like(self.total[rows])
        spread = self.squares[rows] - self.total[rows] ** 2 / len(self.ids)
        lines: list[tuple[Floats, Floats]] = []
        for values, products in self._lines(steady=steady, common_removed=common_removed):
            middle = float(np.mean(values))
            centred, along = values - middle, products[rows] - middle * self.total[rows]
            for earlier, earlier_products in lines:
                share = float(centred @ earlier / (earlier @ earlier))
                centred, along = centred - share * earlier, along - share * earlier_products
            square = float(centred @ centred)
            if square > 0.0:
                spread = spread - along**2 / square
                lines.append((centred, along))
        return np.asarray(np.maximum(spread, 0.0) / spare)

    def _lines(self, *, steady: bool, common_removed: bool) -> Iterator[tuple[Floats, Floats]]:
        """Values of the shots and sums of counts times them, of each line."""
        if steady:
            yield np.array([place.at for place in self.places]) - self.places[0].at, self.course
        if common_removed:
            yield np.array(self.levels) - self.levels[0], self.glow

    def spare(self, *, steady: bool = False, common_removed: bool = False) -> float:
        """Degrees of freedom of `variance`; 0 for a single shot."""
        return max(len(self.ids) - 1.0 - steady - common_removed, 0.0)


AllSums = Mapping[tuple[float, str], Sums]
"""Sums by set point [K] and kind."""


def thumbnail(counts: Floats) -> NDArray[np.float32]:
    """Means of `counts` (h, w) over blocks, at most `THUMBNAIL` along either axis."""
    rows, columns = (thumbnail_edges(n) for n in counts.shape)
    total = np.add.reduceat(np.add.reduceat(counts, rows, axis=0), columns, axis=1)
    high, wide = (
        np.diff(np.append(edges, n)) for edges, n in zip((rows, columns), counts.shape, strict=True)
    )
    return np.asarray(total / (high[:, None] * wide), np.float32)


def thumbnail_edges(pixels: int) -> NDArray[np.intp]:
    """First pixel of each block of a thumbnail along an axis with so many pixels."""
    return np.unique(np.linspace(0, pixels, min(pixels, THUMBNAIL), endpoint=False).astype(np.intp))


def check_shots(shots: Sequence[Shot]) -> list[float]:
    """Set points in rising order, each with references and injections."""
    for shot in shots:
        if shot.kind not in ("reference", "injection"):
            raise EvaluationError(
                f"shot {shot.id}: kind {shot.kind!r}; allowed: reference, injection"
            )
        if not (np.isfinite(shot.background_K) and shot.background_K >= 0):
            raise EvaluationError(
                f"shot {shot.id}: background at {shot.background_K:g} K was not measured"
            )
    setpoints = sorted({shot.background_setpoint_K for shot in shots})
    for setpoint in setpoints:
        kinds = [shot.kind for shot in shots if shot.background_setpoint_K == setpoint]
        for kind in ("reference", "injection"):
            if kind not in kinds:
                raise EvaluationError(
                    f"background {setpoint:g} K: no {kind} among its {len(kinds)} shots; resume "
                    "the acquisition, or remove this background"
                )
    if len(setpoints) < 2:
        raise EvaluationError(
            f"backgrounds: {setpoints} K; the evaluation needs at least two different temperatures"
        )
    return setpoints


def accumulate(
    acquisition: Acquisition,
    saturation_counts: float,
    progress: Callable[[int, int], None] | None,
    *,
    places: Sequence[Place],
) -> tuple[dict[tuple[float, str], Sums], list[str]]:
    """Reads every shot once; returns sums by set point [K] and kind, and images that were ignored.

    Pixels saturate at `saturation_counts`; `progress` is called with (shots read, shots in all);
    `places` are those of the shots on the drift's axis. An image with one value in all pixels is
    no image (a frame that was never written), unless it is the level of saturation.
    """
    sums: dict[tuple[float, str], Sums] = {}
    flat: list[tuple[float, Any, Place]] = []
    uneven: set[str] = set()
    bad = acquisition.bad_pixels
    shape = None if bad is None else bad.shape
    for done, (shot, place) in enumerate(zip(acquisition.shots, places, strict=True), start=1):
        image = acquisition.load(shot)
        if image.ndim != 2 or image.size == 0 or (shape is not None and image.shape != shape):
            raise EvaluationError(f"shot {shot.id}: image of shape {image.shape}; allowed: {shape}")
        shape = image.shape
        if image.dtype.kind not in "uif":
            raise EvaluationError(f"shot {shot.id}: {image.dtype} are no counts")
        if image.dtype.kind == "f" and not np.all(np.isfinite(image)):
            broken = int(np.count_nonzero(~np.isfinite(image)))
            raise EvaluationError(
                f"shot {shot.id}: {broken} pixels are not finite; remove the shot, or list the "
                "pixels as bad"
            )
        if image.size >= _LEAST_PIXELS and np.ptp(inner(image)) == 0:
            flat.append((float(inner(image)[0, 0]), shot, place))
        else:
            key = (shot.background_setpoint_K, shot.kind)
            if key not in sums:
                sums[key] = Sums.empty(shape, saturation_counts)
            if shot.kind not in uneven and np.median(np.abs(np.diff(image.astype(float)))) > 0.0:
                uneven.add(shot.kind)
            sums[key].add(image, shot, place=place)
        if progress is not None:
            progress(done, len(acquisition.shots))
    filled = [(np.broadcast_to(value, shape or (0, 0)), shot, place) for value, shot, place in flat]
    return sums, _with_flat(sums, filled, uneven, saturation_counts=saturation_counts)


def exclude(
    acquisition: Acquisition,
    sums: dict[tuple[float, str], Sums],
    reasons: Mapping[str, str],
    *,
    needed: bool = False,
) -> list[str]:
    """Reads the groups again without the shots of these ids, and returns a remark on each.

    Those that are half of their group or more stay; if it is `needed`, that is an EvaluationError.
    """
    lines: dict[str, str] = {}
    for key, group in sums.items():
        names = [name for name in group.ids if name in reasons]
        if 2 * len(names) >= len(group.ids):
            if needed:
                raise EvaluationError(
                    f"{key[1]}s at {key[0]:g} K: {len(names)} of {len(group.ids)} images are "
                    f"damaged ({reasons[names[0]]}); record them again, or remove the background"
                )
            lines |= {name: f"{reasons[name]}; counted, as half of its group is" for name in names}
        elif names:
            lines |= {name: f"{reasons[name]}; ignored" for name in names}
            sums[key] = Sums.empty(group.total.shape, group.saturation_counts)
            places = dict(zip(group.ids, group.places, strict=True))
            for shot in acquisition.shots:
                same = (shot.background_setpoint_K, shot.kind) == key and shot.id in places
                if same and shot.id not in names:
                    sums[key].add(acquisition.load(shot), shot, place=places[shot.id])
    return [lines[name] for name in reasons if name in lines]


def _with_flat(
    sums: dict[tuple[float, str], Sums],
    flat: Sequence[tuple[Floats, Any, Place]],
    uneven: Collection[str],
    *,
    saturation_counts: float,
) -> list[str]:
    """Adds images of one value to the `sums` if they are saturated, or if their kind is not
    `uneven` from pixel to pixel (a simulation without noise). Returns remarks on the others."""
    tops = [group.largest.max() for group in sums.values()] + [image[0, 0] for image, _, _ in flat]
    top = min(float(max(tops, default=0.0)), saturation_counts)
    sound = {key: bool(np.mean(group.largest >= top) > 0.5) for key, group in sums.items()}
    ignored: list[str] = []
    for image, shot, place in flat:
        key, value = (shot.background_setpoint_K, shot.kind), float(image[0, 0])
        if shot.kind in uneven and not (value >= top and sound.get(key, True)):
            if key not in sound:
                raise EvaluationError(
                    f"{shot.kind}s at {key[0]:g} K: every pixel of every image is {value:g}; "
                    "these are no images; record them again, or remove the background"
                )
            ignored.append(f"shot {shot.id}: every pixel is {value:g}; ignored")
            continue
        if key not in sums:
            sums[key] = Sums.empty(image.shape, saturation_counts)
        sums[key].add(image, shot, place=place)
    return ignored


def ignore_saturated(sums: dict[tuple[float, str], Sums], bad: Mask | None) -> list[str]:
    """Removes backgrounds at which nearly all pixels are saturated, and returns their remarks."""
    lines: list[str] = []
    for setpoint in sorted({setpoint for setpoint, _ in sums}):
        for kind in ("reference", "injection"):
            full = sums[setpoint, kind].full
            share = float(np.mean(full if bad is None else full[~bad]))
            if share > NEARLY_ALL:
                lines.append(
                    f"background {setpoint:g} K: {100 * share:.0f} % of the pixels of its {kind}s "
                    "are saturated; it is ignored"
                )
                for of in ("reference", "injection"):
                    del sums[setpoint, of]
                break
    if len({setpoint for setpoint, _ in sums}) < 2:
        raise EvaluationError(
            "\n".join(lines) + "\nthe evaluation needs two backgrounds: shorten the exposure"
        )
    return lines
