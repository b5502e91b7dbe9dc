"""Several times of one spray: `cldit run SCENE --times ..`, and the same for a script."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cldit.api.experiment import Watch, of_reading, run_experiment
from cldit.errors import RunFolderError, SprayError
from cldit.gpu.device import Device
from cldit.io.exclusive import exclusive, is_empty
from cldit.io.files import write_text
from cldit.run import Run, Say, StageLine, simulate
from cldit.run.folder import ANOTHER_FOLDER, stored_run, stored_scene
from cldit.run.series import SeriesTime, run_times
from cldit.run.series_plan import SERIES_FILE, SeriesPlan, Times
from cldit.run.trusted import open_device
from cldit.scene import Scene, dump_scene
from cldit.scene.load import chosen_scene
from cldit.show.report.series_report import write_series
from cldit.spray.cache import times_together


@dataclass(frozen=True)
class Series:
    """Result of `run_series`.

    plan: the scene of each time. times: requested times, rising. files: written beside the run
    folders: table, curves, figures in one scale, film.
    """

    plan: SeriesPlan
    folder: Path
    times: tuple[SeriesTime, ...]
    files: tuple[Path, ...]

    @property
    def failed(self) -> tuple[SeriesTime, ...]:
        """Times that could not be run."""
        return tuple(series_time for series_time in self.times if series_time.state == "failed")

    @property
    def problems(self) -> list[str]:
        """A line for each time without a run."""
        without = [series_time for series_time in self.times if series_time.state != "done"]
        return [f"{self.plan.text(missing.time)}: {missing.problem}" for missing in without]


def run_series(
    scene: Scene | str | Path,
    out: str | Path,
    *,
    quick: bool = False,
    pixels: int | Sequence[int] | None = None,
    times: Times = "all",
    trace_only: bool = False,
    device: Device | None = None,
    progress: Say | None = None,
    watch: Watch | None = None,
    suffix: str = ".png",
    ahead: Callable[[Mapping[Path, Scene]], object] | None = None,
) -> Series:
    """Runs several times of a scene's spray, each into a folder of its own, and makes a film.

    After an interruption, the same call continues: finished times are kept if scene and case are
    unchanged. A time without spray is reported; one that fails does not stop the others.

    Args:
        scene: a scene, a shipped name, or a YAML file; its own time is ignored.
        out: folder of the series.
        quick, pixels: as for `cldit.simulate`.
        times: as in `cldit.run.series_plan.SeriesPlan.of`.
        trace_only: without the rig: traces and noise-free maps.
        device: OpenCL device; None chooses. Programs are built once for all times.
        progress: called with lines of text.
        watch: called with the progress of reading a case, and of the rig.
        suffix: of the figures, .png, .pdf or .svg.
        ahead: called with the scene of each time by its folder before they are run, to trace them
            side by side.

    Returns:
        The scene and figures of each time, and the files beside the run folders.

    Raises:
        RunFolderError: the folder contains something else.
        SprayError: a time does not exist, or no time could be run.
        ClditError: as `cldit.simulate`, for faults that concern all times.
    """
    scene = chosen_scene(scene, quick=quick, pixels=pixels)
    folder, say, reading = Path(out), progress or (lambda line: None), of_reading(watch)
    _check_folder(folder, scene)
    plan = SeriesPlan.of(scene, times, watch=reading)
    for remark in plan.remarks:
        say(remark)
    with exclusive(folder, "series"):
        write_text(folder / SERIES_FILE, dump_scene(scene))
        opened = device or open_device()

        def run(time_scene: Scene, place: Path) -> Run:
            if trace_only:
                return simulate(time_scene, place, device=opened, progress=progress, watch=reading)
            return _recorded(time_scene, place, opened, say, watch)

        if ahead is not None:
            with times_together(tuple(plan.scenes)):
                ahead({folder / plan.folder(time): at for time, at in plan.scenes.items()})
        done = run_times(plan, folder, run, say)
        return _shown(Series(plan, folder, done, ()), scene, suffix, say)


def _shown(series: Series, scene: Scene, suffix: str, say: Say) -> Series:
    """Series with its figures and film. Raises SprayError if no time could be run."""
    if not any(series_time.state == "done" for series_time in series.times):
        raise SprayError("\n".join(series.problems))
    say(StageLine("figures and film"))
    files = write_series(series.plan, scene, series.times, series.folder, suffix=suffix)
    return replace(series, files=tuple(files))


def _recorded(scene: Scene, place: Path, device: Device, say: Say, watch: Watch | None) -> Run:
    """Run of one time with its recording, kept if it is finished."""
    finished = _finished(scene, place)
    if finished is not None:
        say(f"{place}: finished before, kept")
        return finished
    return run_experiment(scene, place, device=device, progress=say, watch=watch)


def _check_folder(folder: Path, scene: Scene) -> None:
    """Raises RunFolderError if a folder contains something else than a series of this scene."""
    if is_empty(folder):
        return
    if not (folder / SERIES_FILE).is_file():
        raise RunFolderError(f"{folder}: is not empty and contains no series; {ANOTHER_FOLDER}")
    if stored_scene(folder / SERIES_FILE) != scene:
        raise RunFolderError(
            f"{folder}: contains a series of another scene, or with other settings; "
            f"{ANOTHER_FOLDER}"
        )


def _finished(scene: Scene, place: Path) -> Run | None:
    """Run of a time whose trace, acquisition and report are complete."""
    report, info = place / "report.html", place / "run.json"
    if not (report.is_file() and info.is_file()):
        return None
    if report.stat().st_mtime_ns < info.stat().st_mtime_ns:  # traced again since
        return None
    run = stored_run(place, scene)
    return run if run is not None and run.measured is not None else None
