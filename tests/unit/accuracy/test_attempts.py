"""Which of several pictures of a scene is the run's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cldit.accuracy.attempt import Attempts
from cldit.accuracy.errors import Cause, Errors
from cldit.accuracy.outcome import Attempt
from cldit.accuracy.plan import Plan
from cldit.prepare.stages import Stages
from cldit.scene import load_scene


@pytest.mark.parametrize(
    ("found_K", "kept_K"), [((2.0, 1.6, 3.2), 1.6), ((2.0, 1.6, 1.2), 1.2), ((2.0, 0.9), 0.9)]
)
def test_a_picture_that_errs_more_than_the_one_before_is_not_the_runs(
    found_K: tuple[float, ...], kept_K: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory may hold less than a refinement wants; its last word is why."""
    scene = load_scene("gdi")
    left = list(found_K)

    def made(_: Attempts, plan: Plan) -> Attempt:
        error_K = left.pop(0)
        nothing: Any = SimpleNamespace(short=())
        limited = "memory is full" if error_K > kept_K and not left else ""
        errors = Errors.of([Cause("cells", error_K, "known")])
        parts: dict[str, Any] = dict.fromkeys(("medium", "reference", "maps", "sensor", "stated"))
        plan = replace(plan, limited=limited)
        return Attempt(
            scene=scene, plan=plan, result=nothing, errors=errors, error_maps={}, **parts
        )

    monkeypatch.setattr(Attempts, "_made", made)
    device: Any = None
    stages = Stages(None)
    kept = Attempts(scene, device, stages, Path(), None).best()
    assert kept.errors is not None and kept.errors.total_K == kept_K
    assert not left
    worse = found_K[-1] > kept_K
    assert any("is kept" in remark for remark in stages.remarks) == worse
    assert (kept.plan.limited == "memory is full") == worse
