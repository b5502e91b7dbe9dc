"""Home of the slab: plane-parallel, traced, and solved by PythonicDISORT."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, TypeVar
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.transport.mie_phase import SizeBins
from cldit.transport.phase import ScatteringTable

EDGE = 0.2
CAMERA = {"model": "orthographic", "pixels": [9, 9], "field_m": [0.01, 0.01]}
BEHIND = {"radius_m": 99.0, "temperatures_K": [400.0, 500.0]}
Made = TypeVar("Made")
_PANELS = (0.0, 0.1, 0.5, 2.0, 6.0, 15.0, 40.0)  # optical depths; e^-40 is nothing


def run_slab(
    run_block: Callable[..., Made],
    depth: float,
    albedo: float,
    *,
    layers: int,
    cells: int = 128,
    **scene: Any,
) -> Made:
    """Slab of droplets at 400 K, `layers` of `cells` across a cube, by `Blocks.run` or `scene`.

    The background fills the half space behind it, unless `scene` has another.
    """
    thickness = layers * EDGE / cells
    domain = {"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / cells, **scene.pop("domain", {})}
    return run_block(
        {
            "droplet_absorption_per_m": (1 - albedo) * depth / thickness,
            "droplet_scattering_per_m": albedo * depth / thickness,
            "droplet_temperature_K": 400.0,
        },
        size_m=(EDGE, thickness, EDGE),
        domain=domain,
        **{"camera": CAMERA, "background": BEHIND, **scene},
    )


def _lit(
    depth: float, albedo: float, moments: NDArray[np.float64]
) -> Iterator[tuple[float, NDArray[np.float64], Callable[[float], NDArray[np.float64]]]]:
    """Slab lit from behind, and from the front: radiance from behind, cosines of the streams, and
    the radiance along them at an optical depth. moments: (1, streams + 1)."""
    solver = pytest.importorskip("PythonicDISORT.pydisort")

    for behind in (1.0, 0.0):
        mu, *_, u0, _ = solver.pydisort(
            np.array([depth]), np.array([albedo]), moments.shape[1] - 1, moments, 0.5, 0.0, 0.0,
            b_pos=behind, b_neg=1.0 - behind,
        )  # fmt: skip
        yield behind, mu, u0


def disort(
    depth: float,
    albedo: float,
    moments: NDArray[np.float64],
    *,
    streams: int = 32,
    swept: int | None = None,
) -> tuple[float, float]:
    """Radiance along the normal out of the slab per unit radiance onto its back and its front.

    The radiance u at the quadrature nodes comes from PythonicDISORT; the normal is none of them, so
    the formal solution gives it: the source towards the normal (mu = 1, where every Legendre
    polynomial is 1) is albedo / 2 sum over l of (2 l + 1) moment_l integral P_l u dmu.

    A slab is cut at 25 lengths of 1 / sqrt(3 (1 - albedo) (1 - albedo g)) optical depths, on which
    diffusing light falls to 1 / e where albedo is near 1. No slab of the stability page that is cut
    transmits more than 6e-7 there; the most is at albedo 0, where that is e^-14.4.

    moments: Legendre moments of the phase function, the first being 1; those beyond `streams` must
    be negligible. swept: moments that the light within keeps, by delta-M (Wiscombe 1977), so that
    `moments` are those of the last scattering alone, as `source` has it with 3; None: all.
    """
    given = np.zeros((1, streams + 1))
    count = min(len(moments), streams + 1)
    given[0, :count] = moments[:count]
    given[0, 0] = 1.0  # not a rounding less, which the solver warns of
    loss = np.sqrt(3 * (1 - albedo) * (1 - albedo * given[0, 1]))
    depth = min(depth, 25.0 / loss) if loss > 0 else depth
    kept = given
    ahead = 0.0  # share of what is scattered that counts as not scattered
    if swept is not None:
        ahead = float(given[0, swept])
        kept = np.where(np.arange(streams + 1) < swept, (given - ahead) / (1.0 - ahead), 0.0)
    thinner = 1.0 - albedo * ahead
    x, w = np.polynomial.legendre.leggauss(12)
    node_weight = np.tile(np.polynomial.legendre.leggauss(streams // 2)[1] / 2, 2)
    degrees = np.arange(streams)
    edges = [*(edge for edge in _PANELS if edge < depth), min(depth, _PANELS[-1])]
    answers = []
    for behind, mu, u0 in _lit(depth * thinner, albedo * (1.0 - ahead) / thinner, kept):
        polynomials = np.polynomial.legendre.legvander(mu, streams - 1)
        towards = polynomials @ ((2 * degrees + 1) * given[0, :streams]) / 2
        total = behind * float(np.exp(-depth))
        for low, high in pairwise(edges):
            at, weight = low + (x + 1) * (high - low) / 2, w * (high - low) / 2
            lit = [float(np.sum(node_weight * towards * u0(t * thinner))) for t in at]
            total += albedo * float(np.sum(np.array(lit) * np.exp(-at) * weight))
        answers.append(total)
    return answers[0], answers[1]


def half_space_emission(albedo: float) -> float:
    """Emission along the normal of a half space that scatters evenly, sqrt(1 - a) H(1), H by
    iteration (Chandrasekhar, Radiative Transfer, 1960, ch. 5); its reflection is the rest."""
    x, w = np.polynomial.legendre.leggauss(64)
    mu, w, root = (x + 1) / 2, w / 2, np.sqrt(1 - albedo)
    h = np.ones(64)
    for _ in range(5000):
        inner = ((w * mu * h) / (mu[:, None] + mu)).sum(axis=1)
        h = (h + 1 / (root + albedo / 2 * inner)) / 2
    return float(root / (root + albedo / 2 * np.sum(w * mu * h / (1 + mu))))


def mean_radiance(
    depth: float, albedo: float, at: NDArray[np.float64], *, streams: int = 32
) -> NDArray[np.float64]:
    """(2, *at.shape): mean radiance at optical depths from the front of a slab that scatters
    evenly, per unit radiance onto its back and its front, by PythonicDISORT."""
    even = np.zeros((1, streams + 1))
    even[0, 0] = 1.0
    weight = np.tile(np.polynomial.legendre.leggauss(streams // 2)[1] / 4, 2)
    means = [[weight @ u0(t) for t in at.reshape(-1)] for _, _, u0 in _lit(depth, albedo, even)]
    return np.array(means).reshape(2, *at.shape)


@contextmanager
def droplets_of_9_um() -> Iterator[ScatteringTable]:
    """Within, `transport.phase: mie` of a grid, which has coefficients and no diameters, means the
    phase function of droplets of 9 um of n-heptane at 3.4 um, as `gdi` has it: g = 0.85. Its
    moments end near 2 x = 17."""
    one = np.array([9e-6]), np.ones(1)
    phase = SizeBins.of(*one, wavelength_um=3.4, n=1.338, k=0.0341).mean()
    with mock.patch("cldit.prepare.medium.mean_phase", lambda *_, **__: phase):
        yield phase
