"""Weights of a trace per pixel, and the radiance for any boundary temperatures.

Transfer is linear in its sources, so with one trace

    L = background * L_bg + wall * B(T_wall) + vapour + liquid + sum of patches[name] * L_name

for every background, wall and patch temperature. L_bg leaves the background disc,
emissivity * B(T_bg) + (1 - emissivity) * B(T_wall), and L_name a patch, likewise.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import repeat
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cldit.arrays import Floats, Image
from cldit.io.files import make_folder
from cldit.io.images import read_image, write_image

EMITTED = ("vapour", "liquid")
_WHOLE = ("background", "wall", *EMITTED)
_NONE: Mapping[str, Image] = MappingProxyType({})


@dataclass(frozen=True)
class Weights:
    """Weights of every pixel, (H, W) float32 each, row 0 at the top.

    background, wall: share of the background's and the wall's radiance that reaches the pixel.
    vapour, liquid: radiance that either phase emits and that reaches the pixel,
    photons s-1 m-2 sr-1 in the filter.
    patches: share of the radiance of each named patch of the enclosure.
    """

    background: Image
    wall: Image
    vapour: Image
    liquid: Image
    patches: Mapping[str, Image] = field(default_factory=lambda: _NONE, kw_only=True)

    def __repr__(self) -> str:
        rows, columns = self.background.shape
        return f"<Weights: {columns} x {rows} pixels of {', '.join(self.images)}>"

    @property
    def images(self) -> dict[str, Image]:
        """All weights by name, patches last."""
        return {**{name: getattr(self, name) for name in _WHOLE}, **self.patches}

    @classmethod
    def of(cls, images: Mapping[str, Image]) -> "Weights":
        """The inverse of `images`."""
        patches = {name: image for name, image in images.items() if name not in _WHOLE}
        return cls(*(images[name] for name in _WHOLE), patches=patches)

    def map(self, change: Callable[[Image], Any]) -> "Weights":
        """Weights with `change` applied to each image."""
        return Weights.of({name: change(image) for name, image in self.images.items()})

    def save(self, folder: Path, *, pixel_m: tuple[float, float]) -> None:
        """Writes one float32 TIFF per weight into `folder`, for pixels of `pixel_m`."""
        make_folder(folder)
        for name, image in self.images.items():
            write_image(
                folder / f"{name}.tif",
                image,
                name=f"weight of {name}",
                unit="photons s-1 m-2 sr-1" if name in EMITTED else "1",
                pixel_m=pixel_m,
            )

    @classmethod
    def load(cls, folder: Path, *, patches: Sequence[str] = ()) -> "Weights":
        """Reads the files of `save` from `folder`; `patches` are the names in the scene.

        Raises:
            RunFolderError: a file is missing or damaged.
        """
        return cls.of({name: read_image(folder / f"{name}.tif")[0] for name in (*_WHOLE, *patches)})


def mean(members: Iterable[Weights], shares: Sequence[float] | None = None) -> Weights:
    """Mean of weights (H, W), taken one by one, of several times, injections or viewpoints.

    Transfer is linear, so these are the weights of the mean light. `shares` are in proportion to
    the part of each; None: equal.
    """
    sums: dict[str, Floats] = {}
    total = 0.0
    for share, weights in zip(repeat(1.0) if shares is None else shares, members, strict=False):
        total += share
        for name, image in weights.images.items():
            sums[name] = sums.get(name, 0.0) + share * image.astype(np.float64)
    if not sums:
        raise ValueError("weights: none; allowed: one or more")
    return Weights.of({name: (summed / total).astype(np.float32) for name, summed in sums.items()})


def background_radiance(*, blackbody: float, wall: float, emissivity: float) -> float:
    """Radiance of a grey disc that emits as `blackbody` and reflects `wall`."""
    return emissivity * blackbody + (1.0 - emissivity) * wall


def compose(
    weights: Weights,
    *,
    background: float | None,
    wall: float,
    patches: Mapping[str, float] | None = None,
) -> Floats:
    """Radiance that leaves the chamber towards the camera, photons s-1 m-2 sr-1.

    Args:
        weights: (H, W).
        background, wall, patches: radiances; a background of None does not count.

    Returns:
        (H, W).

    Raises:
        KeyError: a patch of the weights has no radiance.
    """
    total = weights.wall * np.float64(wall) + weights.vapour + weights.liquid
    if background is not None:
        total += weights.background * np.float64(background)
    for name, image in weights.patches.items():
        total = total + image * np.float64((patches or {})[name])
    return np.asarray(total)
