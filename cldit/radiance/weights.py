"""Per-pixel weights of one trace, and the radiance that they give for any boundary temperature.

Transfer is linear in its sources, so with one trace

    L = background * L_bg + wall * B(T_wall) + vapour + liquid

for every background and wall temperature. L_bg is what leaves the background disc,
emissivity * B(T_bg) + (1 - emissivity) * B(T_wall).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.images import read_image, write_image

Image = NDArray[np.float32]

_UNITS = {
    "background": "1",
    "wall": "1",
    "vapour": "photons s-1 m-2 sr-1",
    "liquid": "photons s-1 m-2 sr-1",
}


@dataclass(frozen=True)
class Weights:
    """(H, W) float32 each, row 0 at the top.

    background, wall: share of the background's and the wall's radiance that reaches the pixel.
    vapour, liquid: photon radiance emitted by either phase that reaches the pixel,
    photons s-1 m-2 sr-1 in the filter's band.
    """

    background: Image
    wall: Image
    vapour: Image
    liquid: Image

    def save(self, folder: Path, *, pixel_m: tuple[float, float]) -> None:
        """Writes one float32 TIFF a weight."""
        folder.mkdir(parents=True, exist_ok=True)
        for item in fields(self):
            write_image(
                folder / f"{item.name}.tif",
                getattr(self, item.name),
                name=f"weight of {item.name}",
                unit=_UNITS[item.name],
                pixel_m=pixel_m,
            )

    @classmethod
    def load(cls, folder: Path) -> Weights:
        """Reads what `save` wrote.

        Raises:
            RunFolderError: a file is missing or damaged.
        """
        images = {item.name: read_image(folder / f"{item.name}.tif")[0] for item in fields(cls)}
        return cls(**images)


def background_radiance(*, blackbody: float, wall: float, emissivity: float) -> float:
    """Radiance that leaves a grey disc: its own, and the wall's that it reflects."""
    return emissivity * blackbody + (1.0 - emissivity) * wall


def compose(weights: Weights, *, background: float, wall: float) -> NDArray[np.float64]:
    """Radiance (H, W) before a background and walls of these radiances, photons s-1 m-2 sr-1."""
    return np.asarray(
        weights.background * np.float64(background)
        + weights.wall * np.float64(wall)
        + weights.vapour
        + weights.liquid
    )
