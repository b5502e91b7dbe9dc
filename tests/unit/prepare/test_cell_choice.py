"""Which cells a run takes: fixed, needed, or what there is room for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.errors import MediumError, SceneError
from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.octree import CellSource, PointSource, Sources, build_octree
from cldit.medium.resolution import MOST_CELLS
from cldit.prepare import medium
from cldit.prepare.cell_choice import cells_that_fit, chosen_frame
from cldit.prepare.medium import prepare
from cldit.prepare.stages import Stages
from cldit.scene import load_scene, parse_scene
from cldit.scene.vessel import Domain
from cldit.spray.result import Cells


def cube(voxels: int, voxel_m: float, depth: float = 0.3) -> Sources:
    """A full cube of even voxels about the middle."""
    cells = Cells.regular(
        origin_m=np.full(3, -voxels * voxel_m / 2),
        spacing_m=np.full(3, voxel_m),
        shape=(voxels,) * 3,
    )
    none, each = np.zeros(voxels**3), np.full(voxels**3, depth / voxel_m)
    return None, [
        CellSource(cells.lower_m, cells.upper_m, none, none, 0.2 * each, 0.8 * each, none)
    ]


def chosen(domain: Domain, sources: Sources, limit: int = MOST_CELLS) -> tuple[Cube, str]:
    frame, remarks = chosen_frame(domain, sources, None, limit=limit)
    return frame, " ".join(remarks)


def test_even_voxels_run_at_their_own_size() -> None:
    """Cells that the paper's rule refuses."""
    sources = cube(24, 0.2 / 24)
    frame, said = chosen(Domain(), sources)
    assert said == ""
    assert build_octree(frame, *sources, optical_depth_split=1e-5).leaves[-1] == 24**3
    paper, said = chosen(Domain(rule="paper"), sources)
    assert (paper.cells, said) == (512, "")
    with pytest.raises(MediumError, match=r"1\.34e\+08 cells of 0\.391 mm.*omit it"):
        build_octree(paper, *sources, optical_depth_split=1e-5)


@pytest.mark.parametrize("rule", ["need", "paper"])
def test_a_leaf_that_is_set_stays(rule: Any) -> None:
    sources = cube(24, 4e-3)
    frame, said = chosen(Domain(rule=rule, leaf_edge_m=3e-3), sources, limit=10)
    assert frame == Cube.around(centre_m=(0.0, 0.0, 0.0), edge_m=0.2, leaf_edge_m=3e-3)
    assert said == ""
    domain = Domain(rule=rule, leaf_edge_m=3e-3)
    own, _ = chosen_frame(domain, sources, None, limit=10, voxels=True)
    assert own.cell_m == pytest.approx(2e-3)


def test_points_get_the_cells_of_the_paper() -> None:
    one = np.ones(1)
    points = PointSource(np.zeros((1, 3)), one, one, one)
    frame, said = chosen(Domain(), (points, []))
    assert (frame.cells, frame.lower_m, said) == (512, (-0.1, -0.1, -0.1), "")
    assert chosen(Domain(), (None, []))[0].depth == 0


def test_what_does_not_fit_is_as_fine_as_fits_and_said() -> None:
    frame, said = chosen(Domain(), cube(24, 4e-3), limit=10_000)
    assert frame.cell_m == pytest.approx(8e-3)
    for part in ("8 mm are the finest that fit", "needs 4 mm", "domain.leaf_edge_m"):
        assert part in said


@pytest.mark.parametrize("audit", [True, False])
def test_cells_chosen_by_their_error_are_not_remarked_on(
    device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, audit: bool
) -> None:
    """A run with an audit has other cells than those that fit, with reasons of its own."""
    monkeypatch.setattr(medium, "cells_that_fit", lambda *_, **__: 1_000)
    scene = load_scene("gdi-cone").with_(
        **{"spray.spacing_m": 2e-3, "domain.leaf_edge_m": None, "transport.audit": audit}
    )
    stages = Stages(None)
    prepare(scene, device, stages, tmp_path)
    assert any("finest that fit" in remark for remark in stages.remarks) != audit


def test_smaller_memory_holds_fewer_cells(device: Device) -> None:
    def fit(wavelengths: int = 1, *, phase: bool = False) -> int:
        small = replace(device.info, memory_bytes=10**9, largest_buffer_bytes=10**9)
        return cells_that_fit(replace(device, info=small), wavelengths=wavelengths, phase=phase)

    assert 10**5 < fit(phase=True) < fit() < 10**7
    assert fit(12) < fit()
    tight = replace(device.info, largest_buffer_bytes=96_000)
    assert cells_that_fit(replace(device, info=tight), wavelengths=1, phase=False) == 1000


@pytest.mark.parametrize(
    ("domain", "said"),
    [
        ({"rule": "coarse"}, "domain.rule: 'coarse'"),
        ({"edge_m": 4.0, "rule": "paper"}, "leaf_edge_m: 0.0005 (rule: paper) is finer than"),
        ({"leaf_edge_m": float("nan")}, "leaf_edge_m: nan is outside"),
    ],
)
def test_scenes_say_what_is_wrong(domain: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as wrong:
        parse_scene({"name": "x", "spray": {"model": "none"}, "domain": domain})
    assert said in str(wrong.value)


def test_a_large_domain_needs_no_leaf() -> None:
    assert parse_scene({"name": "x", "spray": {"model": "none"}, "domain": {"edge_m": 4.0}})
