"""Means of the shots of each background without their smooth part."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from cldit.arrays import Floats, Mask
from cldit.camera.calibration import Calibration
from cldit.dit.shots import AllSums
from cldit.dit.solve import KINDS

_HIGH = np.sqrt(64.0 / 169.0)  # of fourth differences, for the variance of white noise
_UNLUCKY = 10.0  # variance of few shots over that found from them


@dataclass(frozen=True)
class Patterns:
    """Means of each background without their smooth part, counts.

    high, mean, noise: (K, h, w) by kind; noise: variance of `high`. sees: (h, w) pixels whose
    neighbours, up to two pixels away, see the background. source: (K,) radiance over the largest.
    """

    high: Mapping[str, Floats]
    mean: Mapping[str, Floats]
    noise: Mapping[str, Floats]
    sees: Mask
    source: Floats

    @classmethod
    def of(
        cls,
        sums: AllSums,
        setpoints: Sequence[float],
        *,
        sees: Mask,
        source: Floats,
        calibration: Calibration,
        amount2: float,
    ) -> "Patterns":
        """Patterns of the `sums`; amount2: variance of the relative amount of spray of a shot."""
        high: dict[str, Floats] = {}
        mean: dict[str, Floats] = {}
        noise: dict[str, Floats] = {}
        for kind in KINDS:
            groups = [sums[k, kind] for k in setpoints]
            mean[kind] = np.array([group.mean() for group in groups])
            high[kind] = _HIGH * np.array([_without_smooth(image) for image in mean[kind]])
            variances = []
            for group, group_mean in zip(groups, mean[kind], strict=True):
                steady = group.spare(steady=True) > 1.0
                variances.append(
                    group.variance(steady=steady)
                    if group.spare() > 0.0
                    else calibration.variance_counts2(group_mean)
                )
            noise[kind] = np.array(variances)
            if kind == "injection":
                spray = high[kind] - high["reference"]
                noise[kind] = noise[kind] + _UNLUCKY * amount2 * spray**2
            noise[kind] = noise[kind] / np.array([g.exposures for g in groups])[:, None, None]
        inside = binary_erosion(sees, iterations=2)
        return cls(high, mean, noise, inside, source / source.max())

    @property
    def design(self) -> Floats:
        """(K, 2) of a line over the radiance."""
        return np.stack([self.source, np.ones_like(self.source)], axis=1)


def _without_smooth(image: Floats) -> Floats:
    """Fourth differences (h, w): a pixel minus its four neighbours, twice. Second differences would
    contain the curvature of a spray that is only some pixels wide."""
    once = image - neighbours(image)
    return once - neighbours(once)


def neighbours(image: Floats) -> Floats:
    """Mean (h, w) of the four neighbours of each pixel; at an edge, of the pixel itself too."""
    edged = np.pad(image, 1, mode="edge")
    sides = edged[:-2, 1:-1] + edged[2:, 1:-1] + edged[1:-1, :-2] + edged[1:-1, 2:]
    return np.asarray(sides / 4.0)
