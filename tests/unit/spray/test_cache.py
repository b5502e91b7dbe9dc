"""Computed sprays are kept by what they were made from, and come back bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.scene.spray import LagrangianSpray
from cldit.spray.cache import cached_spray, times_together
from cldit.spray.result import Cells, Parcels, Spray, Vapour

Make = Callable[[tuple[float, ...]], Iterator[Spray]]


def maker(asked: list[tuple[float, ...]], fails_at: float | None = None) -> Make:
    def make(times_s: tuple[float, ...]) -> Iterator[Spray]:
        asked.append(times_s)
        for time_s in times_s:
            if time_s == fails_at:
                raise SprayError("no")
            yield _spray()

    return make


def _spray() -> Spray:
    """Two droplets' parcels, and vapour in three of a grid's 24 voxels."""
    rng = np.random.default_rng(1)
    cells = Cells.regular(
        origin_m=np.array([-0.01, -0.01, -0.03]),
        spacing_m=np.full(3, 1e-3 / 3),
        shape=(2, 3, 4),
        index=np.array([1, 7, 23]),
    )
    parcels = Parcels(
        position_m=rng.normal(size=(2, 3)) * 1e-3,
        diameter_m=np.array([9e-6, 4e-6]),
        droplets=np.array([1e4, 3.3e3]),
        temperature_K=np.array([370.0, 351.7]),
        density_kg_m3=np.array([616.0, 633.1]),
    )
    vapour = Vapour(cells, np.array([1e24, 2e23, 1e20]), np.array([400.0, 500.0, 570.0]), 0.1002)
    return Spray(parcels=parcels, vapour=vapour, notes={"liquid_mass_kg": 1e-9}, remarks=("so",))


def test_computed_once(tmp_path: Path) -> None:
    made: list[tuple[float, ...]] = []
    make = maker(made)
    spec = LagrangianSpray()
    first = cached_spray(spec, tmp_path, make)
    again = cached_spray(spec, tmp_path, make)
    assert len(made) == 1
    assert again.parcels is not None and again.vapour is not None
    assert first.parcels is not None and first.vapour is not None
    np.testing.assert_array_equal(again.parcels.position_m, first.parcels.position_m)
    np.testing.assert_array_equal(again.vapour.cells.lower_m, first.vapour.cells.lower_m)
    assert (again.notes, again.remarks) == (first.notes, first.remarks)
    cached_spray(spec.model_copy(update={"seed": 2}), tmp_path, make)
    assert len(made) == 2
    cached_spray(spec, None, make)
    assert len(made) == 3


def test_damaged_file_is_made_anew(tmp_path: Path) -> None:
    cached_spray(LagrangianSpray(), tmp_path, maker([]))
    (file,) = (tmp_path / "sprays").glob("*.npz")
    file.write_bytes(file.read_bytes()[:100])
    assert cached_spray(LagrangianSpray(), tmp_path, maker([])).parcels is not None
    assert file.stat().st_size > 100


def test_what_fails_is_not_kept(tmp_path: Path) -> None:
    make = maker([], fails_at=LagrangianSpray().time_s)
    with pytest.raises(SprayError, match="no"):
        cached_spray(LagrangianSpray(), tmp_path, make)
    assert not list((tmp_path / "sprays").glob("*.npz"))


def test_times_of_a_series_are_made_together(tmp_path: Path) -> None:
    made: list[tuple[float, ...]] = []
    specs = [LagrangianSpray(time_s=time_s) for time_s in (3e-4, 1e-4, 2e-4)]
    cached_spray(specs[2], tmp_path, maker(made))
    with times_together([3e-4, 1e-4, 2e-4]):
        for spec in (*specs, LagrangianSpray(time_s=5e-4)):
            cached_spray(spec, tmp_path, maker(made))
    assert made == [(2e-4,), (1e-4, 3e-4), (5e-4,)]


def test_a_later_time_that_fails_is_refused_when_asked_for(tmp_path: Path) -> None:
    made: list[tuple[float, ...]] = []
    with times_together([1e-4, 2e-4]):
        early = cached_spray(LagrangianSpray(time_s=1e-4), tmp_path, maker(made, 2e-4))
        assert early.parcels is not None
        with pytest.raises(SprayError, match="no"):
            cached_spray(LagrangianSpray(time_s=2e-4), tmp_path, maker(made, 2e-4))
    assert made == [(1e-4, 2e-4), (2e-4,)]
