"""Choice of a run's image among several of a scene."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from cldit.accuracy import converge as converging
from cldit.accuracy.allocation import Allocation
from cldit.accuracy.converge import Result, converge
from cldit.accuracy.errors import Cause, Errors, Estimate
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.trace_error import TraceError
from cldit.gpu.device import Device
from cldit.prepare.medium import prepare
from cldit.prepare.stages import Stages
from cldit.run import simulate
from cldit.scene import Scene, load_scene, parse_scene
from cldit.transport.trace import settings_for, trace


def box(folder: Path, **sections: dict[str, Any]) -> Scene:
    """A scene of a cube of 4^3 voxels of droplets, and 8 x 8 pixels."""
    coefficient = np.full((4, 4, 4), 300.0)
    np.savez(
        folder / "grid.npz",
        origin_m=np.full(3, -2e-3),
        spacing_m=np.full(3, 1e-3),
        droplet_absorption_per_m=coefficient,
        droplet_scattering_per_m=coefficient,
        droplet_temperature_K=coefficient,
    )
    data = {
        "name": "box",
        "spray": {"model": "grid", "file": str(folder / "grid.npz")},
        "domain": {"edge_m": 0.016},
        "camera": {"pixels": [8, 8], "field_m": [0.006, 0.006], "target_m": [0.0, 0.0, 0.0]},
    }
    return parse_scene(data | sections)


@pytest.mark.parametrize(
    ("found_K", "kept_K"), [((2.0, 1.6, 3.2), 1.6), ((2.0, 1.6, 1.2), 1.2), ((2.0, 0.9), 0.9)]
)
def test_an_image_with_a_larger_error_than_the_one_before_is_not_the_runs(
    found_K: tuple[float, ...], kept_K: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory may hold less than a refinement needs; its last reason is kept."""
    scene = load_scene("gdi-cone")
    left = list(found_K)

    def predict(problem: Problem, tolerance_K: float) -> tuple[Resolution, Allocation]:
        first = Resolution.first(problem.scene, ordinates_K=0.1, spectral_K=0.1)
        return first.at_depth(6), Allocation.of(problem.scene, tolerance_K)

    def solve(_: Problem, resolution: Resolution, allocation: Allocation) -> Result:
        error_K = left.pop(0)
        nothing: Any = SimpleNamespace(short=(), scatters=False)
        worse = error_K > kept_K and not left
        cause = Cause("cells", error_K, "known")
        parts: dict[str, Any] = dict.fromkeys(("medium", "reference", "maps", "sensor"))
        return Result(
            resolution=resolution.limited("cells", "memory is full" if worse else ""),
            allocation=allocation,
            traces=nothing,
            trace_errors=(),
            estimates=(Estimate(cause),),
            **parts,
        )

    monkeypatch.setattr(converging, "predict", predict)
    monkeypatch.setattr(converging, "solve", solve)
    device: Any = None
    stages = Stages(None)
    problem = Problem(scene, device, stages, Path(), None)
    nothing: Any = SimpleNamespace(properties=SimpleNamespace(sources=[(None, [])]))
    nothing.finest_lattice_m = lambda **_: 0.0
    problem._prepared = (), nothing
    kept = converge(problem, scene.transport.accuracy_K)
    assert kept.errors.total_K == kept_K
    assert not left
    worse = found_K[-1] > kept_K
    assert any("is kept" in remark for remark in stages.remarks) == worse
    assert (kept.resolution.limits == {"cells": "memory is full"}) == worse


def test_a_run_without_audit_remarks_on_its_trace_alone() -> None:
    keys = {"transport.audit": False, "transport.accuracy_K": 0.1, "transport.directions": 16}
    result: Any = SimpleNamespace(
        trace_error=TraceError(0.24),
        traces=SimpleNamespace(short=()),
        errors=Errors(()),
        resolution=SimpleNamespace(limits={}),
        allocation=SimpleNamespace(emissivity=None),
    )
    (text,) = converging._last_remarks(load_scene("gdi-cone").with_(**keys), result)
    assert "trace contributes 0.24 K, set by transport.directions" in text


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"background": {"temperatures_K": [300.0, 340.0], "radius_m": 1e-6}},
         "does not see the heated background"),
        ({"background": {"temperatures_K": [400.0]}}, "fewer than two backgrounds .*: 64 pixels"),
        ({"background": {"temperatures_K": [400.0, 400.0]}}, "fewer than two backgrounds"),
    ],
    ids=["hidden background", "one background", "equal backgrounds"],
)  # fmt: skip
def test_no_error_is_stated_of_a_temperature_that_no_pixel_has(
    device: Device, tmp_path: Path, change: dict[str, Any], why: str
) -> None:
    walls = {"temperature_K": 400.0}
    background = {"radius_m": 0.05} | change["background"]
    # A mean over an edge may have a T_app.
    scene = box(tmp_path, walls=walls, background=background).with_(**{"camera.rays_per_pixel": 1})
    run = simulate(scene, device=device)
    assert not run.maps.has_temperature.any()
    assert run.errors is not None and run.errors.total_K is None and not run.errors.causes
    assert re.search(f"not stated: no pixel has a T_app .*({why})", run.errors.text)
    assert TypeAdapter(Errors).validate_python(run.errors.to_dict()) == run.errors
    assert run.error_maps == {}


def test_an_image_that_was_traced_is_only_audited(device: Device, tmp_path: Path) -> None:
    """A coarse trace that becomes the image has the weights and the audit of a trace of its own."""
    scene = box(tmp_path)
    prepared = prepare(scene, device, Stages(None), tmp_path)
    (tree,) = prepared.octrees(prepared.cube, [prepared.sources])
    settings = settings_for(scene, tolerance_K=4.0)
    own = trace(tree, scene, device, settings)
    bare = trace(tree, scene, device, replace(settings, audit=False))
    audited = trace(tree, scene, device, settings, known=bare)
    assert bare.audit is None and audited.weights is bare.weights
    assert audited.audit is not None and own.audit is not None
    np.testing.assert_array_equal(audited.audit.sample.pixels, own.audit.sample.pixels)
    for alike, error in zip(audited.audit.errors, own.audit.errors, strict=True):
        np.testing.assert_allclose(alike.wall, error.wall, atol=1e-6)  # sums in single precision
