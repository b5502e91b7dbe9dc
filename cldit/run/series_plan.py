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
_UNIT_s = 1.0  # times of a case that reach so far are no seconds, but degrees of crank angle

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
        wanted = _wanted(times)
        spray = scene.spray
        remarks: tuple[str, ...] = ()
        if isinstance(spray, CfdSpray):
            from cldit.cfd.formats import contents  # brings VTK
            from cldit.cfd.orientation import with_one_frame
            from cldit.cfd.times import choose_time, choose_times, time_remarks

            source, known = str(spray.file), contents(spray).times_s
            chosen = choose_times(source, known, wanted)
            spray, remarks = with_one_frame(spray, known, watch=watch)
            for each in () if isinstance(wanted, str) else wanted:
                remarks += time_remarks(choose_time(source, known, each), each)
            scene = scene.model_copy(update={"spray": spray})
        else:
            chosen = _computed(scene, wanted)
        made = cls({}, remarks, max(map(abs, chosen)) < _UNIT_s)
        return replace(made, scenes={time: made._at(scene, time) for time in chosen})

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
        shown = [self.text(each).removesuffix(" ms") for each in self.scenes]
        digits = max(len(each.partition(".")[2]) for each in shown)
        texts = {each: f"{factor * each:.{digits}f}" for each in self.scenes}
        unit = " ms" if self.in_seconds else ""
        return texts[time].rjust(max(map(len, texts.values()))) + unit

    def folder(self, time: float) -> str:
        """The name of the run folder of a time."""
        return f"time_{self.text(time).replace(' ', '')}"


def _wanted(times: Times) -> str | list[float | str]:
    """A list of times for `choose_time`, or `all` or a slice."""
    if isinstance(times, str):
        text = times.strip()
        if text == "all" or ":" in text:
            return text
        times = [part.strip() for part in text.split(",") if part.strip()]
    if not times:
        raise SceneError(f"times: none is named; {_ALLOWED}")
    try:
        return _TIMES.validate_python(list(times))
    except ValidationError as error:
        text = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise SceneError(f"times: {text}; or {_ALLOWED}") from error


def _computed(scene: Scene, wanted: str | list[float | str]) -> tuple[float, ...]:
    """Times of a spray model."""
    model = scene.spray.model
    if "time_s" not in type(scene.spray).model_fields:
        raise SceneError(
            f"times: spray.model {model} has one time only; allowed: cone, lagrangian and cfd"
        )
    if wanted == "all" and scene.plan.delays_s:
        return tuple(sorted(set(scene.plan.delays_s)))
    if isinstance(wanted, str) or not all(isinstance(each, float | int) for each in wanted):
        raise SceneError(
            f"times {wanted!r}: spray.model {model} computes any time, so each must be named, as "
            "0.5ms,1ms; `all` are those of plan.delays_s"
        )
    return tuple(sorted({float(each) for each in wanted}))
