"""Several times of a scene's spray: which they are, and a run folder for each of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
    SceneError,
    SprayError,
    Stopped,
    TransportError,
)
from cldit.progress import Watch, silent
from cldit.run.result import Run
from cldit.run.stages import Say
from cldit.scene import Scene
from cldit.scene.spray import CfdSpray
from cldit.scene.values import time_of

Times = str | Sequence[float | str]
State = Literal["done", "no spray", "failed"]

# What concerns one time; a full disk, say, or a missing device concerns all.
_OF_ONE_TIME = (
    SprayError,
    MediumError,
    OpticsError,
    TransportError,
    EvaluationError,
    RunFolderError,
)
_GAS_ALONE = "_gas_alone"  # ends the name of a folder, as its scene is another
_UNIT_s = 1.0  # times of a case that reach so far are no seconds, but degrees of crank angle


@dataclass(frozen=True)
class SeriesTime:
    """What came of one time.

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
    def of(cls, time: float, run: Run) -> SeriesTime:
        """What is kept of the `run` of a time: its pictures stay in its folder."""
        maps = run.maps if run.measured is None else run.measured
        return cls(time, "done", run.folder, run.info.spray, DelayRow.of(time, maps))


@dataclass(frozen=True)
class SeriesPlan:
    """A scene for each time, rising; remarks on what was chosen for all of them.

    in_seconds: False where the times are degrees of crank angle.
    """

    scenes: Mapping[float, Scene]
    remarks: tuple[str, ...] = ()
    in_seconds: bool = True

    @classmethod
    def of(cls, scene: Scene, times: Times, *, watch: Watch = silent) -> SeriesPlan:
        """The times of a scene's spray.

        Args:
            scene: its spray is a CFD case, or a model that computes any time.
            times: `all` (those of the case, or the plan's delays), numbers in order as `::5` and
                `-3:`, a text of times with commas as `0.5ms,1ms`, or a list of times.
            watch: told how far the reading of a case is.

        Raises:
            SprayError: a time is not there, or nozzle and axis of a case cannot be told.
            SceneError: the spray has one time only, or the model needs single times.
        """
        wanted = _wanted(times)
        spray = scene.spray
        remarks: tuple[str, ...] = ()
        if isinstance(spray, CfdSpray):
            from cldit.cfd.formats import contents  # brings VTK
            from cldit.cfd.series_frame import with_one_frame
            from cldit.cfd.times import choose_times

            known = contents(spray).times_s
            chosen = choose_times(str(spray.file), known, wanted)
            spray, remarks = with_one_frame(spray, known, watch=watch)
            scene = scene.model_copy(update={"spray": spray})
        else:
            chosen = _computed(scene, wanted)
        made = cls({}, remarks, max(map(abs, chosen)) < _UNIT_s)
        return replace(made, scenes={time: made._at(scene, time) for time in chosen})

    def _at(self, scene: Scene, time: float) -> Scene:
        """The scene at one time, which its name tells."""
        name = f"{scene.name[:80]} at {self.text(time)}"
        return scene.with_(**{"name": name, "spray.time_s": time, "plan.delays_s": []})

    def text(self, time: float) -> str:
        """A time as people name it: `0.5 ms`, or `-12.5`."""
        return f"{1e3 * time:.9g} ms" if self.in_seconds else f"{time:.9g}"

    def stamp(self, time: float) -> str:
        """A time as long as all others: `0.50 ms` beside `0.25 ms`."""
        factor = 1e3 if self.in_seconds else 1.0
        shown = [self.text(each).removesuffix(" ms") for each in self.scenes]
        digits = max(len(each.partition(".")[2]) for each in shown)
        texts = {each: f"{factor * each:.{digits}f}" for each in self.scenes}
        unit = " ms" if self.in_seconds else ""
        return texts[time].rjust(max(map(len, texts.values()))) + unit

    def folder(self, time: float) -> str:
        """The name of the run folder of a time."""
        return f"time_{self.text(time).replace(' ', '')}"


def _wanted(times: Times) -> str | list[float | str]:
    """A list of times, or the text that stands for some."""
    if not isinstance(times, str):
        return list(times)
    text = times.strip()
    if text == "all" or ":" in text:
        return text
    parts = [part.strip() for part in text.split(",") if part.strip()]
    try:
        return [part if part[:1].isalpha() else time_of(part) for part in parts]
    except ValueError as error:
        raise SceneError(
            f"times {times!r}: {error}; allowed is `all`, times as 0.5ms,1ms, or numbers in order "
            "as ::5"
        ) from error


def _computed(scene: Scene, wanted: str | list[float | str]) -> tuple[float, ...]:
    """Times of a model."""
    model = scene.spray.model
    if "time_s" not in type(scene.spray).model_fields:
        raise SceneError(
            f"times: spray.model {model} has one time only; allowed are cone, lagrangian and cfd"
        )
    if wanted == "all" and scene.plan.delays_s:
        return tuple(sorted(set(scene.plan.delays_s)))
    if isinstance(wanted, str) or not all(isinstance(each, float | int) for each in wanted):
        raise SceneError(
            f"times {wanted!r}: spray.model {model} computes any time, so each must be named, as "
            "0.5ms,1ms; `all` are those of plan.delays_s"
        )
    return tuple(sorted({float(each) for each in wanted}))


def run_times(
    plan: SeriesPlan, out: Path, run: Callable[[Scene, Path], Run], say: Say
) -> tuple[SeriesTime, ...]:
    """Runs every time of a series; one that is bad does not keep the others.

    A time without a cloud or fuel is one before the injection or after all has evaporated, if it is
    not between times with liquid: then its gas alone is run, or there is no spray. Where the
    files themselves say that a cloud is empty, the gas is run in any case.

    Args:
        plan: the times.
        out: folder of their folders.
        run: runs a scene into a folder.
        say: takes lines of text.

    Returns:
        One for each time, rising.

    Raises:
        ClditError: what concerns all times, such as a full disk; Stopped: by the user.
    """
    found: dict[float, SeriesTime] = {}
    lacking: dict[float, SprayError] = {}

    def once(time: float, scene: Scene, ending: str = "") -> SeriesTime:
        try:
            return SeriesTime.of(time, run(scene, out / f"{plan.folder(time)}{ending}"))
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
        say(f"{plan.text(time)}, time {number} of {len(plan.scenes)}")
        try:
            found[time] = once(time, scene)
        except (EmptyCloud, NotAtThisTime) as error:
            say(f"not as at other times: {error}")
            lacking[time] = error
    liquid = [time for time, one in found.items() if one.spray.get("liquid_mass_kg", 0.0) > 0.0]
    for time, problem in lacking.items():
        outside = liquid and not min(liquid) < time < max(liquid)
        if isinstance(problem, NotAtThisTime) and not outside:
            found[time] = SeriesTime(time, "failed", problem=str(problem))
            continue
        say(f"{plan.text(time)}: gas alone")
        spray = plan.scenes[time].spray.model_copy(update={"cloud": "none"})
        try:
            alone = plan.scenes[time].model_copy(update={"spray": spray})
            found[time] = once(time, alone, _GAS_ALONE)
        except NotAtThisTime as error:
            say(f"no spray at {plan.text(time)}: {error}")
            found[time] = SeriesTime(time, "no spray", problem=str(error))
    return tuple(found[time] for time in plan.scenes)
