"""The list of error sources: keys that fix them, and what a free one must have."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

import cldit
from cldit.accuracy.predict import told_before_cells
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.scene import Scene, load_scene


def with_key(key: str, value: Any) -> Scene:
    """Scene gdi, resolved by wavelengths, on cells of its own, with one more key."""
    given = {"optics.preset": "spectral", "domain.leaf_edge_m": 2e-3, key: value}
    return load_scene("gdi-cone").with_(**given)


def test_names_are_unique() -> None:
    names = [name for one in SOURCES for name in (one.name, *one.also)]
    assert len(set(names)) == len(names)
    assert all("" in one.remedy for one in SOURCES)


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        ("cells", "domain.leaf_edge_m", 1e-3),
        ("trace", "transport.directions", 16),
        ("wavelengths", "optics.wavelengths", 4),
        ("wavelengths", "optics.spectral_error_K", 0.5),
        ("size classes", "spray.size_classes", 4),
        ("gas grid", "spray.spacing_m", 1e-3),
    ],
)
def test_a_key_fixes_its_source_alone(name: str, key: str, value: Any) -> None:
    without, fixed = with_key(key, None), with_key(key, value)
    source = BY_NAME[name]
    assert source.is_free(without) and source.key(without) == ""
    assert not source.is_free(fixed) and source.key(fixed) == key
    for other in SOURCES:
        if other is not source and key != "domain.leaf_edge_m":  # the lattice follows free cells
            assert other.is_free(without) == other.is_free(fixed)


@pytest.mark.parametrize(
    ("name", "key", "values"),
    [
        ("trace", "transport.directions", (None, 16)),
        ("wavelengths", "optics.wavelengths", (None, 4)),
        ("pixel sampling", "camera.rays_per_pixel", ("auto", 1)),
        ("cells", "domain.leaf_edge_m", (None, 1e-3)),
    ],
)
def test_what_a_key_fixes_is_told_before_the_cells(name: str, key: str, values: Any) -> None:
    """Not the cells themselves, nor a source that waits for its share."""
    source = BY_NAME[name]
    free, fixed = (SimpleNamespace(scene=with_key(key, given)) for given in values)
    assert not told_before_cells(source, free)  # type: ignore[arg-type]
    assert told_before_cells(source, fixed) == (name != "cells")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", cldit.shipped_scenes())
def test_every_free_source_can_be_refined(name: str) -> None:
    scene = load_scene(name)
    first = Resolution.first(scene, ordinates_K=4.0, spectral_K=0.5).at_depth(6)
    for source in SOURCES:
        if source.is_free(scene):
            assert source.cost_power > 0.0 and source.key(scene) == ""
            assert source.finer(first, share_K=0.25, ratio=2.0, order=1.0) != first
