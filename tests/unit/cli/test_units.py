"""Numbers on the command line, with and without their unit."""

from __future__ import annotations

import click
import pytest

from cldit.cli.options import KELVIN, Quantity


@pytest.mark.parametrize("text", ["0.1", "0.1K", "0.1 K", " 1e-1K"])
def test_unit_may_be_written(text: str) -> None:
    assert KELVIN.convert(text, None, None) == 0.1


def test_default_passes() -> None:
    assert Quantity("s").convert(0.5, None, None) == 0.5


@pytest.mark.parametrize("text", ["", "K", "0.1mK", "0.1s", "warm", "1K2"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match=r"not a number of K; allowed: e\.g\. 0\.1K"):
        KELVIN.convert(text, None, None)
