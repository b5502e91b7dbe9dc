"""Evaluation of the shots in a folder, of an acquisition or measured; maps are stored beside."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from cldit.acquisition.measured import Measured, is_measured, open_measured, open_recorded
from cldit.acquisition.plan import Group
from cldit.acquisition.record import Acquisition, maps_of_group, open_acquisition
from cldit.camera.curve import Curve
from cldit.camera.view import SensorView
from cldit.dit.delay_table import DelayRow, table_csv
from cldit.dit.maps import Maps
from cldit.dit.recorded import EVALUATION, CurveSource, Evaluation, evaluate_shots
from cldit.dit.scattering import Medium, enclosure, medium_temperature, scattered_by
from cldit.errors import EvaluationError, RunFolderError
from cldit.io.digests import write_sealed
from cldit.io.files import write_text
from cldit.io.images import write_maps
from cldit.io.origin import Origin, files_read
from cldit.run import Run, Say


@dataclass(frozen=True)
class DelayEvaluation:
    """Evaluation of one delay, with the folder of its maps.

    delay_s: None for measured data, where it is unknown. filter_name: of the filter wheel; None
    without one. label: filter and delay, as far as there are several. evaluation: None if there is
    a `problem`.
    """

    delay_s: float | None
    folder: Path
    evaluation: Evaluation | None
    problem: str = ""
    filter_name: str | None = None
    label: str = ""


def evaluate_delays(
    folder: str | Path,
    *,
    curve: CurveSource = "planck",
    frame: int = 0,
    accept: Collection[str] = (),
    progress: Callable[[int, int], None] | None = None,
    say: Say | None = None,
) -> tuple[DelayEvaluation, ...]:
    """Evaluates every filter and every delay of a folder as `evaluate_folder`, in the plan's order.

    One delay has its maps in `maps`, several in `maps/delay_0.95ms` and so on, with the table
    `maps/delays.csv`. Several filters have all that in a folder each, `maps/FILTER`. A delay that
    cannot be evaluated does not stop the others; EvaluationError if all fail.
    """
    plan = None if is_measured(folder) else open_acquisition(folder, frame=frame).plan
    evaluate = partial(
        evaluate_folder,
        curve=curve,
        frame=frame,
        accept=accept,
        progress=progress,
        say=say,
    )
    if plan is None:
        path = Path(folder)
        place = (path.parent if path.is_file() else path) / "maps"
        return (DelayEvaluation(None, place, evaluate(folder)),)
    done: list[DelayEvaluation] = []
    for group in plan.groups:
        name, problem, evaluation = plan.filter_name(group), "", None
        try:
            evaluation = evaluate(folder, delay=group.delay, filter_name=name)
        except EvaluationError as error:
            if len(plan.groups) == 1:
                raise
            problem = str(error)
        done.append(
            DelayEvaluation(
                delay_s=plan.delays[group.delay],
                folder=maps_of_group(Path(folder), plan, group),
                evaluation=evaluation,
                problem=problem,
                filter_name=name,
                label=", ".join(plan.words(group)),
            )
        )
    if not delay_rows(done):
        raise EvaluationError(delay_problems(done))
    if len(plan.delays) > 1:
        for name in plan.filters or (None,):
            of_filter = [item for item in done if item.filter_name == name]
            table = of_filter[0].folder.parent / "delays.csv"
            write_text(table, table_csv(delay_rows(of_filter)))
    return tuple(done)


def delay_rows(evaluations: Collection[DelayEvaluation]) -> list[DelayRow]:
    """Rows of the table of the delays that could be evaluated."""
    return [
        DelayRow.of(delay.delay_s, delay.evaluation.maps)
        for delay in evaluations
        if delay.evaluation is not None and delay.delay_s is not None
    ]


def delay_problems(evaluations: Collection[DelayEvaluation]) -> str:
    """Reasons why delays could not be evaluated; empty if all were."""
    return "\n".join(
        f"at {group.label}: {group.problem}"
        for group in evaluations
        if group.problem and group.delay_s is not None
    )


def evaluate_folder(
    folder: str | Path,
    *,
    curve: CurveSource = "planck",
    frame: int = 0,
    delay: int | None = None,
    filter_name: str | None = None,
    accept: Collection[str] = (),
    progress: Callable[[int, int], None] | None = None,
    say: Say | None = None,
) -> Evaluation:
    """Evaluates one filter and delay of an acquisition folder, or measured data, and stores the
    maps.

    They go into `maps` beside the images; those of several filters or delays into a folder each.

    Args:
        folder: acquisition, folder with measured.yaml, or such a file itself.
        curve, accept, progress: as `cldit.dit.recorded.evaluate_shots`; findings that
            measured.yaml accepts are accepted too.
        frame: which image of each shot, if the plan has several.
        delay: which of the plan's delays, from 0; required if it has several.
        filter_name: which of the plan's filters; required if it has several.
        say: called with lines about measured files, before the fit.

    Returns:
        Maps (H, W), checks, error budget, remarks and calibration.

    Raises:
        RunFolderError: the folder contains no acquisition. Shots that are damaged or missing in
            the journal are omitted and named by the remarks.
        EvaluationError: the shots cannot be evaluated.
    """
    acquisition: Acquisition | Measured
    missing: tuple[str, ...] = ()
    if is_measured(folder):
        if frame:
            raise EvaluationError(f"{folder}: frame {frame}: measured shots have one image, 0")
        if delay:
            raise EvaluationError(f"{folder}: delay {delay}: measured data have one delay, 0")
        if filter_name is not None:
            raise EvaluationError(f"{folder}: filter {filter_name}: measured data have no wheel")
        acquisition = open_measured(folder)
        place = acquisition.folder / "maps"
        if say is not None:
            for finding in acquisition.found():
                say(finding)
        accept = (*acquisition.accept, *accept)
    else:
        acquisition = open_acquisition(folder, frame=frame)
        group = _group(acquisition, delay, filter_name)
        place = maps_of_group(acquisition.folder, acquisition.plan, group)
        acquisition = acquisition.of_group(group)
        missing = acquisition.missing
    evaluate = partial(evaluate_shots, curve=curve, accept=accept, progress=progress)
    try:
        evaluation = evaluate(acquisition)
    except RunFolderError:
        if isinstance(acquisition, Measured):
            raise
        acquisition = acquisition.whole()  # reads every image, so only after damage
        try:
            evaluation = evaluate(acquisition)
        except EvaluationError as error:  # too few remain
            raise EvaluationError("\n".join([*acquisition.damage, str(error)])) from error
    finally:
        if isinstance(acquisition, Measured):
            acquisition.close()
    remarks = list(acquisition.damage) if isinstance(acquisition, Acquisition) else []
    if missing:
        ellipsis = ", .." if len(missing) > 5 else ""
        remarks.insert(
            0, f"{len(missing)} shots of the plan are missing ({', '.join(missing[:5])}{ellipsis})"
        )
    evaluation = replace(
        evaluation,
        remarks=(*remarks, *evaluation.remarks),
        origin=Origin.now(inputs=files_read(acquisition.inputs)),
    )
    evaluation.maps.save(place, pixel_m=acquisition.pixel_m)
    if evaluation.budget is not None:
        evaluation.budget.save(place, pixel_m=acquisition.pixel_m)
    files = [place / f"{item.name}.tif" for item in fields(Maps)]
    write_sealed(place / EVALUATION, evaluation.to_dict(), files)
    return evaluation


def _group(acquisition: Acquisition, delay: int | None, filter_name: str | None) -> Group:
    delays, filters = acquisition.plan.delays, acquisition.plan.filters
    if filter_name is None and len(filters) > 1:
        raise EvaluationError(
            f"{acquisition.folder}: contains {len(filters)} filters ({', '.join(filters)}); give "
            "`filter_name`, or evaluate all with evaluate_delays"
        )
    if filter_name not in (None, *filters):
        allowed = f"allowed: {', '.join(filters) or 'none'}"
        raise EvaluationError(f"{acquisition.folder}: filter_name {filter_name}; {allowed}")
    if delay is None and len(delays) > 1:
        raise EvaluationError(
            f"{acquisition.folder}: contains {len(delays)} delays; give `delay`, or evaluate all "
            "with evaluate_delays"
        )
    if not 0 <= (delay or 0) < len(delays):
        allowed = f"0..{len(delays) - 1}"
        raise EvaluationError(f"{acquisition.folder}: delay {delay}; allowed: {allowed}")
    return Group(filters.index(filter_name) if filter_name else 0, delay or 0)


def evaluate_scattering(
    folder: str | Path, model: Run, evaluation: Evaluation, *, maps: Path | None = None
) -> Medium:
    """Temperature of the emitting medium, with the scattered share of a model; stored as maps.

    model: run whose spray and camera represent those of the measurement, and whose patches are
    those of its enclosure, temperatures included. maps: folder of its maps; None: `maps` beside the
    images.
    """
    opened = open_recorded(folder)
    view = SensorView.from_scene(model.scene)
    spray, reference = (
        weights.map(lambda image: view.image(image).astype(np.float32))
        for weights in (model.weights, model.reference)
    )
    curve = Curve(filter_um=evaluation.calibration.filter_um)
    if evaluation.fitted is not None:
        curve = evaluation.fitted.curve
    surroundings = opened.surroundings
    if not surroundings.patches:  # neither a rig nor measured data describe them
        surroundings = replace(surroundings, patches=model.scene.patches)
    scattered = scattered_by(spray, reference, enclosure(surroundings, curve))
    medium = medium_temperature(evaluation.maps, scattered, curve)
    images = {
        "medium_temperature_K": (medium.temperature_K, "K"),
        "medium_temperature_standard_error_K": (medium.standard_error_K, "K"),
        "scattered_share": (medium.share, "1"),
    }
    write_maps(maps or opened.folder / "maps", images, pixel_m=opened.pixel_m)
    return medium
