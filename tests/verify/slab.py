"""Plane-parallel slabs by PythonicDISORT: what `source` and `path` are held to."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray


def disort(
    depth: float, albedo: float, moments: NDArray[np.float64], *, streams: int = 32
) -> tuple[float, float]:
    """Radiance along the normal out of the slab per unit radiance onto its back and its front.

    The radiance u at the quadrature nodes comes from PythonicDISORT; the normal is none of them, so
    the formal solution gives it: the source towards the normal (mu = 1, where every Legendre
    polynomial is 1) is albedo / 2 sum over l of (2 l + 1) moment_l integral P_l u dmu.

    moments: Legendre moments of the phase function, the first being 1; those beyond `streams` must
    be negligible.
    """
    solver = pytest.importorskip("PythonicDISORT.pydisort")
    given = np.zeros((1, streams + 1))
    count = min(len(moments), streams + 1)
    given[0, :count] = moments[:count]
    given[0, 0] = 1.0  # not a rounding less, which the solver warns of
    x, w = np.polynomial.legendre.leggauss(64)
    at, weight = (x + 1) * depth / 2, w * depth / 2
    node_weight = np.tile(np.polynomial.legendre.leggauss(streams // 2)[1] / 2, 2)
    degrees = np.arange(streams)
    answers = []
    for behind, front in ((1.0, 0.0), (0.0, 1.0)):
        mu, *_, u0, _ = solver.pydisort(
            np.array([depth]),
            np.array([albedo]),
            streams,
            given,
            0.5,
            0.0,
            0.0,
            b_pos=behind,
            b_neg=front,
        )
        polynomials = np.polynomial.legendre.legvander(mu, streams - 1)
        towards = polynomials @ ((2 * degrees + 1) * given[0, :streams]) / 2
        source = np.array([albedo * float(np.sum(node_weight * towards * u0(t))) for t in at])
        answers.append(behind * np.exp(-depth) + float(np.sum(source * np.exp(-at) * weight)))
    return answers[0], answers[1]
