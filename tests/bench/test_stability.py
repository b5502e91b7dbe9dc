"""`cldit bench stability`: a case of each kind runs, every bound holds, and the page says so."""

from __future__ import annotations

import math

import pytest
from click.testing import CliRunner

from cldit.bench.stability import bench_stability, page
from cldit.bench.stability_case import Case
from cldit.bench.stability_known import cases
from cldit.cli.bench import stability as command
from cldit.errors import TransportError
from cldit.gpu.device import Device

# Thick cells that hardly absorb, or do not: four fifths of all the time. `verify/test_cavity.py`
# has neighbours of all four with few samples, in cells of depth 100, 1e4 and 1e6.
LONG = {"100, 0.999999", "1e+06, 0.999999", "100, 1", "1e+06, 1"}


@pytest.mark.parametrize("long", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_bounds_hold(device: Device, long: bool) -> None:
    chosen = [case for case in cases(few=True) if long or case.name not in LONG]
    assert long or len(chosen) == len(cases(few=True)) - len(LONG)
    outcomes = bench_stability(device, chosen)
    assert not [(o.case.name, o.error, o.message) for o in outcomes if not o.holds]
    assert len({outcome.case.group for outcome in outcomes}) >= 6
    text = page(outcomes, [], [], device, command="cldit bench stability")
    assert all(f"| {outcome.case.name} |" in text for outcome in outcomes)
    assert "missed" not in text


def test_every_kind_is_among_the_few() -> None:
    """The reduced table leaves out cases, not kinds; but for methods that take long."""
    few, every = ({case.group for case in cases(few=few)} for few in (True, False))
    assert few <= every
    assert every - few == {f"method {name}" for name in ("source and gather", "path", "branching")}
    assert "256 x 256 x 152 = 1.0e7 cells" in {case.name for case in cases()}


def test_missing_solver_is_told_before_any_case(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cldit.bench.stability_slabs.find_spec", lambda name: None)
    monkeypatch.setattr(command, "open_device", lambda name: pytest.fail("a case would run"))
    result = CliRunner().invoke(command.bench_stability_command, [])
    assert result.exit_code != 0
    assert "pip install PythonicDISORT" in result.output


def test_what_misses_is_told(device: Device) -> None:
    def fail(bench: object) -> float:
        raise TransportError("light is lost")

    found = bench_stability(
        device,
        [
            Case("a", "too far", 1e-3, lambda bench: 2e-3),
            Case("a", "no number", 1e-3, lambda bench: math.nan),
            Case("a", "refused", 1e-3, fail),
        ],
    )
    assert [outcome.holds for outcome in found] == [False] * 3
    text = page(found, [], [], device, command="x")
    assert text.count("**missed**") == 3
    assert "light is lost" in text
