"""A sweep carries what each run states of its error."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from cldit.accuracy.errors import Cause, Errors
from cldit.run import open_run
from cldit.study.dataset import results_of

WRITTEN = Path(__file__).parents[2] / "data" / "run-0.1.0"


def test_the_stated_error_of_a_scene_is_in_the_sweep() -> None:
    run = open_run(WRITTEN)

    def figures(*causes: Cause) -> tuple[float, float]:
        errors = Errors(causes) if causes else None
        results = results_of(replace(run, info=replace(run.info, errors=errors)))
        return float(results["error_K"]), float(results["error_at_least"])

    known = (Cause("cells", 0.3, ""), Cause("classes", 0.4, ""))
    assert figures(*known) == (0.5, 0.0)
    assert figures(*known, Cause("parcels", None, "")) == (0.5, 1.0)
    assert all(math.isnan(one) for one in figures())
