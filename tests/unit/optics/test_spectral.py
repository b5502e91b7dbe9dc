"""Spectral nodes: their black-body radiances add up to the filter's, whatever the division.

The best cuts are compared with trying all; the sums with the filter's own radiance.
"""

from __future__ import annotations

import json
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest

from cldit.errors import SceneError
from cldit.optics.node_count import enough, stays_K
from cldit.optics.planck import band_radiance
from cldit.optics.response import Filter, Response
from cldit.optics.spectral import Quadrature
from cldit.optics.spectrum import _regrouped
from cldit.optics.vapour import KDistribution
from cldit.optics.wavelengths import _cuts, elsewhere
from cldit.optics.windows import band_pane
from cldit.scene import load_scene
from cldit.scene.vessel import Window
from cldit.spray.result import Parcels, Spray

KELVIN = np.array([1.0, 20.0, 77.0, 300.0, 450.0, 1234.5, 5000.0, 1e5])
TRAPEZE = Response(((3.25, 0.0), (3.3, 0.9), (3.45, 0.9), (3.52, 0.0)))


def quadrature(filter_um: Filter, seed: int, *, intervals: int = 7, nodes: int = 3) -> Quadrature:
    rng = np.random.default_rng(seed)
    low, high = (3.25, 3.52) if isinstance(filter_um, Response) else filter_um
    edges = np.sort(rng.uniform(low, high, intervals - 1))
    members = rng.random((nodes, intervals)) * (rng.random((nodes, intervals)) > 0.4)
    members[0] += 1e-3
    members /= members.sum(axis=0)
    return Quadrature(
        filter_um,
        (low, *(float(edge) for edge in edges), high),
        tuple(tuple(row) for row in members.tolist()),
        480.0,
    )


@pytest.mark.parametrize("nodes", range(1, 7))
@pytest.mark.parametrize("filter_um", [TRAPEZE, (3.3, 3.5)], ids=["curve", "rectangle"])
def test_the_sum_is_the_filter(filter_um: Filter, nodes: int) -> None:
    parts = quadrature(filter_um, nodes, nodes=nodes).nodes
    total = sum(node.radiance(KELVIN) for node in parts)
    np.testing.assert_allclose(total, band_radiance(KELVIN, filter_um=filter_um), rtol=1e-12)
    assert sum(node.share(np.inf) for node in parts) == pytest.approx(1.0)


def test_a_node_is_its_part_of_the_filter() -> None:
    """Two halves of a rectangle against the rectangles themselves, where shares are tabulated."""
    halves = Quadrature((3.3, 3.5), (3.3, 3.38, 3.5), ((1.0, 0.0), (0.0, 1.0)), 480.0)
    kelvin = np.array([60.0, 250.0, 450.0, 2000.0, 4999.0])
    for node, edges in zip(halves.nodes, ((3.3, 3.38), (3.38, 3.5)), strict=True):
        np.testing.assert_allclose(
            node.radiance(kelvin), band_radiance(kelvin, filter_um=edges), rtol=1e-6
        )
        assert edges[0] < node.wavelength_um < edges[1]


def test_one_node_is_exactly_the_filter() -> None:
    node = Quadrature.grey((3.3, 3.5), reference_K=480.0).nodes[0]
    assert np.array_equal(node.radiance(KELVIN), band_radiance(KELVIN, filter_um=(3.3, 3.5)))
    pane = band_pane(Window(side="rear", material="CaF2"), (3.3, 3.5), reference_K=480.0)
    assert node.pane(Window(side="rear", material="CaF2")).transmission == pytest.approx(
        pane.transmission, abs=1e-5
    )


def test_kept_as_text() -> None:
    before = quadrature(TRAPEZE, 3)
    assert Quadrature.from_dict(json.loads(json.dumps(before.to_dict()))) == before


@pytest.mark.parametrize(
    ("edges", "members"),
    [
        ((3.3, 3.6), ((1.0,),)),
        ((3.3, 3.4, 3.5), ((1.0,),)),
        ((3.3, 3.4, 3.5), ((1.0, 0.5),)),
        ((3.3, 3.4, 3.5), ((1.5, 1.0), (-0.5, 0.0))),
        ((3.5, 3.3), ((1.0,),)),
    ],
)
def test_damaged(edges: tuple[float, ...], members: tuple[tuple[float, ...], ...]) -> None:
    with pytest.raises(SceneError, match="quadrature"):
        Quadrature((3.3, 3.5), edges, members, 480.0)


def test_cuts_are_the_best() -> None:
    """Against all ways to cut 9 samples: least squares within the groups, weighted with light."""
    rng = np.random.default_rng(7)
    looks, light = rng.random((3, 9)), rng.random(9) + 0.1

    def spread(starts: tuple[int, ...]) -> float:
        total = 0.0
        for low, high in pairwise([*starts, 9]):
            part, weight = looks[:, low:high], light[low:high]
            mean = np.average(part, axis=1, weights=weight)
            total += float(np.sum(weight * (part - mean[:, None]) ** 2))
        return total

    cuts = _cuts(looks, light, 5)
    for count in range(1, 6):
        assert len(cuts[count]) == count and cuts[count][0] == 0
        every = [(0, *inner) for inner in combinations(range(1, 9), count - 1)]
        assert spread(tuple(cuts[count])) == pytest.approx(min(spread(c) for c in every), rel=1e-9)


RISES_AGAIN = (2.9, 0.8, 0.5, 0.099, 0.39, 0.37, 0.2, 0.08, 0.09, 0.05)


def test_the_first_below_is_not_enough_where_the_curve_rises_again() -> None:
    assert enough(RISES_AGAIN, bound_K=0.1, limit=10) == 8
    assert stays_K(RISES_AGAIN, 4) == 0.39
    assert stays_K(RISES_AGAIN, 8) == 0.09


@pytest.mark.parametrize(
    ("bound_K", "count"), [(3.0, 1), (0.8, 2), (0.4, 4), (0.38, 6), (0.05, 10)]
)
def test_the_smallest_from_which_all_stay(bound_K: float, count: int) -> None:
    assert enough(RISES_AGAIN, bound_K=bound_K, limit=10) == count


def test_what_lies_beyond_the_most_counts() -> None:
    """4 nodes would do if no more were tried; with 3 allowed and nothing reached, 3 stay lowest."""
    assert enough(RISES_AGAIN[:4], bound_K=0.1, limit=4) == 4
    assert enough(RISES_AGAIN, bound_K=0.1, limit=3) == 3
    assert stays_K(RISES_AGAIN, 3) == 0.5


def test_not_reached_takes_no_more_than_it_is_worth() -> None:
    """From 2 on the error stays at 0.5, however many are taken: 2 are as good as 4."""
    assert enough((1.0, 0.3, 0.2, 0.5), bound_K=0.1, limit=4) == 2


def test_one_node_that_is_exact() -> None:
    assert enough((0.0,), bound_K=0.1, limit=24) == 1


def _spray() -> Spray:
    nothing = np.zeros((1, 3))
    one = np.ones(1)
    return Spray(parcels=Parcels(nothing, 1e-5 * one, one, 300.0 * one, 700.0 * one))


@pytest.mark.parametrize(
    ("optics", "words"),
    [
        ({}, ()),
        ({"filter_um": (3.38, 3.42)}, ()),
        ({"filter_um": (3.25, 3.58)}, ()),
        ({"preset": "spectral", "filter_um": (2.0, 14.0)}, ()),
        ({"filter_um": (2.0, 14.0)}, ("constants",)),
        ({"wavelength_um": 0.2}, ("outside the filter", "constants")),
        ({"filter_um": (19.0, 21.0)}, ("outside the filter", "constants")),
        ({"filter_um": (19.0, 21.0), "wavelength_um": 20.0}, ("constants",)),
        ({"filter_um": (19.0, 21.0), "wavelength_um": 20.0, "n": 1.4, "k": 0.01}, ()),
    ],
)
def test_constants_at_other_wavelengths(optics: dict[str, Any], words: tuple[str, ...]) -> None:
    given = {"preset": "paper", **optics}
    scene = load_scene("gdi").with_(**{f"optics.{key}": value for key, value in given.items()})
    remarks = elsewhere(scene, _spray())
    assert len(remarks) == len(words)
    for remark, word in zip(remarks, words, strict=True):
        assert word in remark and remark.startswith("optics.")


def test_regrouped_keeps_the_mean() -> None:
    """Other weights for the same absorption: the mean stays, equal weights change nothing."""
    given = KDistribution(np.array([0.2, 0.5, 0.3]), np.array([1.0, 2.0, 10.0]))
    np.testing.assert_allclose(_regrouped(given, given.weights), given.absorption_m2_mol)
    weights = np.array([0.1, 0.1, 0.4, 0.4])
    regrouped = _regrouped(given, weights)
    assert weights @ regrouped == pytest.approx(0.2 + 1.0 + 3.0)
    assert np.all(np.diff(regrouped) >= 0)
