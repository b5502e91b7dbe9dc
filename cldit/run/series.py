"""Several times of a scene's spray, each in a run folder of its own."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from cldit.dit.delay_table import DelayRow
from cldit.errors import (
    EmptyCloud,
    EvaluationError,
    MediumError,
    NoFuel,
    NotAtThisTime,
    OpticsError,
    RunFolderError,
    SprayError,
    Stopped,
    TransportError,
)
from cldit.prepare.stages import Say, StageLine
from cldit.run.result import Run
from cldit.run.series_plan import SeriesPlan
from cldit.scene import Scene
from cldit.spray.cache import times_together

State = Literal["done", "no spray", "failed"]

# Errors of one time; a full disk, for instance, or a missing device stops all.
_OF_ONE_TIME = (
    SprayError,
    MediumError,
    OpticsError,
    TransportError,
    EvaluationError,
    RunFolderError,
)
_GAS_ALONE = "_gas_alone"  # ends the name of a folder, as its scene is another


@dataclass(frozen=True)
class SeriesTime:
    """Result of one time.

    time: s, or the case's own unit. folder: of the run; None unless `done`. spray: its notes. dit:
    medians over the maps, of the acquisition where there is one. problem: why there is no run.
    """

    time: float
    state: State
    folder: Path | None = None
    spray: Mapping[str, float] = field(default_factory=dict)
    dit: DelayRow | None = None
    problem: str = ""

    @classmethod
    def of(cls, time: float, run: Run) -> "SeriesTime":
        """Takes the figures of a `run` at a `time`; its images stay in its folder."""
        maps = run.maps if run.measured is None else run.measured
        return cls(time, "done", run.folder, run.info.spray, DelayRow.of(time, maps))


def run_times(
    plan: SeriesPlan, out: Path, run: Callable[[Scene, Path], Run], say: Say
) -> tuple[SeriesTime, ...]:
    """Runs every time of a series, in increasing order; a time that fails does not stop the others.

    A time without a cloud or fuel is before the injection, or after all fuel has evaporated, if it
    is not between times with liquid: then its gas alone is run, or there is no spray. If the files
    themselves contain an empty cloud, the gas is run in any case. `out` contains the folders of
    the times, `run` runs a scene into one, `say` takes lines of text.
    """
    results: dict[float, SeriesTime] = {}
    lacking: dict[float, SprayError] = {}

    def once(time: float, scene: Scene, suffix: str = "") -> SeriesTime:
        try:
            with times_together(tuple(plan.scenes)):
                return SeriesTime.of(time, run(scene, out / f"{plan.folder(time)}{suffix}"))
        except Stopped:
            raise
        except NoFuel as error:
            say(f"no spray at {plan.text(time)}: {error}")
            return SeriesTime(time, "no spray", problem=str(error))
        except (EmptyCloud, NotAtThisTime):
            raise
        except _OF_ONE_TIME as error:
            say(f"{plan.text(time)} failed: {error}")
            return SeriesTime(time, "failed", problem=str(error))

    for number, (time, scene) in enumerate(plan.scenes.items(), start=1):
        say(StageLine(f"{plan.text(time)}, time {number} of {len(plan.scenes)}"))
        try:
            results[time] = once(time, scene)
        except (EmptyCloud, NotAtThisTime) as error:
            say(f"not as at other times: {error}")
            lacking[time] = error
    liquid = [
        time for time, result in results.items() if result.spray.get("liquid_mass_kg", 0.0) > 0.0
    ]
    for time, problem in lacking.items():
        outside = liquid and not min(liquid) < time < max(liquid)
        if isinstance(problem, NotAtThisTime) and not outside:
            results[time] = SeriesTime(time, "failed", problem=str(problem))
            continue
        say(f"{plan.text(time)}: gas alone")
        spray = plan.scenes[time].spray.model_copy(update={"cloud": "none"})
        try:
            gas_scene = plan.scenes[time].model_copy(update={"spray": spray})
            results[time] = once(time, gas_scene, _GAS_ALONE)
        except NotAtThisTime as error:
            say(f"no spray at {plan.text(time)}: {error}")
            results[time] = SeriesTime(time, "no spray", problem=str(error))
    return tuple(results[time] for time in plan.scenes)
