"""`cldit evaluate`: recorded and measured images to maps."""

from pathlib import Path
from typing import Any

import click
import numpy as np

from cldit.acquisition import measured_draft
from cldit.acquisition.measured import Measured, open_recorded
from cldit.acquisition.progress import Progress
from cldit.acquisition.record import Acquisition, acquisition_in
from cldit.acquisition.witness_names import ACCEPTABLE
from cldit.api.folder_evaluation import (
    GroupEvaluation,
    delay_rows,
    evaluate_groups,
    evaluate_scattering,
    group_problems,
)
from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors, print_problem
from cldit.cli.options import PATH, figures_option
from cldit.cli.program import Exit
from cldit.cli.results import print_files, print_maps, print_next
from cldit.dit.maps import Maps
from cldit.dit.recorded import CurveSource, Evaluation
from cldit.errors import EvaluationError
from cldit.run import Run, open_run
from cldit.scene.delays import same_time, spray_time_s
from cldit.show.report.folders import show_folder, write_pages


@click.command()
@click.argument("folder", type=PATH)
@click.option(
    "--calibration",
    type=click.Choice(["planck", "fitted"]),
    default="planck",
    help="Curve from Planck, filter and detector, or fitted to the references.",
)
@click.option("--frame", type=click.IntRange(0), default=0, help="Which image of each shot.")
@click.option(
    "--accept",
    type=click.Choice(ACCEPTABLE),
    multiple=True,
    help="Evaluate whatever this witness finds; may be repeated.",
)
@click.option(
    "--model",
    type=PATH,
    help="Run that models the spray: adds the temperature of the emitting medium.",
)
@click.option(
    "--write-measured",
    type=PATH,
    help="Draft measured.yaml from the images in FOLDER and their names, and stop.",
)
@figures_option
@json_option
@plain_errors
def evaluate(
    folder: Path,
    calibration: CurveSource,
    frame: int,
    accept: tuple[str, ...],
    model: Path | None,
    write_measured: Path | None,
    suffix: str | None,
) -> Outcome:
    """Evaluate an acquisition, a run, or measured data (a FOLDER with measured.yaml).

    The maps go into `maps` beside the images, with a page, report.html; those of several filters
    and delays into a folder each, with a table of the delays.
    """
    if write_measured is not None:
        return _draft(folder, write_measured)
    target = acquisition_in(folder)
    recorded = open_recorded(target, frame=frame)
    with ProgressBar() as bar:
        evaluations = evaluate_groups(
            recorded,
            curve=calibration,
            accept=accept,
            say=lambda line: OUT.print(escaped(line)),
            progress=lambda done, total: bar.watch(Progress("shots", done, total, None)),
        )
    modelled = None if model is None else open_run(model)
    if modelled is not None and not any(
        _shows(modelled, group, evaluations) for group in evaluations
    ):
        raise EvaluationError(f"--model: {model}: it has none of the plan's delays and filters")
    for group in evaluations:
        if group.label:
            OUT.print(f"{group.label}:")
        if group.evaluation is not None:
            _print(group.evaluation)
            if modelled is not None and _shows(modelled, group, evaluations):
                _scattering(recorded, modelled, group.evaluation, group.folder)
            _print_result(group.evaluation.maps)
        print_files(group.folder)
    for table in sorted({group.folder.parent / "delays.csv" for group in evaluations}):
        if table.is_file():
            of_filter = [group for group in evaluations if group.folder.parent == table.parent]
            for row in delay_rows(of_filter):
                OUT.print(row.text)
            print_files(table)
    print_files(*write_pages(target))
    if suffix is not None:
        print_files(show_folder(target, suffix=suffix))
    print_next("cldit", "view", folder)
    if problems := group_problems(evaluations):
        print_problem(problems)
    return Outcome(
        {"delays": [_data(group) for group in evaluations]}, Exit.FAILED if problems else Exit.DONE
    )


def _draft(folder: Path, measured: Path) -> Outcome:
    """Writes a draft of measured.yaml, and prints what is missing in it."""
    _, *missing = lines = measured_draft.write_measured(folder, measured)
    for line in lines:
        OUT.print(escaped(line))
    if missing:
        OUT.print(escaped(f"complete and uncomment these in {measured} first"))
    print_next("cldit", "evaluate", measured)
    return Outcome({"measured": measured})


def _data(group: GroupEvaluation) -> dict[str, Any]:
    return {
        "delay_s": group.delay_s,
        "filter": group.filter_name,
        "folder": group.folder,
        "problem": group.problem,
        "evaluation": None if group.evaluation is None else group.evaluation.to_dict(),
    }


def _print(evaluation: Evaluation) -> None:
    for reason, count in evaluation.maps.count().items():
        OUT.print(f"{count:9d} pixels: {reason.text}")
    for line in evaluation.lines:
        OUT.print(escaped(line))


def _print_result(maps: Maps) -> None:
    print_maps(maps, recorded=True)
    error_K = maps.apparent_temperature_standard_error_K
    if np.isfinite(error_K).any():
        OUT.print(f"standard error of T_app: {np.nanmedian(error_K):.2g} K (median)", style="bold")


def _shows(model: Run, group: GroupEvaluation, evaluations: tuple[GroupEvaluation, ...]) -> bool:
    """True if the model has this delay and this filter; a single one is not checked."""
    if group.evaluation is None or len(evaluations) == 1:
        return len(evaluations) == 1
    filter_um = group.evaluation.calibration.filter_um
    if group.filter_name is not None and filter_um != model.quadrature.filter_um:
        return False
    one_delay = len({item.delay_s for item in evaluations}) == 1
    return one_delay or same_time(spray_time_s(model.scene), group.delay_s)


def _scattering(
    recorded: Acquisition | Measured, model: Run, evaluation: Evaluation, maps: Path
) -> None:
    medium = evaluate_scattering(recorded, model, evaluation, maps)
    valid = np.isfinite(medium.temperature_K)
    changed = medium.temperature_K - evaluation.maps.apparent_temperature_K
    OUT.print(
        f"{int(valid.sum()):9d} pixels: temperature of the medium, without scattered walls; "
        f"{float(np.mean(changed[valid])) if valid.any() else 0.0:+.2g} K against T_app"
    )
