"""The errors that a run states by cause: found, unknown where nobody knows, kept on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cldit
from cldit.run import Run
from cldit.run.errors import Errors

EVEN = {
    "droplet_absorption_per_m": 20.0,
    "droplet_scattering_per_m": 20.0,
    "droplet_temperature_K": 350.0,
}
SMALL = {
    "size_m": (0.04, 0.04, 0.04),
    "domain": {"edge_m": 0.16, "leaf_edge_m": 0.006},
    "camera": {"pixels": [24, 24], "field_m": [0.06, 0.06]},
    "background": {"temperatures_K": [400.0, 500.0], "radius_m": 0.05},
}


def by_name(errors: Errors | None) -> dict[str, float | None]:
    assert errors is not None
    return {cause.name: cause.error_K for cause in errors.causes}


def test_cells_of_an_even_block(run_block: Callable[..., Run]) -> None:
    """Cells twice as large hold the same medium where the block ends at their faces: what is left
    is how the source is resolved, some tenths of a kelvin; and nothing is unknown."""
    run = run_block(EVEN, **SMALL, transport={"audit": True, "accuracy_K": 1.0})
    found = by_name(run.errors)
    cells = found["cells"]
    assert cells is not None and 0.0 < cells < 2.0
    assert set(found) == {"trace", "cells", "pixel sampling"}
    assert run.errors is not None and not run.errors.unknown


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_paths_are_as_sharp_as_asked(seed: int) -> None:
    """Before walls of 450 K, droplets that hardly absorb are dark: by their own brightness the
    noise of the paths seems ten times less than it is.

    Paths may leave half of what is asked for. By the same ordinates, the squares of the stated
    errors at 0.3 and 0.05 K are that far apart, and three standard errors of the product of both
    noises, 2 x 0.3 x 0.15 K^2 over the root of some 50 places that err independently.
    """
    data: dict[str, Any] = cldit.load_scene("droplets-only").model_dump(mode="json")
    data["camera"]["pixels"] = [60, 60]
    data["spray"]["spacing_m"] = 1e-3
    squares = []
    for asked_K in (0.3, 0.05):
        asked = {"accuracy_K": asked_K, "directions": 64, "audit": False, "seed": seed}
        data["transport"].update(asked, phase="mie")
        error_K = cldit.simulate(cldit.parse_scene(data)).info.accuracy_K
        assert error_K is not None
        squares.append(error_K**2)
    assert squares[0] - squares[1] < 0.15**2 + 3 * 2 * 0.3 * 0.15 / 50**0.5


def test_no_audit_no_errors(run_block: Callable[..., Run]) -> None:
    assert run_block(EVEN, **SMALL, transport={"audit": False}).errors is None


def test_errors_are_kept(tmp_path: Path) -> None:
    """In run.json, without NaN, and as maps; the cone's own lattice has an error that is known."""
    data: dict[str, Any] = cldit.load_scene("methane-jet").model_dump(mode="json")
    data["camera"]["pixels"] = [32, 32]
    data["domain"]["leaf_edge_m"] = 4e-3
    run = cldit.simulate(cldit.parse_scene(data), tmp_path / "run")
    assert run.errors is not None and not run.errors.unknown
    assert by_name(run.errors)["gas grid"]
    again = cldit.open_run(tmp_path / "run")
    assert again.errors == run.errors
    assert set(again.error_maps) == set(run.error_maps) >= {"total", "cells", "gas grid"}
    assert "NaN" not in (tmp_path / "run" / "run.json").read_text(encoding="utf-8")
    known = [error for error in by_name(run.errors).values() if error is not None]
    assert run.errors.total_K == pytest.approx(sum(error**2 for error in known) ** 0.5)
