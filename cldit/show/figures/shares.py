"""How much of what the camera sees comes from where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cldit.radiance.weights import Weights, compose
from cldit.show.figures.panels import Frame, Panel, panels_picture


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
    patches: Mapping[str, NDArray[np.float64]] = field(default_factory=dict, kw_only=True)

    @classmethod
    def of(
        cls,
        weights: Weights,
        reference: Weights,
        *,
        background: float,
        wall: float,
        patches: Mapping[str, float] | None = None,
    ) -> Shares:
        """Shares of the signal before a background, walls and patches of given radiances.

        The spray is where it changes the weights of the empty scene, `reference`, by over 1 %.

        Args:
            weights, reference: (H, W) with and without spray.
            background, wall, patches: radiances [photons s-1 m-2 sr-1].
        """
        radiances = {"background": background, "wall": wall, **(patches or {})}
        total = compose(weights, background=background, wall=wall, patches=patches)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = {
                name: np.where(
                    total > 0, image * np.float64(radiances.get(name, 1.0)) / total, np.nan
                )
                for name, image in weights.images.items()
            }
        outside = ("background", "wall", *weights.patches)
        before, now = (
            sum(part.images[name].astype(np.float64) for name in outside)
            for part in (reference, weights)
        )
        moved = np.abs(reference.background.astype(np.float64) - weights.background) > 0.01
        return cls(
            share["background"],
            share["wall"],
            share["vapour"],
            share["liquid"],
            where=(np.abs(before - now) > 0.01) | moved,
            patches={name: share[name] for name in weights.patches},
        )

    def means(self) -> dict[str, float]:
        """Mean share over the pixels where the spray is; empty where it is nowhere."""
        if not self.where.any():
            return {}
        named = {
            "background": self.background,
            "walls": self.wall,
            **self.patches,
            "vapour": self.vapour,
            "droplets": self.liquid,
        }
        return {name: float(np.nanmean(part[self.where])) for name, part in named.items()}

    def picture(self, frame: Frame, *, title: str) -> bytes:
        """PNG of the shares of vapour and droplets, with axes of `frame`, below `title`."""
        return panels_picture(
            [
                Panel(self.vapour, "share of vapour in the signal", "share", (0.0, 1.0)),
                Panel(self.liquid, "share of droplets in the signal", "share", (0.0, 1.0)),
            ],
            frame,
            title=title,
        )
