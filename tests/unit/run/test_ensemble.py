"""The mean of several injections: its light, its statistics, its folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.camera.curve import Curve
from cldit.comparison import difference
from cldit.comparison.shared import _same_parts
from cldit.gpu.device import Device
from cldit.optics.response import scene_filter
from cldit.run import open_run, simulate
from cldit.run.ensemble import ensemble_run
from cldit.run.result import Run
from cldit.scene import Scene, load_scene
from cldit.scene.scatter import member
from cldit.show.report.run_report import _figures

_MEMBERS = 5


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Droplets alone, on coarse cells: half a second a trace."""
    return load_scene("droplets-only").with_(
        **{
            "camera.pixels": [24, 24],
            "camera.rays_per_pixel": 1,
            "domain.leaf_edge_m": 4e-3,
            "spray.spacing_m": 2e-3,
            "spray.scatter": {"members": _MEMBERS, "start_s": 1e-4, "mass": 0.2},
            "transport.audit": False,
        }
    )


@pytest.fixture(scope="module")
def made(
    scene: Scene, device: Device, tables: Path, tmp_path_factory: pytest.TempPathFactory
) -> Run:
    folder = tmp_path_factory.mktemp("ensemble") / "run"
    return simulate(scene, folder, device=device, cache=tables)


def _members(run: Run) -> list[Run]:
    assert run.folder is not None
    return [open_run(run.folder / "members" / f"{n:04d}") for n in range(1, _MEMBERS + 1)]


def test_it_is_the_mean_light(made: Run, scene: Scene) -> None:
    """T_app by hand from the members' light, to the rounding of weights in float32."""
    curve = Curve(filter_um=scene_filter(scene))
    each = _members(made)
    assert [run.scene for run in each] == [member(scene, n) for n in range(1, _MEMBERS + 1)]
    wall = float(curve.radiance(scene.walls.temperature_K))
    gone = np.mean([1.0 - run.weights.background.astype(float) for run in each], axis=0)
    light = np.mean(
        [run.weights.wall.astype(float) * wall + run.weights.vapour + run.weights.liquid
         for run in each], axis=0)  # fmt: skip
    here = made.maps.has_temperature
    assert here.sum() > 20
    expected_K = curve.temperature(light[here] / gone[here])
    assert made.maps.apparent_temperature_K[here] == pytest.approx(expected_K, abs=0.02)


def test_its_statistics(made: Run) -> None:
    """Means and deviations over the members, and the error of the mean light by the jackknife.

    The jackknife of a ratio differs from the linear error in second order: both agree to the square
    of the relative deviation of the members' emissivity (0.22 here, weighted as the errors are;
    found: 0.13), where all have a T_app.
    """
    each = _members(made)
    kelvin = np.array([run.maps.apparent_temperature_K for run in each], float)
    seen = np.array([run.maps.has_temperature for run in each])
    found = made.ensemble
    assert found is not None and found.members == _MEMBERS
    assert np.array_equal(np.nan_to_num(found["injections"]), seen.sum(axis=0))
    every = seen.all(axis=0) & made.maps.has_temperature
    assert every.sum() > 12
    shown = found["apparent_temperature_mean_K"][every]
    assert shown == pytest.approx(kelvin.mean(axis=0)[every], abs=1e-3)
    spread = kelvin.std(axis=0, ddof=1)[every]
    assert found["apparent_temperature_deviation_K"][every] == pytest.approx(spread, abs=2e-3)
    emissivity = np.array([run.maps.emissivity for run in each], float)
    assert found["emissivity_standard_error"][every] == pytest.approx(
        emissivity.std(axis=0, ddof=1)[every] / np.sqrt(_MEMBERS), abs=1e-5
    )
    curve = Curve(filter_um=made.quadrature.filter_um)
    own = emissivity * curve.radiance(np.nan_to_num(kelvin, nan=300.0))
    without = np.array(
        [curve.temperature(np.delete(own, n, axis=0).sum(axis=0)[every]
                           / np.delete(emissivity, n, axis=0).sum(axis=0)[every])
         for n in range(_MEMBERS)])  # fmt: skip
    jackknife = np.sqrt((_MEMBERS - 1) * without.var(axis=0))
    stated = found["apparent_temperature_standard_error_K"][every].astype(float)
    varied = emissivity.std(axis=0, ddof=1)[every] / emissivity.mean(axis=0)[every]
    second = float(np.average(varied**2, weights=stated**2))
    assert np.mean(stated**2) == pytest.approx(np.mean(jackknife**2), rel=second)
    few = seen.sum(axis=0) < 2
    assert np.isnan(found["apparent_temperature_standard_error_K"][few]).all()


def test_equal_injections_have_no_deviation(scene: Scene, made: Run) -> None:
    """Members that are all one run: its maps, to float32, and no deviation."""
    (one, *_) = _members(made)
    run = ensemble_run(scene, None, None, trace=lambda scene, folder, like: one)
    assert run.maps.apparent_temperature_K == pytest.approx(
        one.maps.apparent_temperature_K, abs=1e-3, nan_ok=True
    )
    assert run.ensemble is not None
    figures = run.ensemble.figures(run.maps)
    assert figures and max(figures.values()) < 5e-3


def test_nodes_that_differ_are_said(scene: Scene, made: Run) -> None:
    """Another choice of wavelengths in a member leaves one node, and a remark."""
    one, two, *_ = _members(made)
    split = replace(two.quadrature, reference_K=two.quadrature.reference_K + 1.0)
    runs = iter([one, one, replace(two, quadrature=split), one, one, one])
    run = ensemble_run(scene, None, None, trace=lambda scene, folder, like: next(runs))
    assert len(run.spectral) == 1 and "different wavelengths" in run.info.remarks[-1]


def test_it_continues_where_it_stopped(made: Run, device: Device, tables: Path) -> None:
    """Without its last file and one member, that member alone is traced again."""
    assert made.folder is not None
    lost = made.folder / "members" / "0003" / "run.json"
    kept = made.folder / "members" / "0002" / "run.json"
    before = kept.stat().st_mtime_ns
    lost.unlink()
    (made.folder / "run.json").unlink()
    again = simulate(made.scene, made.folder, device=device, cache=tables)
    assert lost.is_file() and kept.stat().st_mtime_ns == before
    assert made.ensemble is not None and again.ensemble is not None
    read = open_run(made.folder)
    assert read.ensemble is not None
    for name, image in made.ensemble.maps.items():
        assert again.ensemble[name] == pytest.approx(image, nan_ok=True, abs=2e-2, rel=1e-3)
        assert np.array_equal(read.ensemble[name], again.ensemble[name], equal_nan=True)


def test_its_maps_are_labelled_and_drawn(made: Run) -> None:
    data = made.to_xarray()
    found = data["ensemble_apparent_temperature_deviation_K"]
    assert found.dims == ("z", "x") and found.attrs["units"] == "K"
    assert found.attrs["long_name"] == "apparent temperature deviation of 5 injections"
    captions = {name: caption for name, _, caption in _figures(made)}
    assert "standard deviation of one injection" in captions["injections"]


def test_a_mean_and_its_nominal_injection_have_one_spray(made: Run) -> None:
    """Their difference does not contain the errors of cells and size classes."""
    assert made.folder is not None
    nominal = open_run(made.folder / "nominal")
    assert {"spray", "classes", "cells"} <= _same_parts(made, nominal)
    assert made.rays is not None and made.rays.shape == (24, 24)  # the mean of all injections
    assert "spray" not in _same_parts(made, _members(made)[0])


@pytest.mark.slow
def test_two_ensembles_are_compared_by_permutation(
    scene: Scene, made: Run, device: Device, tables: Path, tmp_path: Path
) -> None:
    """5 and 5 injections have 252 divisions: 2 / 252 if the sides lie apart, here by the fuel."""
    others = {"spray.scatter.seed": 2}
    warmer = {**others, "spray.fuel_temperature_K": scene.spray.fuel_temperature_K + 40.0}  # type: ignore[union-attr]
    found = [
        difference(
            made, simulate(scene.with_(**values), tmp_path / name, device=device, cache=tables)
        )
        for name, values in (("same", others), ("warmer", warmer))
    ]
    assert found[0].injections_p is not None and found[0].injections_p > 0.01
    assert found[0].p_value == found[0].injections_p and found[0].within
    assert found[1].injections_p == pytest.approx(2 / 252)
    assert found[1].verdict.differs
    assert found[1].verdict.keys[0].key == "spray.fuel_temperature_K"
