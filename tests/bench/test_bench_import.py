"""`cldit bench --only import` on smaller cases: what an import may take beside vtk."""

from __future__ import annotations

import pytest

from tests.bench.imports import CASES, Large, imports

pytest.importorskip("vtkmodules")


def _quiet(_: str) -> None:
    pass


@pytest.mark.slow
def test_every_case_is_measured() -> None:
    """So small that only the bookkeeping counts."""
    small = tuple(Large(case.label, case.write, 4, min(case.parcels, 20)) for case in CASES)
    part = imports(_quiet, small[:1])
    (row,) = part.tables[0].rows
    assert row[0] == small[0].label
    assert list(row[1:3]) == ["64", "20"]
    assert part.data[0]["cells"] == 64
    for how in ("vtk", "cldit", "cldit --out"):
        assert part.data[0][how]["resident_bytes"] > 0


@pytest.mark.long
def test_large_cases_take_no_more_than_they_may() -> None:
    """At most 3 times vtk's memory and 15 times its CPU time, and no more than was said before.

    Of a million cells vtk's own share is so small that what every process takes counts: 0.2 GB.
    """
    large = tuple(Large(case.label, case.write, 100, min(case.parcels, 200_000)) for case in CASES)
    for case in imports(_quiet, large).data:
        assert case["memory_ratio"] < 3.0, case["case"]
        assert case["time_ratio"] < 15.0, case["case"]
        for how in ("cldit", "cldit --out"):
            # a tenth: shared libraries differ between machines
            assert case[how]["resident_bytes"] < 1.1 * case["said_bytes"], case["case"]
