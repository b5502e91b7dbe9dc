"""What the choice of wavelengths tells the user where it leaves more than was asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.prepare.medium import properties_of
from cldit.scene import Scene, parse_scene
from cldit.spray.result import Cells, Spray, Vapour

EDGE = 0.1


def scene_of(**optics: Any) -> Scene:
    return parse_scene(
        {
            "name": "slab",
            "spray": {"model": "none"},
            "domain": {"edge_m": EDGE, "leaf_edge_m": 0.02},
            "background": {"temperatures_K": [430.0, 470.0]},
            "optics": {"preset": "spectral", "compare_paper": False, **optics},
        }
    )


def layers() -> Spray:
    """n-heptane's vapour, hot before cold, so that every wavelength sees another temperature."""
    cells = Cells.regular(
        origin_m=np.full(3, -EDGE / 2), spacing_m=np.full(3, EDGE / 4), shape=(4, 4, 4)
    )
    moles = np.full(len(cells.lower_m), 0.05 / EDGE * 6.02214076e23)
    kelvin = 650.0 - 3000.0 * (cells.lower_m[:, 1] + EDGE / 2)
    return Spray(vapour=Vapour(cells, moles, kelvin, 0.1002))


def test_what_is_not_reached_is_said() -> None:
    found = properties_of(scene_of(spectral_error_K=0.001), layers(), cache=None)
    (remark,) = found.remarks
    reached = f"{found.chosen.error_K:.2g} K RMS"
    assert found.chosen.error_K > 0.001
    assert f"wavelengths: {len(found.chosen.nodes)} (the most)" in remark
    for part in (reached, "spectral_error_K: 0.001", "optics.wavelengths up to 64"):
        assert part in remark


def test_nothing_is_said_where_it_is_reached() -> None:
    found = properties_of(scene_of(spectral_error_K=0.5), layers(), cache=None)
    assert found.remarks == ()
    count = len(found.chosen.nodes)
    errors_K = found.chosen.errors_K
    assert found.chosen.error_K == max(errors_K[count - 1 :]) <= 0.5
    assert count == 1 or max(errors_K[count - 2 :]) > 0.5


@pytest.mark.parametrize(("asked", "said"), [(1, 1), (12, 0)])
def test_a_number_that_is_set_says_what_it_leaves(asked: int, said: int) -> None:
    found = properties_of(scene_of(wavelengths=asked, spectral_error_K=0.5), layers(), cache=None)
    assert len(found.chosen.nodes) == asked
    assert len(found.remarks) == said
    assert all("as optics.wavelengths sets it" in remark for remark in found.remarks)
