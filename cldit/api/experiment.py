"""Experiment on one scene: simulate, acquire with the simulated rig, evaluate, report."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from cldit.acquisition.plan import plan_from_scene
from cldit.acquisition.progress import Progress
from cldit.acquisition.record import open_acquisition
from cldit.acquisition.runner import acquire
from cldit.acquisition.sequence import Record
from cldit.api.folder_evaluation import GroupEvaluation, evaluate_groups, group_problems
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError, SprayError, Stopped
from cldit.gpu.device import Device
from cldit.io.exclusive import exclusive
from cldit.io.files import write_text
from cldit.io.plain_data import dump_yaml
from cldit.io.progress import Watch as ReadingWatch
from cldit.io.progress import silent
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.run import Run, Say, Stage, StageLine, simulate, with_stages
from cldit.scene import Scene
from cldit.scene.delays import (
    delay_folder,
    delay_text,
    same_time,
    scene_at,
    spray_time_s,
    without_delays,
)
from cldit.scene.load import chosen_scene
from cldit.scene.spray import CfdSpray
from cldit.show.report.run_report import write_run_report
from cldit.spray.cache import times_together

Watch = Callable[[Progress], None]


def of_reading(watch: Watch | None) -> ReadingWatch:
    """Callback for the reading of a CFD case, which passes its progress to `watch`."""
    if watch is None:
        return silent
    return lambda work, done, total: watch(Progress(work, done, total, None))


def run_experiment(
    scene: Scene | str | Path,
    out: str | Path,
    *,
    quick: bool = False,
    pixels: int | Sequence[int] | None = None,
    device: Device | None = None,
    progress: Say | None = None,
    watch: Watch | None = None,
) -> Run:
    """Simulates the scene, records it with the simulated rig, evaluates, and writes the report.

    After an interruption of any kind, the same call continues where it stopped.

    Args:
        scene: a scene, a shipped name, or a YAML file.
        out: the run's folder; its folder `acquisition` gets the shots.
        quick, pixels: as for `cldit.simulate`.
        device: OpenCL device; None chooses.
        progress: called with a line of text as things happen.
        watch: called with the progress of reading a CFD case, and of the rig.

    Raises:
        Stopped: the acquisition was interrupted; the same call resumes it.
        ClditError: a subclass that names the fault and the remedy.
        EvaluationError: the scene has only one background temperature.
    """
    scene = chosen_scene(scene, quick=quick, pixels=pixels)
    folder = Path(out)
    if len(set(scene.background.temperatures_K)) < 2:
        raise EvaluationError(
            f"background.temperatures_K: {list(scene.background.temperatures_K)} contains one "
            "temperature; DIT requires at least two different ones"
        )
    at_delays = {delay_s: scene_at(scene, delay_s) for delay_s in scene.plan.delays_s}
    _refuse_missing(scene)
    shown_s = spray_time_s(scene)
    times_s = [*at_delays, *([shown_s] if isinstance(shown_s, float) else [])]
    with exclusive(folder, "run"), times_together(times_s):
        return _run(scene, folder, at_delays, device, progress or (lambda line: None), watch)


def _run(
    scene: Scene,
    folder: Path,
    at_delays: Mapping[float, Scene],
    device: Device | None,
    say: Say,
    watch: Watch | None,
) -> Run:
    """Simulates, records and evaluates into a locked folder; raises as `run_experiment`."""

    reading = of_reading(watch)
    run = simulate(scene, folder, device=device, progress=say, watch=reading)
    traced: list[Path] = []
    shown_s = spray_time_s(scene)
    for delay_s, later in at_delays.items():
        if same_time(shown_s, delay_s):
            traced.append(folder)
            continue
        say(StageLine(f"the spray at {delay_text(delay_s)}"))
        traced.append(folder / delay_folder(delay_s))
        simulate(without_delays(later), traced[-1], device=device, progress=say, watch=reading)
    start = time.perf_counter()
    plan = plan_from_scene(scene, integration_time_s=run.info.integration_time_s)
    rig_file = folder / "rig.yaml"
    rig_data = simulated_rig_data(scene, (traced or [folder])[0], further_runs=traced[1:])
    write_text(rig_file, dump_yaml(rig_data))
    write_text(folder / "plan.yaml", plan.dump())
    say(StageLine("acquisition"))
    with open_rig(rig_data) as rig:
        record = acquire(rig, plan, folder / "acquisition", progress=watch)
    _complete(record)
    acquired = time.perf_counter()
    say(StageLine("evaluation of the shots"))
    evaluations = evaluate_groups(open_acquisition(folder / "acquisition"))
    if problems := group_problems(evaluations):
        raise EvaluationError(problems)
    measured = _of_run(evaluations, shown_s)
    evaluated = time.perf_counter()
    stages = [
        Stage("acquisition", acquired - start, f"{record.saved} shots"),
        Stage("evaluation of the shots", evaluated - acquired),
    ]
    run = with_stages(run, stages, measured)
    say(StageLine("figures and report"))
    write_run_report(run)
    return run


def _refuse_missing(scene: Scene) -> None:
    """Refuses delays whose spray is missing before anything is traced."""
    spray = scene.spray
    if not isinstance(spray, CfdSpray) or not scene.plan.delays_s:
        return
    from cldit.cfd.case import choose_time
    from cldit.cfd.formats import contents  # loads VTK

    case_times_s = contents(spray).times_s
    for delay_s in scene.plan.delays_s if case_times_s else ():
        try:
            choose_time(str(spray.file), case_times_s, delay_s)
        except SprayError as error:
            raise SprayError(f"plan.delays_s: {delay_text(delay_s)}: {error}") from error


def _of_run(evaluations: tuple[GroupEvaluation, ...], shown_s: float | None) -> Maps | None:
    """Maps of the time that the run itself shows, if it was recorded."""
    for group in evaluations:
        if len(evaluations) == 1 or same_time(shown_s, group.delay_s):
            return None if group.evaluation is None else group.evaluation.maps
    return None


def _complete(record: Record) -> None:
    if not record.complete:
        raise Stopped(
            f"{record.folder}: stopped after {record.saved} of {record.total} shots; "
            "run the same command again to continue"
        )
