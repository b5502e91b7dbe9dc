"""`cldit bench` on a small scene: what it measures is sane; how fast is not asserted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.bench.case import BenchError, Case, Lattice, changed
from cldit.bench.error import Row, bench_error
from cldit.bench.error_report import error_part
from cldit.bench.kernels import Kernels
from cldit.bench.orders import bench_orders
from cldit.bench.ratios import ratios
from cldit.bench.report import write_part
from cldit.bench.roofline import roofline
from cldit.gpu.device import Device
from cldit.run import simulate
from cldit.scene import Scene
from cldit.transport.cells import Needs
from cldit.transport.trace import trace


@pytest.fixture(scope="module")
def small() -> Scene:
    """Droplets alone at low resolution."""
    scene = cldit.load_scene("droplets-only")
    return changed(
        scene, camera={"pixels": [50, 40], "field_m": [0.1, 0.08]}, domain={"leaf_edge_m": 3e-3}
    )


@pytest.fixture(scope="module")
def case(small: Scene, device: Device, tables: Path) -> Case:
    return Case.of(small, device, cache=tables)


def test_all_methods_against_the_reference(case: Case, tmp_path: Path) -> None:
    """Errors fall with accuracy, samples and order; branching and source agree on order 0."""
    lines: list[str] = []
    every = Lattice((1, 1))
    rows, truth = bench_error(
        case,
        phase="isotropic",
        lattice=every,
        say=lines.append,
        accuracies_K=(3.0, 0.3),
        samples=(128, 512),
        reference_samples=1024,
    )
    rows += bench_orders(case, truth, phase="isotropic", lattice=every, say=lines.append, every=9)
    assert truth.noise_K > 0
    by = {row.label: row for row in rows}
    assert by["path, 512 samples"].rms_K < by["path, 128 samples"].rms_K
    # 128 samples have twice the error of 512: to 30 %, for there are some 100 pixels to know it by.
    assert 1.3 < by["path, 128 samples"].rms_K / by["path, 512 samples"].rms_K < 2.9
    assert by["source, order 2, 0.1 K"].rms_K < by["source, order 0"].rms_K
    assert by["branching, order 0"].rms_K == pytest.approx(by["source, order 0"].rms_K, rel=0.01)
    assert by["branching, order 2"].traced < 0.02
    for order in (1, 2):
        fine = by[f"source, order {order}, 0.1 K"]
        assert fine.of_order_K is not None and fine.of_order_K < 0.5 * fine.rms_K
    assert by["source, 0.3 K"].rms_K < by["source, order 0"].rms_K
    part = error_part(case.scene, rows, {"isotropic": truth})
    page = write_part(part, tmp_path, command="cldit bench", device=case.device)
    assert (tmp_path / "bench/error.png").stat().st_size > 5000
    assert len(json.loads((tmp_path / "bench/error.json").read_text())["rows"]) == len(rows)
    assert "extrapolated" in page.read_text(encoding="utf-8")


def _row(
    method: str, core_s: float, rms_K: float, order: int | None = None, left_K: float | None = None
) -> Row:
    return Row(
        method, f"{method} {core_s}", "isotropic", order, 1.0, core_s, core_s, core_s, rms_K,
        rms_K, 0.0, 0.0, 0.0, 0.0, of_order_K=rms_K, left_K=left_K,
    )  # fmt: skip


def test_ratios_are_at_equal_error() -> None:
    """Path at 0.2 K in 10 s takes 40 s to 0.1 K: 20 times what source takes 2 s for."""
    rows = [_row("source", 2.0, 0.1), _row("path", 10.0, 0.2), _row("path", 40.0, 0.1)]
    found = {ratio.what: ratio.times for ratio in ratios(rows)}
    assert found["path / source 2.0, isotropic"] == pytest.approx(20.0)


@pytest.mark.parametrize(("error_K", "runs"), [(5.0, 1.0), (4.0, 16 / 7), (3.0, None), (1.0, None)])
def test_branching_gets_no_better_than_what_it_simplifies(
    error_K: float, runs: float | None
) -> None:
    """Of 5 K, 3 K stay: the noise of 4 K is sqrt(7) K after 16 / 7 runs, and never none."""
    rows = [_row("source", 1.0, error_K, 1), _row("branching", 70.0, 5.0, 1, left_K=3.0)]
    once, equal = ratios(rows)
    assert once.times == pytest.approx(70.0)
    assert once.error_K is None
    assert equal.error_K == error_K
    assert equal.times == (None if runs is None else pytest.approx(70.0 * runs))


@pytest.mark.parametrize("every", [1, 3, 5])
def test_a_lattice_has_the_lines_of_sight_of_the_whole(case: Case, every: int) -> None:
    """Order 0 has no chance in it: every picked pixel is that of the small picture."""
    lattice = Lattice((every, every))
    part = case.seen(lattice.of(case.scene))
    whole = trace(case.tree, case.scene, case.device, case.settings(order=0)).weights
    alone = trace(part.tree, part.scene, part.device, part.settings(order=0)).weights
    picked = lattice.pick(case.scene, whole)
    assert picked.background.shape == alone.background.shape
    # Rounding of pixel places moves rays over cell edges: in single precision, in few pixels.
    off = np.abs(picked.wall - alone.wall) > 1e-4
    assert off.mean() < 0.02


def test_even_spacing_is_refused(small: Scene) -> None:
    with pytest.raises(BenchError, match="odd"):
        Lattice((2, 1))
    with pytest.raises(BenchError, match="leaves none"):
        Lattice((99, 1)).of(small)


def test_temperatures_are_those_of_dit(case: Case, device: Device, tables: Path) -> None:
    """Where the line of sight ends on the disc, to single precision of the weights."""
    run = simulate(case.scene, device=device, cache=tables)
    mine = case.temperature_K(run.weights)
    maps = run.maps
    here = (maps.emissivity > 0.05) & np.isfinite(maps.apparent_temperature_K)
    here &= run.reference.background > 0.5
    assert here.sum() > 50
    assert np.abs(mine - maps.apparent_temperature_K)[here].max() < 0.02


def test_no_temperature_beside_the_background(case: Case) -> None:
    """There the wall is seen with a weight of 1, which is no emissivity, and is always right."""
    part = case.seen(changed(case.scene, background={"radius_m": 0.02}))
    weights = part.run(part.settings(accuracy_K=3.0, audit=False))[0].weights
    known = np.isfinite(part.temperature_K(weights))
    beside = weights.wall > 0.999
    assert 0.5 < beside.mean() < 0.95
    assert not known[beside].any()
    assert known[(weights.background > 0.05) & (weights.background < 0.9)].all()


def test_what_is_compiled_in_by_force_changes_nothing(case: Case) -> None:
    """Vapour in droplets alone; and cell by cell through empty space counts more steps."""
    full = Kernels(case, compiled_in=Needs(vapour=True, droplets=False, scattering=False))
    assert "vapour" in full.cells.needs.components
    assert "vapour" not in Kernels(case).cells.needs.components
    few, _ = Kernels(case).steps()
    many, _ = Kernels(case, defines={"EVERY_CELL": 1}).steps()
    assert many[0].sum() > few[0].sum()
    assert np.abs(many[1] - few[1]).max() <= 2  # a ray along an edge may graze a cell


def test_floor_is_below_what_kernels_take(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy within the cache is quicker than memory: the floor lies lower still."""
    monkeypatch.setattr("cldit.bench.roofline._COPY_BYTES", 8 * 2**20)
    monkeypatch.setattr("cldit.bench.roofline._ROUNDS", 64)  # a hundredth of a second is enough
    part = roofline(case, directions=2)
    for line in part.data["lines"]:
        assert 0 < line["roofline_s"] < line["core_s"]
