"""The budget's benchmark: references are kept, errors are those of the pixels that count."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.errors import Cause, Errors
from cldit.bench import BUDGET_SCENES
from cldit.bench import budget as module
from cldit.bench.budget import (
    BudgetRow,
    budget,
    budget_part,
    held_by,
    stored_rows,
    true_error_K,
)
from cldit.bench.budget_scenes import Reference, budget_scene
from cldit.bench.case import BenchError
from cldit.bench.report import Part
from cldit.prepare.spray_factory import make_spray
from cldit.radiance.apparent_temperature import has_temperature
from cldit.scene import Scene
from cldit.scene.camera import Camera
from tests.bench.budget_reference import save


def test_a_reference_is_kept(tmp_path: Path) -> None:
    temperature_K = np.array([[300.123, np.nan], [450.0, 512.346]])
    save(Reference(temperature_K, 0.2), "some", tmp_path)
    again = Reference.load("some", pixels=2, folder=tmp_path)
    assert again is not None and again.error_K == 0.2
    np.testing.assert_allclose(again.temperature_K, temperature_K, atol=0.005001)
    assert Reference.load("some", pixels=3, folder=tmp_path) is None
    with pytest.raises(BenchError, match="at most 655 K"):
        save(Reference(np.full((2, 2), 700.0), 0.2), "hot", tmp_path)


def test_true_error_is_of_pixels_that_count() -> None:
    temperature_K = np.array([[303.0, 500.0], [404.0, np.nan]], np.float32)
    emissivity = np.array([[0.5, 0.01], [0.5, 0.5]], np.float32)
    maps = SimpleNamespace(
        apparent_temperature_K=temperature_K,
        has_temperature=has_temperature(emissivity, temperature_K),
    )
    run: Any = SimpleNamespace(maps=maps, scene=SimpleNamespace(name="some"))
    reference = Reference(np.array([[300.0, 300.0], [400.0, 400.0]]), 0.0)
    assert true_error_K(run, reference) == pytest.approx((12.5) ** 0.5)
    with pytest.raises(BenchError, match="no pixel has a T_app"):
        true_error_K(run, Reference(np.full((2, 2), np.nan), 0.0))


def test_scenes_leave_their_keys_to_the_plan(tmp_path: Path) -> None:
    for name in BUDGET_SCENES:
        scene = budget_scene(name, pixels=20, folder=tmp_path, seed=3)
        assert scene.domain.leaf_edge_m is None and scene.transport.audit
        rays = Camera.model_fields["rays_per_pixel"].default
        assert scene.camera.pixels == (20, 20) and scene.camera.rays_per_pixel == rays
        assert scene.transport.seed == 3
        assert scene.spray.model != "lagrangian" or scene.spray.seed == 3


def test_draws_of_the_imported_case_are_one_spray(tmp_path: Path) -> None:
    """Seeds differ in their parcels alone; several draws share the liquid, and so do all."""
    sprays = [
        make_spray(
            budget_scene("imported", pixels=20, folder=tmp_path, **more).spray, cache=tmp_path
        )
        for more in ({"seed": 1}, {"seed": 2}, {"seed": 3, "draws": 2})
    ]
    parcels = [one.parcels for one in sprays]
    assert all(one is not None for one in parcels)
    counts = [len(one.droplets) for one in parcels if one is not None]
    assert counts[0] == counts[1] == counts[2] / 2 > 13_000
    masses = [one.mass_kg for one in parcels if one is not None]
    assert masses == pytest.approx([1e-6] * 3, rel=1e-3)
    gases = [one.vapour for one in sprays]
    assert gases[0] is not None and gases[1] is not None
    np.testing.assert_array_equal(gases[0].number_density_m3, gases[1].number_density_m3)


def row(scene: str, **more: Any) -> BudgetRow:
    causes: dict[str, float | None] = {"trace": 0.3}
    return BudgetRow(scene, 1.0, 0.9, False, 0.8, 60.0, 11.0, causes, **more)


def test_what_holds_the_error_is_what_the_run_remarks() -> None:
    def run(error_K: float, *remarks: str) -> Any:
        errors = Errors.of([Cause("cells", error_K, "", "domain.leaf_edge_m")])
        scene = SimpleNamespace(name="some")
        return SimpleNamespace(errors=errors, scene=scene, info=SimpleNamespace(remarks=remarks))

    assert held_by(run(0.9), 1.0) == held_by(run(1.0, "other"), 1.0) == ""
    stated = "stated error 2 K RMS, more than ...: cells contribute 2 K"
    assert held_by(run(2.0, stated), 1.0) == "cells (domain.leaf_edge_m)"
    for remarks in ((), ("stated error 2 K RMS: pixel sampling contributes",)):
        with pytest.raises(BenchError, match="without a remark"):
            held_by(run(2.0, *remarks), 1.0)


def test_parts_are_put_together(tmp_path: Path) -> None:
    """Rows of other scenes in the folder are kept, with their commits."""
    assert stored_rows(tmp_path, pixels=20) == []
    first = [row("gdi", commit="a"), row("imported", commit="b", held="parcels")]
    part = budget_part(first, pixels=20, references_K={"gdi": 0.1}, missing=[])
    (tmp_path / "budget.json").write_text(json.dumps(part.data), encoding="utf-8")
    assert stored_rows(tmp_path, pixels=20) == first
    assert stored_rows(tmp_path, pixels=100) == []
    assert "at commits a, b" in part.text[-1] and "2 core-min" in part.text[0]
    assert [one[5] for one in part.tables[0].rows] == ["-", "parcels"]


def test_page_of_rows() -> None:
    """A sum with an unknown error source is a lower bound."""
    causes = {"trace": 0.3, "gas grid": None}
    rows = [
        BudgetRow("gdi", 1.0, 0.9, False, 0.8, 20.0, 11.0, {"trace": 0.3}),
        BudgetRow("methane-jet", 1.0, 2.0, True, 2.5, 60.0, 40.0, causes),
    ]
    part = budget_part(rows, pixels=20, references_K={"gdi": 0.1}, missing=["even-grid"])
    (first,) = part.tables
    assert first.rows[0][2:] == ("0.9", "0.8", "1.1", "-", "20")
    assert first.rows[1][2] == "at least 2"
    assert part.figure is not None and "even-grid" in part.text[-1]


def test_page_of_seeds() -> None:
    """Ranges over the seeds."""
    rows = [
        BudgetRow("gdi", 1.0, 0.9, False, 0.6, 20.0, 11.0, {"trace": 0.3}),
        BudgetRow("gdi", 1.0, 0.8, False, 0.8, 21.0, 12.0, {"trace": 0.2}, seed=2),
        BudgetRow("methane-jet", 1.0, None, True, 2.5, 60.0, 40.0, {"trace": None}),
        BudgetRow("methane-jet", 1.0, 2.0, True, 2.5, 60.0, 40.0, {"trace": 0.2}, seed=2),
    ]
    part = budget_part(rows, pixels=20, references_K={"gdi": 0.1}, missing=[])
    (seeds,) = part.tables
    assert seeds.rows[0] == ("gdi", "1", "0.8 to 0.9", "0.6 to 0.8", "1 to 1.5", "-", "20 to 21")
    assert seeds.rows[1][2:5] == ("unknown", "2.5", "unknown")
    assert "2 seeds" in part.text[0]


def test_what_was_measured_is_kept_after_each_accuracy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The third accuracy fails; the page of the first two is there."""
    kept: list[Part] = []
    said: list[str] = []

    def measured(scene: Scene, *_: Any, asked_K: float, **__: Any) -> BudgetRow:
        if asked_K == 0.5:
            raise BenchError("the disk is full")
        return BudgetRow(
            "even-grid", asked_K, 0.9, False, 0.6, 20.0, 10.0, {}, seed=scene.transport.seed
        )

    monkeypatch.setattr(module, "simulate", lambda *_, **__: None)
    monkeypatch.setattr(module, "measure", measured)
    device: Any = None
    with pytest.raises(BenchError):
        budget(
            device,
            cache=tmp_path,
            say=said.append,
            save=kept.append,
            scenes=["even-grid"],
            asked_K=[2.0, 1.0, 0.5],
            seeds=2,
        )
    assert [len(part.tables[0].rows) for part in kept] == [1, 2]
    assert [row[1] for row in kept[-1].tables[0].rows] == ["2", "1"]
    assert said[-1] == "even-grid, 1 K asked, seed 2: 0.9 K stated, 0.6 K true, 20 core-s"
