"""Classes of droplet size from a spray's parcels to what the octree takes in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.prepare.medium import properties_of
from cldit.prepare.phases import in_classes, sizes_left
from cldit.scene import Scene, parse_scene
from cldit.spray.result import Parcels, Spray
from cldit.transport.phase import SizeClasses
from cldit.transport.size_classes import TOLERATED
from tests.phase_tables import henyey_greenstein

COUNT = 400


def scene_of(phase: str = "mie") -> Scene:
    return parse_scene(
        {
            "name": "two sizes",
            "spray": {"model": "none"},
            "domain": {"edge_m": 0.1, "leaf_edge_m": 0.02},
            "optics": {"preset": "paper"},
            "transport": {"phase": phase},
        }
    )


def spray_of(*, apart: bool) -> Spray:
    """Droplets of 2 um and of 18 um: on two sides, or a pair of both at each place."""
    rng = np.random.default_rng(1)
    place = rng.uniform(-0.02, 0.02, (COUNT, 3))
    large = place[:, 0] > 0 if apart else np.arange(COUNT) % 2 == 0
    return Spray(
        parcels=Parcels(
            position_m=place if apart else np.repeat(place[::2], 2, axis=0),
            diameter_m=np.where(large, 18e-6, 2e-6),
            droplets=np.where(large, 1e3, 1e5),
            temperature_K=np.full(COUNT, 350.0),
            density_kg_m3=np.full(COUNT, 640.0),
        )
    )


def test_sizes_apart_are_in_classes(tmp_path: Path) -> None:
    spray = spray_of(apart=True)
    found = properties_of(scene_of(), spray, cache=tmp_path)
    (phase,), ((points, _),) = found.phases, found.sources
    assert phase is not None and phase.classes is not None and points is not None
    assert found.phase.endswith("2 classes of size") and found.remarks == ()
    assert spray.parcels is not None
    (of_large,) = points.class_scattering_m2
    large = spray.parcels.diameter_m > 1e-5
    np.testing.assert_array_equal(of_large, np.where(large, points.scattering_m2, 0.0))
    small_g, large_g = (table.asymmetry for table in phase.tables)
    share = of_large.sum() / points.scattering_m2.sum()
    mean = small_g * (1 - share) + large_g * share
    assert phase.asymmetry == pytest.approx(mean, abs=1e-9)
    again = properties_of(scene_of(), spray, cache=tmp_path)  # from the kept table
    assert again.phases[0] is not None
    np.testing.assert_array_equal(again.phases[0].tables[1].cumulative, phase.tables[1].cumulative)


def test_sizes_mixed_alike_are_in_one() -> None:
    found = properties_of(scene_of(), spray_of(apart=False), cache=None)
    (phase,), ((points, _),) = found.phases, found.sources
    assert phase is not None and phase.classes is None and points is not None
    assert points.class_scattering_m2 == () and "classes" not in found.phase


def test_without_classes_points_stay_as_they_are() -> None:
    spray = spray_of(apart=True)
    found = properties_of(scene_of("isotropic"), spray, cache=None)
    ((points, _),) = found.sources
    assert points is not None and points.class_scattering_m2 == ()
    assert in_classes(points, spray, henyey_greenstein(0.5)) is points
    assert in_classes(None, spray, None) is None


def test_what_classes_leave_is_said() -> None:
    tables = henyey_greenstein(0.5), henyey_greenstein(0.9)
    for left, said in ((TOLERATED, 0), (0.034, 1)):
        phase = henyey_greenstein(0.7)
        classes = SizeClasses(np.array([5e-6]), tables, left)
        remarks = sizes_left([None, type(phase)(phase.cosine, phase.cumulative, classes)])
        assert len(remarks) == said
    assert "leave a difference of 0.034 between places" in remarks[0]
