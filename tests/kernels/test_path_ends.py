"""Path tracing ends after a number of scatterings, and counts the paths that do."""

from __future__ import annotations

from typing import Any

import numpy as np

from cldit.gpu.device import Device
from cldit.transport.trace import Trace, trace
from cldit.transport.tuning import Tuning

from .medium import random_tree, scene_of, settings_of


def traced(device: Device, scatterings: int, **changed: Any) -> Trace:
    tuning = Tuning(path_scatterings=scatterings, audit_samples_least=128)
    usual = {"method": "path", "max_samples": 128, "accuracy_K": 0.01, "audit": True}
    settings = settings_of(**{**usual, "tuning": tuning, **changed})
    return trace(random_tree(6, scattering=30.0), scene_of(), device, settings)


def test_paths_that_end_are_counted(device: Device) -> None:
    """They see the wall, so that energy is conserved; others are not counted."""
    whole, cut = traced(device, 2**20), traced(device, 3)
    assert not whole.short
    paths = cut.counts["samples"] * cut.counts["pixels"]
    ended = int(cut.short.split()[2])
    assert f"of {paths} paths ended after 3 scatterings" in cut.short
    assert 0 < ended < paths
    assert cut.closure is not None and abs(cut.closure.mean) < cut.closure.bound
    assert np.sum(cut.weights.wall) > np.sum(whole.weights.wall)


def test_an_audit_of_paths_that_end_is_none(device: Device) -> None:
    result = traced(device, 3, method="source")
    assert result.audit is None
    assert "paths ended after 3 scatterings" in result.unaudited


def test_an_order_is_no_such_end(device: Device) -> None:
    assert not traced(device, 2**20, order=2).short
