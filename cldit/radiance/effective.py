"""Weights for the whole filter, from those of its spectral nodes."""

from collections.abc import Mapping, Sequence

import numpy as np

from cldit.optics.spectral import SpectralNode
from cldit.radiance.weights import Weights


def effective_weights(
    weights: Sequence[Weights],
    nodes: Sequence[SpectralNode],
    *,
    background_K: float,
    wall_K: float,
    patches_K: Mapping[str, float] | None = None,
) -> Weights:
    """Band-effective weights (H, W) of the weights of each node; of one node, its own.

    Boundary weights are means over the nodes for light of a black body at the given temperature of
    background, walls or patch; emission of vapour and droplets is summed. The radiance is exact for
    a background at `background_K` and approximate for others.
    """
    if len(weights) == 1:
        return weights[0]

    def mean(name: str, temperature_K: float) -> np.ndarray:
        total = sum(
            float(node.share(temperature_K)) * part.images[name].astype(np.float64)
            for part, node in zip(weights, nodes, strict=True)
        )
        return np.asarray(total, np.float32)

    def total(name: str) -> np.ndarray:
        return np.asarray(
            np.sum([getattr(part, name) for part in weights], axis=0, dtype=np.float64), np.float32
        )

    return Weights(
        background=mean("background", background_K),
        wall=mean("wall", wall_K),
        vapour=total("vapour"),
        liquid=total("liquid"),
        patches={name: mean(name, (patches_K or {})[name]) for name in weights[0].patches},
    )
