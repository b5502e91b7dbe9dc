"""The split of a wanted error is the cheapest one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.allocation import split


def source(power: float, share: float = 1.0) -> Any:
    return SimpleNamespace(cost_power=power, cost_share=share)


def test_squares_sum_to_the_whole() -> None:
    shares = split(2.0, {"a": source(3.0), "b": source(1.5), "c": source(1.0, 0.1)})
    assert sum(one**2 for one in shares.values()) == pytest.approx(4.0)
    assert shares["a"] ** 2 == pytest.approx(2 * shares["b"] ** 2)
    assert split(1.0, {}) == {}


def test_factors_cost_least() -> None:
    """Cells and ordinates multiply: no other split of the same error costs less."""
    efforts = {"cells": source(3.0), "trace": source(1.5)}
    best = split(1.0, efforts)

    def cost(cells_K: float) -> float:
        return float(cells_K**-3.0 * (1 - cells_K**2) ** (-1.5 / 2))

    others = np.linspace(0.05, 0.99, 400)
    assert cost(best["cells"]) <= min(cost(one) for one in others) * (1 + 1e-9)


def test_terms_cost_least() -> None:
    """Causes that add their own costs: shares of these are those at the optimum."""
    ways = np.linspace(0.01, 0.999, 20_000)  # of the first error; costs 4 / e and 1 / e^2
    first, second = 4.0 / ways, 1.0 / (1 - ways**2)
    least = int(np.argmin(first + second))
    whole = first[least] + second[least]
    efforts = {"a": source(1.0, first[least] / whole), "b": source(2.0, second[least] / whole)}
    assert split(1.0, efforts)["a"] == pytest.approx(ways[least], abs=2e-3)
