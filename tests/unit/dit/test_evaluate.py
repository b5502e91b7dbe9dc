"""Maps of traces: holes in them, blocks, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps, Reason
from cldit.errors import EvaluationError
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from tests.verify.evaluation_bias import BACKGROUNDS_K, FILTER_UM


def _weights(background: NDArray[Any]) -> Weights:
    zero = np.zeros(background.shape, np.float32)
    return Weights(background.astype(np.float32), zero, zero, zero.copy())


def _trace(spray: Weights, reference: Weights, kelvin: tuple[float, ...] = BACKGROUNDS_K) -> Maps:
    return evaluate_radiance(
        spray,
        reference,
        background_temperatures_K=kelvin,
        surroundings=Surroundings(wall_temperature_K=300.0, background_emissivity=0.9),
        filter_um=FILTER_UM,
        sensor=None,
        shots=1,
        references=1,
    )


def test_trace_with_holes() -> None:
    """Nothing but NaN, nothing but wall, and an infinite weight are named, not propagated."""
    spray = _weights(np.array([[0.5, np.nan, 0.5, np.inf]]))
    spray.liquid[0, 0] = 0.5 * float(band_radiance(400.0, filter_um=FILTER_UM))
    reference = _weights(np.array([[1.0, 1.0, 0.0, 1.0]]))
    maps = _trace(spray, reference)
    lacking, hidden = Reason.TOO_FEW_BACKGROUNDS, Reason.BACKGROUND_NOT_VISIBLE
    np.testing.assert_array_equal(maps.reason, [[Reason.OK, lacking, hidden, lacking]])
    assert maps.apparent_temperature_K[0, 0] == pytest.approx(400.0, abs=1e-3)
    assert maps.emissivity[0, 0] == pytest.approx(0.5, rel=1e-6)


def test_trace_is_solved_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    spray = _weights(np.random.default_rng(1).random((13, 7)))
    at_once = _trace(spray, _weights(np.ones((13, 7))))
    monkeypatch.setattr("cldit.dit.evaluate._BLOCK", 80)
    parts = _trace(spray, _weights(np.ones((13, 7))))
    np.testing.assert_array_equal(at_once.emissivity, parts.emissivity)


def test_trace_refuses() -> None:
    ones = _weights(np.ones((2, 2)))
    with pytest.raises(EvaluationError, match="at least two"):
        _trace(ones, ones, (400.0,))
    with pytest.raises(EvaluationError, match="at least two"):
        _trace(ones, ones, (400.0, 400.0))
    with pytest.raises(EvaluationError, match="same radiance"):
        _trace(ones, ones, (0.0, 1.0))
    with pytest.raises(EvaluationError, match="without spray"):
        _trace(ones, _weights(np.ones((2, 3))))
