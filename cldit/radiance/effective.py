"""One set of weights for all of the filter, from those of its spectral nodes."""

from __future__ import annotations

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
    """Band-effective weights: with one node, exactly that node's.

    The background's weight is the mean over the nodes for the light of a black body at
    `background_K`, the walls' for one at `wall_K`, the patches' likewise; what vapour and droplets
    emit is the sum. They give the sum over the nodes exactly before a background at `background_K`,
    and approximately before others.

    Args:
        weights: (H, W) of each node.
        nodes: of the filter.
        background_K, wall_K, patches_K: temperatures for which the means are taken.
    """
    if len(weights) == 1:
        return weights[0]

    def mean(name: str, temperature_K: float) -> np.ndarray:
        total = sum(
            float(node.share(temperature_K)) * part.images[name].astype(np.float64)
            for part, node in zip(weights, nodes, strict=True)
        )
        return np.asarray(total, np.float32)

    def both(name: str) -> np.ndarray:
        return np.asarray(
            np.sum([getattr(part, name) for part in weights], axis=0, dtype=np.float64), np.float32
        )

    return Weights(
        background=mean("background", background_K),
        wall=mean("wall", wall_K),
        vapour=both("vapour"),
        liquid=both("liquid"),
        patches={name: mean(name, (patches_K or {})[name]) for name in weights[0].patches},
    )
