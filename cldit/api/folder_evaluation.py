"""Evaluation of the shots in a folder, of an acquisition or measured; maps are stored beside."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from cldit.acquisition.measured import Measured, open_recorded
from cldit.acquisition.plan import Group
from cldit.acquisition.record import Acquisition, maps_of_group
from cldit.camera.curve import Curve
from cldit.camera.view import SensorView
from cldit.dit.delay_table import DelayRow, table_csv
from cldit.dit.recorded import CurveSource, Evaluation, evaluate_shots
from cldit.dit.scattering import Medium, enclosure, medium_temperature, scattered_by
from cldit.errors import EvaluationError, RunFolderError
from cldit.io.files import write_text
from cldit.io.origin import Origin, files_read
from cldit.run import Run, Say


@dataclass(frozen=True)
class GroupEvaluation:
    """Evaluation of one filter and delay, with the folder of its maps.

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


def evaluate_groups(
    recorded: Acquisition | Measured,
    *,
    curve: CurveSource = "planck",
    accept: Collection[str] = (),
    progress: Callable[[int, int], None] | None = None,
    say: Say | None = None,
) -> tuple[GroupEvaluation, ...]:
    """Evaluates every filter and every delay, in the plan's order, as `evaluate_folder`.

    One delay has its maps in `maps`, several in `maps/delay_0.95ms` and so on, with the table
    `maps/delays.csv`. Several filters have all that in a folder each, `maps/FILTER`. A group that
    cannot be evaluated does not stop the others; EvaluationError if all fail.
    """
    evaluate = partial(
        evaluate_folder, recorded, curve=curve, accept=accept, progress=progress, say=say
    )
    if isinstance(recorded, Measured):
        return (GroupEvaluation(None, recorded.folder / "maps", evaluate()),)
    plan = recorded.plan
    evaluations: list[GroupEvaluation] = []
    for group in plan.groups:
        problem, evaluation = "", None
        try:
            evaluation = evaluate(group=group)
        except EvaluationError as error:
            if len(plan.groups) == 1:
                raise
            problem = str(error)
        evaluations.append(
            GroupEvaluation(
                delay_s=plan.delays[group.delay],
                folder=maps_of_group(recorded.folder, plan, group),
                evaluation=evaluation,
                problem=problem,
                filter_name=plan.filter_name(group),
                label=", ".join(plan.words(group)),
            )
        )
    if not delay_rows(evaluations):
        raise EvaluationError(group_problems(evaluations))
    if len(plan.delays) > 1:
        for name in plan.filters or (None,):
            of_filter = [item for item in evaluations if item.filter_name == name]
            table = of_filter[0].folder.parent / "delays.csv"
            write_text(table, table_csv(delay_rows(of_filter)))
    return tuple(evaluations)


def delay_rows(evaluations: Collection[GroupEvaluation]) -> list[DelayRow]:
    """Rows of the table of the delays that could be evaluated."""
    return [
        DelayRow.of(group.delay_s, group.evaluation.maps)
        for group in evaluations
        if group.evaluation is not None and group.delay_s is not None
    ]


def group_problems(evaluations: Collection[GroupEvaluation]) -> str:
    """Reasons why groups could not be evaluated; empty if all were."""
    return "\n".join(f"at {group.label}: {group.problem}" for group in evaluations if group.problem)


def evaluate_folder(
    folder: str | Path | Acquisition | Measured,
    *,
    curve: CurveSource = "planck",
    frame: int = 0,
    group: Group | None = None,
    accept: Collection[str] = (),
    progress: Callable[[int, int], None] | None = None,
    say: Say | None = None,
) -> Evaluation:
    """Evaluates one filter and delay of an acquisition folder, or measured data, and stores the
    maps.

    They go into `maps` beside the images; those of several filters or delays into a folder each.

    Args:
        folder: acquisition, folder with measured.yaml, or such a file itself; or what
            `open_recorded` makes of it.
        curve, accept, progress: as `cldit.dit.recorded.evaluate_shots`; findings that
            measured.yaml accepts are accepted too.
        frame: which image of each shot, if the plan has several.
        group: which of the plan's filters and delays, by their numbers from 0; required if it has
            several.
        say: called with lines about measured files, before the fit.

    Returns:
        Maps (H, W), checks, error budget, remarks and calibration.

    Raises:
        RunFolderError: the folder contains no acquisition. Shots that are damaged or missing in
            the journal are omitted and named by the remarks.
        EvaluationError: the shots cannot be evaluated.
    """
    recorded = folder
    if not isinstance(recorded, Acquisition | Measured):
        recorded = open_recorded(recorded, frame=frame)
    missing: tuple[str, ...] = ()
    if isinstance(recorded, Measured):
        if group is not None:
            raise EvaluationError(f"{recorded.folder}: {group}: measured data have no groups")
        place = recorded.folder / "maps"
        if say is not None:
            for finding in recorded.found():
                say(finding)
        accept = (*recorded.accept, *accept)
    else:
        group = _group(recorded, group)
        place = maps_of_group(recorded.folder, recorded.plan, group)
        recorded = recorded.of_group(group)
        missing = recorded.missing
    recorded, evaluation = _evaluated(
        recorded, partial(evaluate_shots, curve=curve, accept=accept, progress=progress)
    )
    evaluation = replace(
        evaluation,
        remarks=(*_remarks(recorded, missing), *evaluation.remarks),
        origin=Origin.now(inputs=files_read(recorded.inputs)),
    )
    evaluation.save(place, pixel_m=recorded.pixel_m)
    return evaluation


def _evaluated(
    recorded: Acquisition | Measured, evaluate: Callable[[Acquisition | Measured], Evaluation]
) -> tuple[Acquisition | Measured, Evaluation]:
    """The evaluation, and the data that it is of: without the shots that are damaged."""
    try:
        return recorded, evaluate(recorded)
    except RunFolderError:
        if isinstance(recorded, Measured):
            raise
        undamaged = recorded.whole()  # reads every image, so only after damage
        try:
            return undamaged, evaluate(undamaged)
        except EvaluationError as error:  # too few remain
            raise EvaluationError("\n".join([*undamaged.damage, str(error)])) from error
    finally:
        if isinstance(recorded, Measured):
            recorded.close()


def _remarks(recorded: Acquisition | Measured, missing: Sequence[str]) -> tuple[str, ...]:
    """Remarks on shots that are missing or damaged."""
    damage = recorded.damage if isinstance(recorded, Acquisition) else ()
    if not missing:
        return tuple(damage)
    shown = ", ".join(missing[:5]) + (", .." if len(missing) > 5 else "")
    return f"{len(missing)} shots of the plan are missing ({shown})", *damage


def _group(acquisition: Acquisition, group: Group | None) -> Group:
    """The group to evaluate, which may be omitted if the plan has one."""
    plan = acquisition.plan
    if group is None and len(plan.groups) == 1:
        return plan.groups[0]
    if group is not None and group in plan.groups:
        return group
    names = "; ".join(f"{item}: {', '.join(plan.words(item))}" for item in plan.groups)
    raise EvaluationError(
        f"{acquisition.folder}: group {group}; allowed: one of {names}; evaluate_groups and "
        "`cldit evaluate` evaluate them all"
    )


def evaluate_scattering(
    recorded: Acquisition | Measured, model: Run, evaluation: Evaluation, maps: Path
) -> Medium:
    """Temperature of the emitting medium, with the scattered share of a model; stored as maps.

    model: run whose spray and camera represent those of the measurement, and whose patches are
    those of its enclosure, temperatures included. maps: folder of its maps.
    """
    view = SensorView.from_scene(model.scene)
    spray, reference = (
        weights.map(lambda image: view.image(image).astype(np.float32))
        for weights in (model.weights, model.reference)
    )
    curve = Curve(filter_um=evaluation.calibration.filter_um)
    if evaluation.fitted is not None:
        curve = evaluation.fitted.curve
    surroundings = recorded.surroundings
    if not surroundings.patches:  # neither a rig nor measured data describe them
        surroundings = replace(surroundings, patches=model.scene.patches)
    scattered = scattered_by(spray, reference, enclosure(surroundings, curve))
    medium = medium_temperature(evaluation.maps, scattered, curve)
    medium.save(maps, pixel_m=recorded.pixel_m)
    return medium
