"""`cldit bench --only solver` on a small scene, and what solving does when it stalls."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.bench.case import Case, changed
from cldit.bench.solver import MEDIA, WANTED, Array, anderson, compare, lambda_iteration
from cldit.errors import NotConvergedError
from cldit.gpu.device import Device
from cldit.transport.trace import trace


@pytest.fixture(scope="module")
def case(device: Device, tables: Path) -> Case:
    """Droplets alone at low resolution."""
    scene = changed(
        cldit.load_scene("droplets-only"),
        camera={"pixels": [20, 20]},
        domain={"leaf_edge_m": 4e-3},
        transport={"phase": "isotropic"},
    )
    return Case.of(scene, device, cache=tables)


def test_ways_on_a_matrix() -> None:
    """Both against the solution of (1 - A) x = b; Anderson with as many steps as unknowns is
    there after as many passes and one, in exact arithmetic (Walker and Ni 2011)."""
    rng = np.random.default_rng(4)
    matrix = 0.9 * np.linalg.qr(rng.normal(size=(5, 5)))[0]
    right = rng.normal(size=(1, 5))
    truth = np.linalg.solve(np.eye(5) - matrix, right[0])

    def lack(source: Array) -> Array:
        return np.asarray(source @ matrix.T + right - source)

    fast = anderson(lack, np.zeros((1, 5)))
    *_, last = (next(fast) for _ in range(7))
    np.testing.assert_allclose(last[0], truth, rtol=1e-9)
    slow = lambda_iteration(lack, np.zeros((1, 5)))
    *_, last = (next(slow) for _ in range(7))
    # Every pass leaves 0.9 of the error: the matrix is a rotation times that.
    left = np.linalg.norm(last[0] - truth) / np.linalg.norm(truth)
    assert left == pytest.approx(0.9**7)


def test_gmres_ends_where_others_do_not(case: Case) -> None:
    rows = compare(case, MEDIA[:2], say=lambda _: None)
    found = {(row.medium, row.method): row for row in rows}
    stiff = MEDIA[1].name
    # Its estimate goes by the smallest singular value that it met; 2.3 times that was seen.
    for medium in (MEDIA[0].name, stiff):
        assert found[medium, "GMRES"].error < 3 * WANTED
    assert found[stiff, "Lambda"].error > 10 * WANTED
    easy = found[MEDIA[0].name, "Lambda"]
    assert easy.stopped == "error reached" and easy.error <= WANTED


def test_what_single_precision_cannot_do_is_done_in_double(case: Case, device: Device) -> None:
    """A tolerance below rounding: GMRES stalls, and says so or goes on in double precision."""
    if not device.info.float64:
        pytest.skip("the device has no double precision")
    settings = replace(case.settings(audit=False), tolerance=1e-9, directions=8, final_directions=8)
    lines: list[str] = []
    run = trace(case.tree, case.scene, device, settings, report=lines.append)
    assert run.precision == "float64"
    assert any("again in double precision" in line for line in lines)
    assert run.solution is not None and run.solution.error <= 1e-9
    with pytest.raises(NotConvergedError, match=r"allow a larger transport\.accuracy_K"):
        trace(case.tree, case.scene, device, replace(settings, precision="float32"))
