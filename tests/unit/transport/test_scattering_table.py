"""Phase functions as tables: moments, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cldit.errors import OpticsError
from cldit.transport.phase import PhaseError, SizeClasses
from tests.phase_tables import henyey_greenstein


@pytest.mark.parametrize("g", [-0.7, 0.0, 1e-7, 0.3, 0.8, 0.95])
def test_henyey_greenstein_moments_are_powers_of_g(g: float) -> None:
    """Exact but for the bins of 3 mrad: second order in their width, times (l + 1)^2 / 12."""
    moments = henyey_greenstein(g).moments(12)
    degrees = np.arange(12)
    assert moments == pytest.approx(g**degrees, abs=144 * (np.pi / 1024) ** 2 / 12)
    assert moments[0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("g", [-1.0, 1.0, float("nan")])
def test_impossible_asymmetry_is_refused(g: float) -> None:
    with pytest.raises(OpticsError, match=r"outside -1\.\.1"):
        henyey_greenstein(g)


def test_classes_by_diameter() -> None:
    one, other = henyey_greenstein(0.2), henyey_greenstein(0.9)
    classes = SizeClasses(np.array([5e-6]), (one, other), 0.0)
    np.testing.assert_array_equal(classes.number(np.array([1e-6, 5e-6, 2e-5])), [0, 1, 1])
    mean = henyey_greenstein(0.5)
    assert mean.tables == (mean,)
    assert replace(mean, classes=classes).tables == (one, other)
    with pytest.raises(PhaseError, match="1 phase functions for 0 bounds"):
        SizeClasses(np.zeros(0), (one,), 0.0)
