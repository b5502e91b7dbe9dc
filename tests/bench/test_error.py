"""`python -m tests.bench error` on a small scene: errors are sane; times are not asserted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.bench.case import BenchError, changed
from cldit.bench.report import write_part
from cldit.gpu.device import Device
from cldit.run import simulate
from cldit.scene import Scene
from cldit.transport.trace import trace
from tests.bench.case import Case, Lattice
from tests.bench.error import bench_error, error_part


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


@pytest.mark.slow
def test_all_methods_against_the_reference(case: Case, tmp_path: Path) -> None:
    """Errors fall with accuracy and samples."""
    lines: list[str] = []
    rows, truth = bench_error(
        case,
        phase="isotropic",
        lattice=Lattice((1, 1)),
        say=lines.append,
        accuracies_K=(3.0, 0.3),
        samples=(128, 512),
        reference_samples=1024,
    )
    assert truth.noise_K > 0
    by = {row.label: row for row in rows}
    assert by["path, 512 samples"].rms_K < by["path, 128 samples"].rms_K
    # 128 samples have twice the error of 512: to 30 %, for there are some 100 pixels to know it by.
    assert 1.3 < by["path, 128 samples"].rms_K / by["path, 512 samples"].rms_K < 2.9
    assert by["source, 0.3 K"].rms_K < by["source, 3 K"].rms_K
    part = error_part(case.scene, rows, {"isotropic": truth})
    page = write_part(part, tmp_path, command="python -m tests.bench error", device=case.device)
    assert (tmp_path / "error.png").stat().st_size > 5000
    assert len(json.loads((tmp_path / "error.json").read_text())["rows"]) == len(rows)
    assert "extrapolated" not in page.read_text(encoding="utf-8")  # every pixel was traced


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


@pytest.mark.slow
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
