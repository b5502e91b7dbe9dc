"""Recordings of a run by the simulated rig, in memory: many seeds in a second each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cldit.camera.sensor import SensorModel
from cldit.comparison.shown import Shown, recorded
from cldit.dit.recorded import evaluate_shots
from cldit.radiance.boundary import Surroundings, camera_radiance
from cldit.radiance.weights import Weights
from cldit.run import Run
from cldit.run.ensemble import member_folder
from drivers.simulated_scene import SceneSettings, _Loaded
from tests.verify.evaluation_bias import Recorded, Shot

READING_K = 0.02  # noise of the black body's reading


def recording(run: Run, *, seed: int) -> Shown:
    """Evaluated recording of a run: shots with scatter of the spray, camera and readings.

    Each shot of an ensemble is one of its injections, drawn at random.
    """
    assert run.folder is not None
    bench = _Loaded.read(run.folder, SceneSettings(run=run.folder))
    drawn = range(0 if run.ensemble is None else run.ensemble.members)
    members = [member_folder(run.folder, 1 + number) for number in drawn]
    sprays = [_Loaded.read(one, SceneSettings(run=one)) for one in members] or [bench]
    rng = np.random.default_rng(seed)
    bare = [bench.reference] * len(bench.boundaries)
    backgrounds_K = run.scene.background.temperatures_K
    hottest = camera_radiance(bare, bench.boundaries, background_K=max(backgrounds_K))
    sensor = replace(SensorModel.from_scene(run.scene), bad_pixel_count=0)
    sensor = sensor.exposed_for(float(hottest.max()))
    shots: list[Shot] = []
    for background_K in backgrounds_K:
        for kind, count in (
            ("reference", run.scene.plan.references),
            ("injection", run.scene.plan.shots),
        ):
            for number in range(count):
                weights: Sequence[Weights] = bare
                if kind == "injection":
                    weights = sprays[rng.integers(len(sprays)) if drawn else 0].shot(rng)
                light = camera_radiance(weights, bench.boundaries, background_K=background_K)
                shots.append(
                    Shot(
                        id=f"{background_K:g}-{kind}-{number}",
                        kind=kind,
                        background_setpoint_K=background_K,
                        background_K=background_K + READING_K * rng.standard_normal(),
                        image=sensor.expose(np.maximum(light, 0.0), rng),
                        time_s=float(len(shots)),
                    )
                )
    found = evaluate_shots(
        Recorded(shots, Surroundings.from_scene(run.scene), sensor.calibration().to_dict())
    )
    assert found.budget is not None
    x, _, z = run.scene.target_m
    return recorded(
        f"recording {seed}",
        found.maps,
        bench.pixel_m,
        (x, z),
        parts=((), found.budget.common),
        degrees=found.degrees_of_freedom,
        traced=run,
    )
