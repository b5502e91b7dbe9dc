"""Recordings of a spray against models that differ in one thing: is it named, and where.

python -m tests.bench named_changes gdi-cone
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cldit.comparison import Difference, difference
from cldit.comparison.rivals import rivals_of
from cldit.dit.design import BlackBody, shot_time_s
from cldit.errors import ClditError
from cldit.rig.protocols import Stability
from cldit.run import Run, simulate
from cldit.scene import Scene, load_scene
from cldit.scene.spray import ConeSpray, LagrangianSpray
from tests.verify.recordings import recording

SCATTER = {"spray.scatter.start_s": 30e-6, "spray.scatter.mass": 0.05}
EVAPORATIONS = "spalding", "frolov-type", "dukowicz"  # against abramzon-sirignano
EXPOSED = "camera.exposure", "camera.sensor.integration_time_s"


def changes(scene: Scene) -> dict[str, tuple[bool, Mapping[str, Any]]]:
    """Values by name of the change; True: of the recorded spray, and the model is plain."""
    spray = scene.spray
    assert isinstance(spray, (ConeSpray, LagrangianSpray))
    heavier, warmer = 1.1 * spray.injected_mass_kg, spray.fuel_temperature_K + 10.0
    evaporations = EVAPORATIONS if isinstance(spray, LagrangianSpray) else (False,)
    return {
        "nothing": (False, {}),
        "mass + 10 %": (False, {"spray.injected_mass_kg": heavier}),
        "fuel + 10 K": (False, {"spray.fuel_temperature_K": warmer}),
        **{f"evaporation {one}": (False, {"spray.evaporation": one}) for one in evaporations},
        "exposure 25 us": (True, dict(zip(EXPOSED, ("times", 25e-6), strict=True))),
        "exposure 100 us": (True, dict(zip(EXPOSED, ("times", 100e-6), strict=True))),
    }


def needed(data: Run, model: Run, cache: Path) -> str:
    """Number of injections that would separate the data from the model, or why none would."""
    known_K, rig = data.scene.background.temperatures_K, data.scene.rig
    blackbody = BlackBody(
        limits_K=(min(known_K), max(known_K)),
        start_K=rig.background_start_K,
        time_constant_s=rig.background_time_constant_s,
        stability=Stability(),
    )
    try:
        pair = rivals_of(data, model, lambda scene, like: simulate(scene, cache=cache, like=like))
        return pair.best(blackbody, shot_s=shot_time_s(data.scene)).text
    except ClditError as error:
        return str(error)


def line(name: str, true: Difference, found: Sequence[Difference]) -> str:
    """Change of T_app by region without noise, and how often recordings tell it, and where."""
    kelvin = ", ".join(
        f"{where} {region.rms:.2g}"
        for where, region in true.regions.items()
        if region.rms is not None
    )
    parts = {where: sum(where in one.where for one in found) for where in true.regions}
    named = ", ".join(f"{where} {count}" for where, count in parts.items() if count)
    p = np.median([one.regions["all"].p_value or 0.0 for one in found])
    return (
        f"{name}: {kelvin} K; median p of all {p:.2g}; status 3 in "
        f"{sum(not one.within for one in found)} of {len(found)}; named: {named or '-'}"
    )


def main() -> None:
    """Traces a scene and its variants, records each several times, and prints a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gdi-cone")
    parser.add_argument("--accuracy", type=float, default=2.0, help="of every trace, K")
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("runs/named-changes"))
    parser.add_argument("--members", type=int, default=1, help="injections that differ")
    parser.add_argument("--only", default="", help="changes whose name contains it")
    given = parser.parse_args()
    pixels = [given.pixels, given.pixels]
    plain = load_scene(given.scene).with_(
        **{
            "camera.sensor.pixels": pixels,
            "camera.pixels": pixels,
            "transport.accuracy_K": given.accuracy,
            "plan.shots": 5,
            "plan.references": 5,
            "background.temperatures_K": [413.0, 443.0, 473.0, 503.0, 533.0],
        }
    )
    if given.members > 1:
        plain = plain.with_(**SCATTER, **{"spray.scatter.members": given.members})
    others = {"spray.scatter.seed": 2} if given.members > 1 else {}  # injections of the model
    runs: dict[str, Run] = {}

    def run(values: Mapping[str, Any]) -> Run:
        key = repr(values)
        if key not in runs:
            runs[key] = simulate(plain.with_(**values), given.out / str(len(runs)))
        return runs[key]

    for name, (recorded, values) in changes(plain).items():
        if given.only not in name:
            continue
        data = run(values if recorded else {})
        model = run({**others, **({} if recorded else values)})
        found = [difference(recording(data, seed=seed), model) for seed in range(given.seeds)]
        print(line(name, difference(data, model), found), flush=True)
        if data is not model:
            print(f"    {needed(data, model, given.out / 'cache')}", flush=True)


if __name__ == "__main__":
    main()
