"""How much of what the camera sees comes from where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.radiance.weights import Weights, compose
from cldit.report.pictures import Frame, Panel, panels_picture


@dataclass(frozen=True)
class Shares:
    """Shares (H, W) of the radiance of each pixel, 0 to 1; NaN where nothing arrives.

    where: True where the spray adds or takes something: those pixels make the means.
    """

    background: NDArray[np.float64]
    wall: NDArray[np.float64]
    vapour: NDArray[np.float64]
    liquid: NDArray[np.float64]
    where: NDArray[np.bool_]

    @classmethod
    def of(cls, weights: Weights, reference: Weights, *, background: float, wall: float) -> Shares:
        """Before a background and walls of these radiances, photons s-1 m-2 sr-1.

        The spray is where it changes the weights of the empty scene, `reference`, by over 1 %.
        """
        total = compose(weights, background=background, wall=wall)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen, walls, vapour, liquid = (
                np.where(total > 0, part / total, np.nan)
                for part in (
                    weights.background * np.float64(background),
                    weights.wall * np.float64(wall),
                    weights.vapour.astype(np.float64),
                    weights.liquid.astype(np.float64),
                )
            )
        before = reference.background.astype(np.float64) + reference.wall
        thick = np.abs(before - weights.background - weights.wall) > 0.01
        moved = np.abs(reference.background.astype(np.float64) - weights.background) > 0.01
        return cls(seen, walls, vapour, liquid, where=thick | moved)

    def means(self) -> dict[str, float]:
        """Mean share over the pixels where the spray is; empty where it is nowhere."""
        if not self.where.any():
            return {}
        named = {
            "background": self.background,
            "walls": self.wall,
            "vapour": self.vapour,
            "droplets": self.liquid,
        }
        return {name: float(np.nanmean(part[self.where])) for name, part in named.items()}

    def picture(self, frame: Frame, *, title: str) -> bytes:
        """PNG of the shares of vapour and droplets."""
        return panels_picture(
            [
                Panel(self.vapour, "share of vapour in the signal", "share", (0.0, 1.0)),
                Panel(self.liquid, "share of droplets in the signal", "share", (0.0, 1.0)),
            ],
            frame,
            title=title,
        )
