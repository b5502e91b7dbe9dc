"""The simulated bench with several spectral nodes: what it records, against sums by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from cldit.acquisition import plan_from_scene
from cldit.acquisition.record import open_acquisition
from cldit.acquisition.runner import acquire
from cldit.dit.recorded import evaluate_shots
from cldit.optics.planck import band_radiance
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.run.stored_files import save_nodes
from cldit.scene import Scene, dump_scene, parse_scene
from drivers.simulated_scene import SceneSettings, _Loaded
from tests.conftest import tiny_weights


def test_the_rig_sees_every_wavelength(tiny_scene: Scene, tmp_path: Path) -> None:
    """Two nodes, one of which the spray blocks and the other passes: the simulated rig records
    what a sum by hand says, with and without scatter from shot to shot.

    In the middle of the blob only node 1 comes through, so that the emissivity is the share that
    node 0 has of the difference of two backgrounds; a bench that saw one node alone would find 0
    or 1.
    """
    data = tiny_scene.model_dump(mode="json")
    data["background"]["temperatures_K"] = [440.0, 500.0, 560.0]
    data["rig"]["shot_scatter"] = 0.0
    data["plan"] = {"shots": 4, "references": 4}
    scene = parse_scene(data)
    filter_um = scene_filter(scene)
    split = Quadrature(filter_um, (3.3, 3.37, 3.5), ((1.0, 0.0), (0.0, 1.0)), 500.0)
    bare, blob = tiny_weights(scene, depth=0.0), tiny_weights(scene, depth=30.0)
    share = np.float32(split.nodes[0].share(370.0))
    glow = [replace(blob, vapour=blob.vapour * share, liquid=blob.liquid * share), bare]
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "scene.yaml").write_text(dump_scene(scene), encoding="utf-8")
    blob.save(folder / "weights", pixel_m=(5e-3, 5e-3))
    bare.save(folder / "weights_reference", pixel_m=(5e-3, 5e-3))
    save_nodes(folder / "weights", split, glow, pixel_m=(5e-3, 5e-3))
    with open_rig(simulated_rig_data(scene, folder)) as rig:
        acquire(rig, plan_from_scene(scene), tmp_path / "shots")
    maps = evaluate_shots(open_acquisition(tmp_path / "shots")).maps
    ends = np.array([440.0, 560.0])
    slopes = [
        np.diff(f(ends))[0]
        for f in (split.nodes[0].radiance, partial(band_radiance, filter_um=filter_um))
    ]
    middle = (slice(5, 7), slice(7, 9))  # of 12 x 16, where depth 30 lets nothing through
    expected = slopes[0] / slopes[1]
    assert 0.2 < expected < 0.6
    error = maps.emissivity_standard_error[middle]
    assert np.all(np.abs(maps.emissivity[middle] - expected) < 5 * error)
    assert float(error.max()) < 0.02


def test_scatter_changes_each_wavelength_by_its_own_depth(
    tiny_scene: Scene, tmp_path: Path
) -> None:
    """One factor for the optical depth: a node that the spray passes stays as it is."""
    split = Quadrature(scene_filter(tiny_scene), (3.3, 3.37, 3.5), ((1.0, 0.0), (0.0, 1.0)), 460.0)
    bare, blob = tiny_weights(tiny_scene, depth=0.0), tiny_weights(tiny_scene, depth=1.0)
    (tmp_path / "scene.yaml").write_text(dump_scene(tiny_scene), encoding="utf-8")
    blob.save(tmp_path / "weights", pixel_m=(5e-3, 5e-3))
    bare.save(tmp_path / "weights_reference", pixel_m=(5e-3, 5e-3))
    save_nodes(tmp_path / "weights", split, (blob, bare), pixel_m=(5e-3, 5e-3))
    loaded = _Loaded.read(tmp_path, SceneSettings(run=tmp_path))
    shot = loaded.shot(np.random.default_rng(1))
    np.testing.assert_array_equal(shot[1].background, loaded.reference.background)
    off = np.abs(shot[0].background - loaded.spray[0].background)
    assert float(off.max()) > 0.005
