"""The whole experiment on one scene: simulate, acquire with the simulated rig, evaluate, report."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cldit.acquisition.measured import Measured, is_measured, open_measured
from cldit.acquisition.plan import plan_from_scene
from cldit.acquisition.progress import Progress
from cldit.acquisition.record import Acquisition, maps_folder, open_acquisition
from cldit.acquisition.runner import acquire
from cldit.acquisition.sequence import Record
from cldit.camera.curve import Curve
from cldit.camera.view import SensorView
from cldit.dit.delay_table import DelayRow, table_csv
from cldit.dit.maps import Maps
from cldit.dit.recorded import CurveSource, Evaluation, evaluate_shots
from cldit.dit.scattering import Medium, enclosure, medium_temperature, scattered_by
from cldit.errors import EvaluationError, RunFolderError, SprayError, Stopped
from cldit.files import write_text
from cldit.gpu.device import Device
from cldit.images import write_image
from cldit.origin import Origin
from cldit.plain_data import dump_yaml
from cldit.provenance import files_read
from cldit.report.run_report import write_run_report
from cldit.rig.load import open_rig
from cldit.rig.simulated import simulated_rig_data
from cldit.run import Run, Say, Stage, simulate, with_stages
from cldit.scene import Scene, load_scene
from cldit.scene.delays import SAME_s, alone, delay_folder, delay_text, scene_at, spray_time_s
from cldit.scene.spray import CfdSpray

Watch = Callable[[Progress], None]


def run_experiment(
    scene: Scene | str | Path,
    out: str | Path,
    *,
    device: Device | None = None,
    progress: Say | None = None,
    watch: Watch | None = None,
) -> Run:
    """Simulates the scene, records it with the simulated rig, evaluates, and writes the report.

    Whatever ended it before, the same call goes on where it stopped.

    Args:
        scene: what is simulated; or a shipped name, or a YAML file.
        out: the run's folder; the acquisition goes into its folder `acquisition`.
        device: to trace on; None chooses.
        progress: called with a line of text as things happen.
        watch: called with the progress of reading a CFD case, and of the rig.

    Raises:
        Stopped: the acquisition was interrupted; the same call resumes it.
        ClditError: a subclass that says what is wrong and what to do.
        EvaluationError: the scene has one background temperature only.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    folder = Path(out)
    if len(set(scene.background.temperatures_K)) < 2:
        raise EvaluationError(
            f"background.temperatures_K: {list(scene.background.temperatures_K)} holds one "
            "temperature; DIT needs at least two that differ"
        )
    at_delays = {delay_s: scene_at(scene, delay_s) for delay_s in scene.plan.delays_s}
    _refuse_missing(scene)

    def reading(what: str, done: int, total: int) -> None:
        if watch is not None:
            watch(Progress(what, done, total, None))

    run = simulate(scene, folder, device=device, progress=progress, watch=reading)
    traced: list[Path] = []
    shown_s = spray_time_s(scene)
    for delay_s, later in at_delays.items():
        if _same(shown_s, delay_s):
            traced.append(folder)
            continue
        if progress is not None:
            progress(f"the spray at {delay_text(delay_s)}")
        traced.append(folder / delay_folder(delay_s))
        simulate(alone(later), traced[-1], device=device, progress=progress, watch=reading)
    start = time.perf_counter()
    plan = plan_from_scene(scene, integration_time_s=run.info.integration_time_s)
    rig_file = folder / "rig.yaml"
    rig_data = simulated_rig_data(scene, (traced or [folder])[0], further_runs=traced[1:])
    write_text(rig_file, dump_yaml(rig_data))
    write_text(folder / "plan.yaml", plan.dump())
    if progress is not None:
        progress("acquisition")
    with open_rig(rig_data) as rig:
        record = acquire(rig, plan, folder / "acquisition", progress=watch)
    _complete(record)
    acquired = time.perf_counter()
    if progress is not None:
        progress("evaluation of the shots")
    found = evaluate_delays(folder / "acquisition")
    if delay_problems(found):
        raise EvaluationError(delay_problems(found))
    measured = _of_run(found, shown_s)
    evaluated = time.perf_counter()
    stages = [
        Stage("acquisition", acquired - start, f"{record.saved} shots"),
        Stage("evaluation of the shots", evaluated - acquired),
    ]
    run = with_stages(run, stages, measured)
    if progress is not None:
        progress("pictures and report")
    write_run_report(run)
    return run


def _refuse_missing(scene: Scene) -> None:
    """What a trace of each delay would refuse after the others, before anything is traced."""
    spray = scene.spray
    if not isinstance(spray, CfdSpray) or not scene.plan.delays_s:
        return
    from cldit.cfd.formats import contents  # brings VTK
    from cldit.cfd.times import choose_time

    known_s = contents(spray).times_s
    for delay_s in scene.plan.delays_s if known_s else ():
        try:
            choose_time(str(spray.file), known_s, delay_s)
        except SprayError as error:
            raise SprayError(f"plan.delays_s: {delay_text(delay_s)}: {error}") from error


def _of_run(found: tuple[DelayEvaluation, ...], shown_s: float | None) -> Maps | None:
    """The maps of the time that the run itself shows, if that was recorded."""
    for one in found:
        if len(found) == 1 or _same(shown_s, one.delay_s):
            return None if one.evaluation is None else one.evaluation.maps
    return None


def _same(one_s: float | None, other_s: float | None) -> bool:
    return one_s is not None and other_s is not None and abs(one_s - other_s) < SAME_s


def _complete(record: Record) -> None:
    if not record.complete:
        raise Stopped(
            f"{record.folder}: stopped after {record.saved} of {record.total} shots; "
            "run the same command again to go on"
        )


def acquisition_in(folder: str | Path) -> Path:
    """Of a run's `folder` its acquisition; any other path as it is."""
    inner = Path(folder) / "acquisition"
    return inner if inner.is_dir() else Path(folder)


@dataclass(frozen=True)
class DelayEvaluation:
    """What came of one delay; `folder` holds its maps.

    delay_s: None for measured data, which do not say. evaluation: None where there is a `problem`.
    """

    delay_s: float | None
    folder: Path
    evaluation: Evaluation | None
    problem: str = ""


def evaluate_delays(
    folder: str | Path,
    *,
    curve: CurveSource = "planck",
    robust: bool = False,
    frame: int = 0,
    accept: Collection[str] = (),
    progress: Callable[[int, int], None] | None = None,
    say: Say | None = None,
) -> tuple[DelayEvaluation, ...]:
    """Evaluates every delay of a folder.

    One delay has its maps in `maps`, several in `maps/delay_0.95ms` and so on, with the table
    `maps/delays.csv`. A delay that cannot be evaluated does not keep the others.

    Args:
        folder, curve, robust, frame, accept, progress, say: as `evaluate_folder`.

    Returns:
        One for each delay, in the plan's order.

    Raises:
        RunFolderError: as `evaluate_folder`.
        EvaluationError: as `evaluate_folder`; with several delays, where all fail.
    """
    if is_measured(folder):
        delays: tuple[float, ...] = ()
    else:
        delays = open_acquisition(folder, frame=frame).plan.delays
    if len(delays) < 2:
        found = evaluate_folder(
            folder,
            curve=curve,
            robust=robust,
            frame=frame,
            accept=accept,
            progress=progress,
            say=say,
        )
        here = Path(folder)
        place = (here.parent if here.is_file() else here) / "maps"
        return (DelayEvaluation(delays[0] if delays else None, place, found),)
    done: list[DelayEvaluation] = []
    for number, delay_s in enumerate(delays):
        place = maps_folder(Path(folder), delays, number)
        try:
            evaluation = evaluate_folder(
                folder,
                curve=curve,
                robust=robust,
                frame=frame,
                delay=number,
                accept=accept,
                progress=progress,
                say=say,
            )
        except EvaluationError as error:
            done.append(DelayEvaluation(delay_s, place, None, str(error)))
        else:
            done.append(DelayEvaluation(delay_s, place, evaluation))
    rows = delay_rows(done)
    if not rows:
        raise EvaluationError(delay_problems(done))
    write_text(Path(folder) / "maps" / "delays.csv", table_csv(rows))
    return tuple(done)


def delay_rows(found: Collection[DelayEvaluation]) -> list[DelayRow]:
    """The table over the delays that could be evaluated."""
    return [
        DelayRow.of(one.delay_s, one.evaluation.maps)
        for one in found
        if one.evaluation is not None and one.delay_s is not None
    ]


def delay_problems(found: Collection[DelayEvaluation]) -> str:
    """Why delays could not be evaluated; empty where all were."""
    return "\n".join(
        f"at {delay_text(one.delay_s)}: {one.problem}"
        for one in found
        if one.problem and one.delay_s is not None
    )


def evaluate_folder(
    folder: str | Path,
    *,
    curve: CurveSource = "planck",
    robust: bool = False,
    frame: int = 0,
    delay: int | None = None,
    accept: Collection[str] = (),
    progress: Callable[[int, int], None] | None = None,
    say: Say | None = None,
) -> Evaluation:
    """Evaluates one delay of an acquisition folder, or measured data, and stores the maps.

    They go into `maps` beside the pictures; of several delays, each into a folder within.

    Args:
        folder: of an acquisition; or with measured.yaml, or such a file itself.
        curve, robust, accept, progress: as `cldit.dit.recorded.evaluate_shots`; what measured.yaml
            accepts is accepted too.
        frame: which picture of each shot, where the plan has several.
        delay: which of the plan's delays, from 0; needed where it has several.
        say: called with lines that tell what was found in measured files, before the fit.

    Raises:
        RunFolderError: the folder holds no acquisition. Damaged shots, and what the journal lacks,
            are left out and named by the remarks.
        EvaluationError: the shots cannot be evaluated.
    """
    acquisition: Acquisition | Measured
    missing: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()
    if is_measured(folder):
        if frame:
            raise EvaluationError(f"{folder}: frame {frame}: measured shots have one picture, 0")
        if delay:
            raise EvaluationError(f"{folder}: delay {delay}: measured data have one delay, 0")
        acquisition = open_measured(folder)
        place = acquisition.folder / "maps"
        if say is not None:
            for found in acquisition.found():
                say(found)
        accept = (*acquisition.accept, *accept)
    else:
        acquisition = open_acquisition(folder, frame=frame)
        number = _delay_number(acquisition, delay)
        place = maps_folder(acquisition.folder, acquisition.plan.delays, number)
        acquisition = acquisition.at_delay(number)
        missing = acquisition.missing
    try:
        evaluation = evaluate_shots(
            acquisition, curve=curve, robust=robust, accept=accept, progress=progress
        )
    except RunFolderError:
        if isinstance(acquisition, Measured):
            raise
        acquisition = acquisition.whole()  # it reads every picture, so only where one is damaged
        evaluation = _evaluate_rest(acquisition, curve, robust, accept, progress)
    finally:
        if isinstance(acquisition, Measured):
            acquisition.close()
    if isinstance(acquisition, Acquisition):
        damage = acquisition.damage
    evaluation = replace(evaluation, remarks=(*damage, *evaluation.remarks))
    if missing:
        line = f"{len(missing)} shots of the plan are missing ({', '.join(missing[:5])}"
        line += ", ..)" if len(missing) > 5 else ")"
        evaluation = replace(evaluation, remarks=(line, *evaluation.remarks))
    origin = Origin.now(inputs=files_read(acquisition.inputs))
    evaluation = replace(evaluation, origin=origin)
    evaluation.maps.save(place, pixel_m=acquisition.pixel_m)
    if evaluation.budget is not None:
        evaluation.budget.save(place, pixel_m=acquisition.pixel_m)
    write_text(place / "evaluation.json", evaluation.to_json())
    return evaluation


def _delay_number(acquisition: Acquisition, delay: int | None) -> int:
    delays = acquisition.plan.delays
    if delay is None and len(delays) > 1:
        raise EvaluationError(
            f"{acquisition.folder}: holds {len(delays)} delays; give `delay`, or evaluate them all "
            "with evaluate_delays"
        )
    if not 0 <= (delay or 0) < len(delays):
        allowed = f"0..{len(delays) - 1}"
        raise EvaluationError(f"{acquisition.folder}: delay {delay}: allowed is {allowed}")
    return delay or 0


def _evaluate_rest(
    acquisition: Acquisition,
    curve: CurveSource,
    robust: bool,
    accept: Collection[str],
    progress: Callable[[int, int], None] | None,
) -> Evaluation:
    try:
        return evaluate_shots(
            acquisition, curve=curve, robust=robust, accept=accept, progress=progress
        )
    except EvaluationError as error:  # too few are left
        raise EvaluationError("\n".join([*acquisition.damage, str(error)])) from error


def evaluate_scattering(
    folder: str | Path, model: Run, evaluation: Evaluation, *, maps: Path | None = None
) -> Medium:
    """The temperature of what emits, with the scattered share of a model; stored beside the maps.

    Args:
        folder: as given to `evaluate_folder`, which must have gone before.
        model: a run whose spray and camera stand for the measurement's, and whose patches are those
            of its enclosure, temperatures included.
        evaluation: what `evaluate_folder` gave.
        maps: folder of its maps; None: `maps` beside the pictures.

    Raises:
        EvaluationError: the model's sensor has another number of pixels.
    """
    opened = open_measured(folder) if is_measured(folder) else open_acquisition(folder)
    view = SensorView.from_scene(model.scene)
    spray, reference = (
        weights.map(lambda image: view.image(image).astype(np.float32))
        for weights in (model.weights, model.reference)
    )
    curve = Curve(filter_um=evaluation.calibration.filter_um)
    if evaluation.fitted is not None:
        curve = evaluation.fitted.curve
    around = opened.surroundings
    if not around.patches:  # neither a rig nor measured data describes any
        around = replace(around, patches=model.scene.patches)
    scattered = scattered_by(spray, reference, enclosure(around, curve))
    medium = medium_temperature(evaluation.maps, scattered, curve)
    for name, image, unit in (
        ("medium_temperature_K", medium.temperature_K, "K"),
        ("medium_temperature_standard_error_K", medium.standard_error_K, "K"),
        ("scattered_share", medium.share, "1"),
    ):
        write_image(
            (maps or opened.folder / "maps") / f"{name}.tif",
            image.astype(np.float32),
            name=name.removesuffix("_K").replace("_", " "),
            unit=unit,
            pixel_m=opened.pixel_m,
        )
    return medium
