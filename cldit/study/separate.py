"""Two models of a spray, and the measurement that would tell them apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cldit.comparison.rivals import check_rivals, in_band, rivals_of
from cldit.comparison.unknowns import Unknown
from cldit.dit.design import BlackBody, shot_time_s
from cldit.dit.separation import Separation
from cldit.gpu.device import Device
from cldit.io.content import digest
from cldit.run import Run, Say, simulate
from cldit.scene import Scene
from cldit.scene.delays import delay_folder, scene_at, without_delays
from cldit.scene.scatter import members_of


def separate(
    model: Scene,
    rival: Scene,
    folder: Path,
    blackbody: BlackBody,
    *,
    delays_s: Sequence[float] = (),
    bands: Mapping[str, Scene] | None = None,
    unknowns: Sequence[Unknown] = (),
    least_emissivity: float = 0.2,
    device: Device | None = None,
    progress: Say | None = None,
) -> list[Separation]:
    """Fastest plan that separates two models, for each delay and band; runs are in `folder`.

    Without delays, that of the scenes' sprays is taken. bands: scenes whose optics are those of
    another filter, besides that of the scenes.
    """
    check_rivals(model, rival)
    separations = []
    for delay_s in delays_s or (None,):
        for band, optics in {"": None, **(bands or {})}.items():
            place = folder / band if band else folder

            def trace(scene: Scene, like: Run | None, place: Path = place) -> Run:
                return simulate(
                    scene, place / "variants" / digest(scene.model_dump(mode="json")),
                    device=device, like=like, progress=progress,
                )  # fmt: skip

            runs: list[Run] = []
            for name, scene in (("one", model), ("other", rival)):
                at = without_delays(scene if delay_s is None else scene_at(scene, delay_s))
                at = at if optics is None else in_band(at, optics)
                where = place / name / ("" if delay_s is None else delay_folder(delay_s))
                like = runs[0] if runs and members_of(at) == 1 else None
                runs.append(simulate(at, where, device=device, like=like, progress=progress))
            rivals = rivals_of(
                runs[0],
                runs[1],
                trace,
                band=band,
                unknowns=unknowns,
                least_emissivity=least_emissivity,
            )
            separations.append(rivals.best(blackbody, shot_s=shot_time_s(runs[0].scene)))
    return separations
