"""Keys that leave physics out are stated as errors, within a factor of two of the truth."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.accuracy.errors import Cause
from cldit.accuracy.sources import SOURCES
from cldit.accuracy.sources.omissions import Omission
from cldit.scene import load_scene

OMISSIONS = [source for source in SOURCES if isinstance(source, Omission)]
PIXELS = 32


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds a scattering ball of 16^3 voxels, densest in its middle, cooler on one side."""
    made = tmp_path_factory.mktemp("grid")
    x = (np.arange(16) + 0.5) / 16 - 0.5
    r2 = x[:, None, None] ** 2 + x[:, None] ** 2 + x**2
    extinction = 60.0 * np.exp(-r2 / 0.18**2)
    np.savez(
        made / "ball.npz",
        origin_m=np.full(3, -0.05),
        spacing_m=np.full(3, 0.1 / 16),
        droplet_absorption_per_m=0.1 * extinction,
        droplet_scattering_per_m=0.9 * extinction,
        droplet_temperature_K=np.where(r2 + x[:, None, None] > 0, 420.0, 360.0),
    )
    return made


def scene_run(folder: Path, **transport: Any) -> Any:
    """A run of the ball between cold walls."""
    scene = {
        "name": "ball",
        "spray": {"model": "grid", "file": str(folder / "ball.npz")},
        "camera": {
            "pixels": [PIXELS] * 2,
            "field_m": [0.13, 0.13],
            "target_m": [0.0, 0.0, 0.0],
            "rays_per_pixel": 1,
        },
        "background": {"radius_m": 0.09, "temperatures_K": [350.0, 450.0]},
        "walls": {"temperature_K": 200.0},
        "domain": {"edge_m": 0.2},
        "transport": transport,
    }
    run = cldit.simulate(cldit.Scene.from_dict(scene))
    assert run.errors is not None
    return run


@cache
def traced(folder: Path, **transport: Any) -> tuple[Any, dict[str, Cause]]:
    """T_app of the ball, NaN where there is none, and the causes by name."""
    run = scene_run(folder, **transport)
    seen = np.where(run.maps.has_temperature, run.maps.apparent_temperature_K, np.nan)
    return seen, {one.name: one for one in run.errors.causes}


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        pytest.param("orders of scattering", "order", 0, marks=pytest.mark.slow),
        ("orders of scattering", "order", 3),
        ("cutoff of rays", "cutoff", 0.5),
        pytest.param("sources within cells", "gather", False, marks=pytest.mark.slow),
    ],
)
def test_what_a_key_leaves_out_is_stated(folder: Path, name: str, key: str, value: Any) -> None:
    whole, others = traced(folder)
    assert name not in others
    less, causes = traced(folder, **{key: value})
    true_K = float(np.sqrt(np.nanmean((less - whole) ** 2)))
    assert causes[name].fixed == f"transport.{key}"
    stated_K = causes[name].error_K
    assert true_K > 0.1 and stated_K is not None
    assert 0.5 < stated_K / true_K < 2.0, (causes[name], true_K)


def test_the_audit_and_a_key_do_not_count_twice(folder: Path) -> None:
    """`path` follows rays to a cutoff of its own, so that the audit sees the error as well."""
    causes = traced(folder, cutoff=0.5)[1]
    assert causes["trace"].error_K is not None and causes["cutoff of rays"].error_K is not None
    assert causes["trace"].error_K < 0.8 * causes["cutoff of rays"].error_K  # else 1.1 or more


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("transport.order", 0),
        ("transport.cutoff", 1e-3),
        ("transport.gather", False),
        ("domain.optical_depth_split", 1e-2),
    ],
)
def test_only_a_key_that_omits_more_is_a_source(key: str, value: Any) -> None:
    split = {"domain.optical_depth_split": 1e-7}  # more cells of vapour
    for keys, expected in (({}, []), (split, []), ({key: value}, [key])):
        scene = load_scene("gdi-cone").with_(**keys)
        assert [source.key(scene) for source in OMISSIONS if source.key(scene)] == expected


@pytest.mark.slow
def test_wavelengths_that_are_not_traced_make_it_a_lower_bound() -> None:
    """Methane is clear where most of the light is, and opaque at the other wavelength."""
    given = {"camera.pixels": [32, 32], "transport.cutoff": 0.3, "transport.accuracy_K": 2.0}
    run = cldit.simulate(load_scene("methane-jet").with_(**given))
    assert run.errors is not None
    assert "cutoff of rays at other wavelengths" in run.errors.unknown
    assert run.errors.text.startswith("at least")


@pytest.mark.slow
def test_the_phase_function_is_in_the_spread_of_the_model(folder: Path) -> None:
    """Against isotropic scattering; unknown where droplets are coefficients without diameters."""
    phase = {"henyey_greenstein": 0.8}
    even, _ = traced(folder)
    run = scene_run(folder, phase=phase)
    seen = np.where(run.maps.has_temperature, run.maps.apparent_temperature_K, np.nan)
    true_K = float(np.sqrt(np.nanmean((seen - even) ** 2)))
    found = {one.name: one for one in run.errors.model}["phase function"]
    assert found.error_K == pytest.approx(true_K, rel=0.25) and true_K > 1.0
    assert "g 0.8 against isotropic" in found.how
    (unknown,) = (one for one in scene_run(folder).errors.model if one.name == "phase function")
    assert unknown.error_K is None and "without diameters" in unknown.how
