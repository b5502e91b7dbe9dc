"""Evaluates what a folder holds, an acquisition or measured data, and stores the maps beside it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cldit.acquisition.measured import Measured, is_measured, open_measured
from cldit.acquisition.record import Acquisition, maps_folder, open_acquisition
from cldit.camera.curve import Curve
from cldit.camera.view import SensorView
from cldit.dit.delay_table import DelayRow, table_csv
from cldit.dit.recorded import CurveSource, Evaluation, evaluate_shots
from cldit.dit.scattering import Medium, enclosure, medium_temperature, scattered_by
from cldit.errors import EvaluationError, RunFolderError
from cldit.io.files import write_text
from cldit.io.images import write_image
from cldit.io.origin import Origin
from cldit.io.provenance import files_read
from cldit.run import Run, Say
from cldit.scene.delays import delay_text


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
