"""The times of a series, and the scene of each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pydantic import TypeAdapter, ValidationError

from cldit.errors import SceneError
from cldit.io.progress import Watch, silent
from cldit.scene import Scene
from cldit.scene.spray import CfdSpray
from cldit.scene.values import CaseTime

Times = str | Sequence[float | str]

_ALLOWED = "`all`, times as 0.5ms,1ms, or numbers in order as ::5"
_TIMES = TypeAdapter(list[CaseTime])
_UNIT_s = 1.0  # injections last milliseconds: such times are degrees of crank angle

SERIES_FILE = "series.yaml"
"""The scene of a series, in its folder."""


@dataclass(frozen=True)
class SeriesPlan:
    """A scene for each time, in increasing order; remarks on choices for all of them.

    in_seconds: False where the times are degrees of crank angle.
    """

    scenes: Mapping[float, Scene]
    remarks: tuple[str, ...] = ()
    in_seconds: bool = True

    @classmethod
    def of(cls, scene: Scene, times: Times, *, watch: Watch = silent) -> "SeriesPlan":
        """The times of a scene's spray.

        Args:
            scene: its spray is a CFD case, or a model that computes any time.
            times: `all` (those of the case, or the plan's delays), numbers in order as `::5` and
                `-3:`, a text of times with commas as `0.5ms,1ms`, or a list of times.
            watch: takes the progress of reading a case.
        """
        selection = _selection(times)
        spray = scene.spray
        remarks: tuple[str, ...] = ()
        if isinstance(spray, CfdSpray):
            from cldit.cfd.case import choose_time, choose_times, time_remarks
            from cldit.cfd.formats import contents  # brings VTK
            from cldit.cfd.orientation import with_one_frame

            source, case_times = str(spray.file), contents(spray).times_s
            chosen = choose_times(source, case_times, selection)
            spray, remarks = with_one_frame(spray, case_times, watch=watch)
            for time in () if isinstance(selection, str) else selection:
                remarks += time_remarks(choose_time(source, case_times, time), time)
            scene = scene.model_copy(update={"spray": spray})
        else:
            chosen = _computed(scene, selection)
        plan = cls({}, remarks, max(map(abs, chosen)) < _UNIT_s)
        return replace(plan, scenes={time: plan._at(scene, time) for time in chosen})

    def _at(self, scene: Scene, time: float) -> Scene:
        """The scene at one time, which is in its name."""
        name = f"{scene.name[:80]} at {self.text(time)}"
        return scene.with_(**{"name": name, "spray.time_s": time, "plan.delays_s": []})

    def text(self, time: float) -> str:
        """A time with its unit: `0.5 ms`, or `-12.5` degrees of crank angle."""
        return f"{1e3 * time:.9g} ms" if self.in_seconds else f"{time:.9g}"

    def stamp(self, time: float) -> str:
        """A time as long as all others: `0.50 ms` beside `0.25 ms`."""
        factor = 1e3 if self.in_seconds else 1.0
        shown = [self.text(scene_time).removesuffix(" ms") for scene_time in self.scenes]
        digits = max(len(label.partition(".")[2]) for label in shown)
        texts = {scene_time: f"{factor * scene_time:.{digits}f}" for scene_time in self.scenes}
        unit = " ms" if self.in_seconds else ""
        return texts[time].rjust(max(map(len, texts.values()))) + unit

    def folder(self, time: float) -> str:
        """The name of the run folder of a time."""
        return f"time_{self.text(time).replace(' ', '')}"


def _selection(times: Times) -> str | list[float | str]:
    """A list of times for `choose_time`, or `all` or a slice."""
    if isinstance(times, str):
        expression = times.strip()
        if expression == "all" or ":" in expression:
            return expression
        times = [part.strip() for part in expression.split(",") if part.strip()]
    if not times:
        raise SceneError(f"times: none is named; {_ALLOWED}")
    try:
        return _TIMES.validate_python(list(times))
    except ValidationError as error:
        message = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise SceneError(f"times: {message}; or {_ALLOWED}") from error


def _computed(scene: Scene, selection: str | list[float | str]) -> tuple[float, ...]:
    """Times of a spray model."""
    model = scene.spray.model
    if "time_s" not in type(scene.spray).model_fields:
        raise SceneError(
            f"times: spray.model {model} has one time only; allowed: cone, lagrangian and cfd"
        )
    if selection == "all" and scene.plan.delays_s:
        return tuple(sorted(set(scene.plan.delays_s)))
    if isinstance(selection, str) or not all(isinstance(time, float | int) for time in selection):
        raise SceneError(
            f"times {selection!r}: spray.model {model} computes any time, so each must be named, "
            "as 0.5ms,1ms; `all` are those of plan.delays_s"
        )
    return tuple(sorted({float(time) for time in selection}))
