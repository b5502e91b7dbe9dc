"""Standard errors of a pixel by the number of its references and injections."""

from __future__ import annotations

import numpy as np
import pytest

from cldit.camera.curve import Curve
from cldit.dit.solve import Signals, solve

SOURCE = np.array([1.0, 2.0, 4.0])
VARIANCE = 1e-6


def _error(references: float, injections: float) -> float:
    """Standard error of the emissivity of a pixel that transmits 0.4."""

    def signals(slope: float, start: float, exposures: float) -> Signals:
        return Signals(
            source=SOURCE,
            mean=(slope * SOURCE + start)[:, None, None],
            camera=lambda seen: np.full_like(seen, VARIANCE),
            exposures=np.full(3, exposures),
        )

    maps = solve(
        signals(1.0, 0.0, references),
        signals(0.4, 0.5, injections),
        usable=np.ones((3, 1, 1), bool),
        curve=Curve(filter_um=(3.3, 3.5)),
    ).maps
    return float(maps.emissivity_standard_error[0, 0])


@pytest.mark.parametrize(("references", "injections"), [(2.0, 32.0), (32.0, 2.0), (5.0, 5.0)])
def test_each_kind_has_the_error_of_its_own_number(references: float, injections: float) -> None:
    """Var(1 - s / g) = (s / g)^2 Var(g) + Var(s) for g = 1; slopes of a line have VARIANCE over
    the number of exposures and the sum of squares of SOURCE."""
    spread = float(np.sum((SOURCE - SOURCE.mean()) ** 2))
    expected = np.sqrt(VARIANCE / spread * (0.4**2 / references + 1.0 / injections))
    assert _error(references, injections) == pytest.approx(expected, rel=1e-5)
