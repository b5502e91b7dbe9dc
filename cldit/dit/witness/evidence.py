"""Input of the witnesses: means of blocks of pixels by shot, as radiance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.calibration import Calibration
from cldit.dit.drift_axis import Places
from cldit.dit.shots import AllSums, thumbnail, thumbnail_edges
from cldit.dit.solve import KINDS
from cldit.radiance.boundary import Boundary


@dataclass(frozen=True, kw_only=True)
class Amount:
    """Scatter between injections in units of a pattern.

    block_variance: of each block, independent. variance: of the amount that all blocks share;
    shot_variance: (K,) of it as observed among the shots of each background. explained: sum of
    squares that it explains, radiance^2.
    """

    block_variance: float
    variance: float
    shot_variance: Floats
    explained: float


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Blocks that see the background and never saturate, at K backgrounds.

    temperatures_K, source: of the black body, and of its radiance in the chamber, (K,) by kind.
    rise: (K,) radiance per kelvin. shots: by kind and background, (n, B) radiance of each shot.
    camera: (K, B) by kind, variance of a block in one shot due to the camera's noise.
    places: by kind and background, of the n shots on the drift's axis. own_radiance: of a black
    body, as a function of temperature. warmest: upper bound of the radiance of a spray without
    flame. shape: of the image. chosen: which of its thumbnail's blocks these are.
    """

    setpoints: tuple[float, ...]
    temperatures_K: Mapping[str, Floats]
    source: Mapping[str, Floats]
    rise: Floats
    shots: Mapping[str, tuple[Floats, ...]]
    camera: Mapping[str, Floats]
    places: Mapping[str, tuple[Places, ...]]
    own_radiance: Callable[[Floats], Floats]
    warmest: float
    shape: tuple[int, int]
    chosen: Mask

    @classmethod
    def of(
        cls,
        sums: AllSums,
        setpoints: Sequence[float],
        *,
        sees: Mask,
        boundary: Boundary,
        calibration: Calibration,
        warmest_K: float,
    ) -> "Evidence":
        """Evidence from sums by set point and kind, in pixels (h, w) that see the background.

        `warmest_K` is the temperature of the hottest of backgrounds, walls and windows.
        """
        image = cls.of_blocks(sees)
        chosen = image.ravel()
        rows, columns = image.shape
        pixels = max(sees.size / (rows * columns), 1.0)
        scale = calibration.counts_per_radiance * boundary.front.transmission
        shots: dict[str, tuple[Floats, ...]] = {}
        camera: dict[str, Floats] = {}
        places: dict[str, tuple[Places, ...]] = {}
        temperatures = {
            kind: np.array([sums[k, kind].temperature_K for k in setpoints]) for kind in KINDS
        }
        for kind in KINDS:
            parts: list[Floats] = []
            for setpoint in setpoints:
                group = sums[setpoint, kind]
                seen = np.array([small.ravel()[chosen] for small in group.thumbnails], float)
                parts.append((seen - calibration.offset_counts) / scale)
            shots[kind] = tuple(parts)
            places[kind] = tuple(Places.of(sums[k, kind].places) for k in setpoints)
            counts = np.array([part.mean(axis=0) for part in parts]) * scale
            noise = calibration.variance_counts2(counts + calibration.offset_counts)
            camera[kind] = noise / scale**2 / pixels
        return cls(
            setpoints=tuple(setpoints),
            temperatures_K=temperatures,
            source={kind: boundary.leaving(temperatures[kind]) for kind in KINDS},
            rise=per_kelvin(boundary.leaving, temperatures["reference"]),
            shots=shots,
            camera=camera,
            places=places,
            own_radiance=boundary.radiance,
            warmest=float(boundary.radiance(warmest_K)),
            shape=(sees.shape[0], sees.shape[1]),
            chosen=image,
        )

    @staticmethod
    def of_blocks(sees: Mask) -> Mask:
        """Blocks of a thumbnail whose pixels all see the background, else most of them."""
        share = thumbnail(sees.astype(float))
        return share >= 1.0 if np.any(share >= 1.0) else share > 0.5

    def pixels(self, blocks: Mask) -> Mask:
        """Pixels (h, w) of these `blocks` (B,)."""
        image = np.zeros(self.chosen.shape, bool)
        image[self.chosen] = blocks
        rows, columns = (
            np.searchsorted(thumbnail_edges(n), np.arange(n), side="right") - 1 for n in self.shape
        )
        return np.asarray(image[rows[:, None], columns])

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.shots["reference"][0].shape[1])

    def halves(self) -> "tuple[Evidence, Evidence] | None":
        """Every other shot of both kinds, and the rest; None where a background has only one."""
        if min(len(part) for kind in KINDS for part in self.shots[kind]) < 2:
            return None

        def half(start: int) -> Evidence:
            return replace(
                self,
                shots={k: tuple(part[start::2] for part in self.shots[k]) for k in KINDS},
                places={k: tuple(part[start::2] for part in self.places[k]) for k in KINDS},
            )

        return half(0), half(1)

    @property
    def breaks(self) -> int:
        """Number of breaks between the first image and the last."""
        parts = [part.part for kind in KINDS for part in self.places[kind]]
        return len(np.unique(np.concatenate(parts))) - 1

    def through(self) -> "Evidence":
        """The evidence with breaks in full length."""
        return replace(
            self, places={k: tuple(part.through() for part in self.places[k]) for k in KINDS}
        )

    def number(self, kind: str) -> Floats:
        """Number (K,) of shots of a kind."""
        return np.array([float(len(part)) for part in self.shots[kind]])

    def degrees(self, kind: str) -> int:
        """Degrees of freedom of `jitter`, over all backgrounds."""
        return round(float(self._spare(kind).sum()))

    def _spare(self, kind: str) -> Floats:
        return np.array([float(_spare(places)) for places in self.places[kind]])

    def mean(self, kind: str) -> Floats:
        """Means (K, B) over the shots of a kind."""
        return np.array([part.mean(axis=0) for part in self.shots[kind]])

    @property
    def change(self) -> Floats:
        """Means (K, B) of the injections minus those of the references."""
        return self.mean("injection") - self.mean("reference")

    def gains(self, kind: str) -> Floats:
        """Slope (B,) of each block's signals over the radiance of the background."""
        centred = self.source[kind] - self.source[kind].mean()
        return np.asarray(centred @ self.mean(kind) / np.sum(centred**2))

    def series(self, kind: str, chosen: Mask) -> list[Floats]:
        """Means (n,) of each shot of a kind over the `chosen` blocks (B,), by background."""
        return [part[:, chosen].mean(axis=1) for part in self.shots[kind]]

    def jitter(self, kind: str, chosen: Mask) -> Floats:
        """Variance (K,) of one shot's mean over the `chosen` blocks (B,), without slow changes.

        It is that about a straight line over the places of the shots, which restarts after a break,
        since a steady drift is no noise of the mean. For two shots it is half the square of their
        difference.
        """
        return np.array(
            [
                _about_line(places, values)
                for places, values in zip(self.places[kind], self.series(kind, chosen), strict=True)
            ]
        )

    def variance(self, kind: str, chosen: Mask) -> Floats:
        """Variance (K,) of the mean of a kind's shots over the `chosen` blocks (B,).

        It is the largest of the camera's noise, the jitter at this background and that at all of
        them, since a few shots may agree by chance.
        """
        n = self.number(kind)
        noise = self.camera[kind][:, chosen].mean(axis=1) / chosen.sum()
        jitter = self.jitter(kind, chosen)
        spare = self._spare(kind)
        pooled = np.sum(jitter * spare) / max(np.sum(spare), 1.0)
        return np.asarray(np.maximum(np.maximum(noise, jitter), pooled) / n)

    def scatter(self) -> tuple[Floats, float]:
        """Scatter of injections beyond the camera's noise, relative to Delta I.

        It is the independent variance (K, B) of each block's mean, and the variance of the relative
        change of Delta I that all blocks of a shot share.
        """
        change = self.change
        amount = self.amount(change)
        blocks = self.camera["injection"] + amount.block_variance * change**2
        return np.asarray(blocks / self.number("injection")[:, None]), amount.variance

    def amount(self, pattern: Floats, *, drifting: bool = False) -> Amount:
        """Scatter of injections in units of `pattern` (K, B), their derivative by an amount.

        If they are `drifting`, the variance of the amount is that about a line, as in `jitter`.
        """
        camera = self.camera["injection"]
        block_variance, variance, explained, weight = 0.0, 0.0, 0.0, 0.0
        observed = np.zeros(len(camera))
        for k, part in enumerate(self.shots["injection"]):
            spare = len(part) - 1
            square = float(pattern[k] @ pattern[k])
            if not (spare and square > 0.0):
                continue
            deviations = part - part.mean(axis=0)
            amount = deviations @ pattern[k] / square
            noise = float(camera[k] @ pattern[k] ** 2) / square**2
            rest = deviations - amount[:, None] * pattern[k]
            fourth = float(np.sum(pattern[k] ** 4))
            excess = np.sum(rest**2, axis=0) / spare - camera[k]
            block_variance += spare * float(excess @ pattern[k] ** 2) / fourth
            square_sum = float(np.sum(amount**2))
            places = self.places["injection"][k]
            observed[k] = _about_line(places, amount) if drifting else square_sum / spare
            variance += spare * (observed[k] - noise)
            explained += square * square_sum
            weight += spare
        if not weight:
            return Amount(block_variance=0.0, variance=0.0, shot_variance=observed, explained=0.0)
        return Amount(
            block_variance=max(block_variance / weight, 0.0),
            variance=max(variance / weight, 0.0),
            shot_variance=observed,
            explained=explained,
        )


def per_kelvin(radiance: Callable[[Floats], Floats], at_K: Floats) -> Floats:
    """Change (K,) of a radiance by a kelvin of the temperatures (K,)."""
    return np.asarray((radiance(at_K + 0.01) - radiance(at_K - 0.01)) / 0.02)


def _spare(places: Places) -> int:
    """Degrees of freedom about a line; for two points, about their mean."""
    about_means = len(places.at) - places.parts
    return max(about_means - 1, min(about_means, 1))


def _about_line(places: Places, values: Floats) -> float:
    """Variance of `values` (n,) about a straight line over `places`; 0 for one value."""
    spare = _spare(places)
    if not spare:
        return 0.0
    off = places.about_part_means(values)
    if len(values) - places.parts > 1:
        centred = places.about_part_means(places.at)
        off = off - centred * float(centred @ off) / float(centred @ centred)
    return float(off @ off) / spare
