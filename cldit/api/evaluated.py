"""`cldit.evaluate`: evaluation of a folder in a script, as by the command `cldit evaluate`."""

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cldit.acquisition.measured import Measured, open_recorded
from cldit.acquisition.record import acquisition_in
from cldit.api.folder_evaluation import evaluate_folder, evaluate_scattering
from cldit.dit.recorded import CurveSource, Evaluation
from cldit.io.images import words
from cldit.io.presented import xarray_module
from cldit.run import Run, Say
from cldit.run.labelled import labelled_maps

if TYPE_CHECKING:
    import xarray


def evaluate(
    folder: str | Path,
    *,
    calibration: CurveSource = "planck",
    frame: int = 0,
    accept: Collection[str] = (),
    model: Run | None = None,
    say: Say | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> "xarray.Dataset":
    """Evaluates an acquisition, a run, or measured data, and stores the maps in `maps` beside it.

    Args:
        folder: acquisition, run, folder with measured.yaml, or such a file itself.
        calibration, accept, progress: as `cldit.dit.recorded.evaluate_shots` (`curve`).
        frame: which image of each shot, if the plan has several.
        model: run that models the spray: adds the temperature of the emitting medium.
        say: called with lines about the files before the fit.

    Returns:
        Variables named like the maps' files, (z, x) in mm; `cldit.plot` draws them. The attribute
        `evaluation` is the JSON of maps/evaluation.json without its inputs; `remarks` has a line
        for each remark, witness and part of the budget.

    Raises:
        ClditError: xarray is not installed; before anything is evaluated.
        RunFolderError: the folder contains no acquisition.
        EvaluationError: the shots cannot be evaluated.
        SceneError: measured.yaml is invalid.
    """
    xarray_module()
    place = acquisition_in(folder)
    recorded = open_recorded(place, frame=frame)
    evaluation = evaluate_folder(
        recorded, curve=calibration, accept=accept, progress=progress, say=say
    )
    extra_variables: dict[str, tuple[Any, str, str]] = {}
    if evaluation.budget is not None:
        for name, (image, unit) in evaluation.budget.images.items():
            extra_variables[name] = (image.astype(np.float32), unit, words(name))
    if model is not None:
        medium = evaluate_scattering(recorded, model, evaluation, recorded.folder / "maps")
        extra_variables |= {
            "medium_temperature_K": (medium.temperature_K, "K", "temperature of the medium"),
            "medium_temperature_standard_error_K": (medium.standard_error_K, "K", "its error"),
            "scattered_share": (medium.share, "1", "scattered share of the radiance"),
        }
    return labelled_maps(
        evaluation.maps,
        title=recorded.name if isinstance(recorded, Measured) else place.resolve().name,
        pixel_m=recorded.pixel_m,
        centre_m=recorded.centre_m,
        extra_variables=extra_variables,
        attrs={
            "evaluation": _without_inputs(evaluation).to_json(),
            "remarks": "\n".join(evaluation.lines),
        },
    )


def _without_inputs(evaluation: Evaluation) -> Evaluation:
    """Evaluation without its inputs, whose list may exceed 64 kB, the limit of HDF5 attributes."""
    if evaluation.origin is None:
        return evaluation
    return replace(evaluation, origin=replace(evaluation.origin, inputs=()))
