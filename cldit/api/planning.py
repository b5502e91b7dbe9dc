"""Plans of measurements: backgrounds, injections and references for an error, or for a verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cldit.acquisition.plan import Plan, parse_plan, plan_from_scene
from cldit.comparison.rivals import in_band
from cldit.comparison.unknowns import DEFAULT, unknowns_of
from cldit.dit.design import (
    BlackBody,
    Design,
    Goal,
    chosen,
    designs,
    error_against_time,
    plan_of,
    shot_time_s,
)
from cldit.dit.separation import Separation
from cldit.dit.subject import Subject, coldest_K, opaque_errors_K
from cldit.errors import EvaluationError
from cldit.gpu.device import Device
from cldit.io.files import write_text
from cldit.io.plain_data import dump_yaml
from cldit.rig.protocols import Stability
from cldit.rig.simulated import simulated_rig_data
from cldit.run import Say, simulate
from cldit.run.series_plan import SeriesPlan, Times
from cldit.scene import Scene
from cldit.scene.delays import scene_at
from cldit.scene.load import chosen_scene
from cldit.show.figures.curves import design_figure
from cldit.show.figures.style import write_figure
from cldit.study.separate import separate as separations_of

# Temperatures of opaque sprays whose errors are reported: from that of a room to some 50 K above
# the boiling point of n-heptane, 372 K.
_OPAQUE_K = (300.0, 320.0, 340.0, 360.0, 380.0, 420.0)

LEAST_EMISSIVITY = 0.2
"""Pixels of a smaller emissivity are ignored by default; at 0.2 an error of 0.02 is a tenth."""


@dataclass(frozen=True, kw_only=True)
class PlannedMeasurement:
    """Designs that reach a goal, and the chosen one, which `plan` and its file contain.

    coldest_opaque_K: temperature down to which the chosen design resolves an opaque spray.
    opaque_errors_K: error by temperature of an opaque spray, of one reference and one injection in
    front of each background of the scene. files: plan.yaml, rig.yaml (simulated), the figure.
    """

    goal: Goal
    designs: tuple[Design, ...]
    chosen: Design
    plan: Plan
    coldest_opaque_K: float
    opaque_errors_K: dict[float, float]
    folder: Path
    files: tuple[Path, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "folder": self.folder,
            "goal": asdict(self.goal),
            "designs": [
                {**asdict(design), "chosen": design is self.chosen} for design in self.designs
            ],
            "coldest_opaque_K": self.coldest_opaque_K,
        }


@dataclass(frozen=True, kw_only=True)
class PlannedSeparation:
    """The nearest plan of each delay and band to tell two models apart.

    unknowns: free parameters with their deviations. plan: of the fastest delay and band; None, and
    no file, if no number of injections is enough.
    """

    separations: tuple[Separation, ...]
    unknowns: tuple[str, ...]
    plan: Plan | None
    folder: Path
    files: tuple[Path, ...]

    @property
    def chosen(self) -> Separation:
        """The fastest plan, or the one that comes nearest."""
        return min(self.separations, key=lambda separation: separation.order)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        plans = [
            {**asdict(separation), "chosen": separation is self.chosen, "verdict": separation.text}
            for separation in self.separations
        ]
        return {"folder": self.folder, "unknowns": self.unknowns, "plans": plans}


def plan(
    scene: Scene | str | Path,
    error_K: float,
    out: str | Path | None = None,
    *,
    emissivity_error: float = 0.02,
    quantile: float = 0.9,
    least_emissivity: float = LEAST_EMISSIVITY,
    limits_K: tuple[float, float] | None = None,
    suffix: str = ".png",
    device: Device | None = None,
    progress: Say | None = None,
) -> PlannedMeasurement:
    """Designs the measurement of a scene: backgrounds, shots and references for an error.

    Args:
        scene: a scene, a shipped name, or a YAML file.
        error_K: requested standard error of T_app.
        out: folder of the run, plan.yaml, rig.yaml and the figure; None: runs/SCENE-plan.
        emissivity_error: requested standard error of the emissivity.
        quantile: share of the pixels that must reach both.
        least_emissivity: pixels below it are ignored.
        limits_K: of the black body; None: lowest and highest background of the scene.
        suffix: of the figure: .png, .pdf or .svg.
        device: OpenCL device; None chooses.
        progress: called with lines of text.

    Returns:
        The designs that reach the errors, the chosen one, its plan and the written files.

    Raises:
        EvaluationError: a number is not allowed, or no design reaches the errors.
        ClditError: as `cldit.simulate`.
    """
    goal = _goal(error_K, emissivity_error, quantile, least_emissivity)
    scene = chosen_scene(scene)
    folder = Path("runs") / f"{scene.name}-plan" if out is None else Path(out)
    run = simulate(scene, folder, device=device, progress=progress)
    subject = Subject.of(
        scene, run.quadrature, run.spectral, run.reference, least_emissivity=least_emissivity
    )
    shot_s = shot_time_s(scene)
    candidates = designs(subject, _blackbody(scene, limits_K), goal, shot_s=shot_s)
    best = chosen(candidates)
    measurement = plan_of(best, scene)
    plan_file, rig_file = folder / "plan.yaml", folder / "rig.yaml"
    write_text(plan_file, measurement.dump())
    write_text(rig_file, dump_yaml(simulated_rig_data(scene, folder)))
    figure = _figure(subject, candidates, best, goal, shot_s, scene.name)
    return PlannedMeasurement(
        goal=goal,
        designs=tuple(candidates),
        chosen=best,
        plan=measurement,
        coldest_opaque_K=_coldest_opaque_K(subject, best, error_K),
        opaque_errors_K=_opaque_errors(subject, scene.background.temperatures_K),
        folder=folder,
        files=(plan_file, rig_file, write_figure(figure, folder / f"design{suffix}")),
    )


def _goal(
    error_K: float, emissivity_error: float, quantile: float, least_emissivity: float
) -> Goal:
    """The goal of a plan. Raises EvaluationError for numbers that are not allowed."""
    for name, value, largest in (
        ("error_K", error_K, np.inf),
        ("emissivity_error", emissivity_error, np.inf),
        ("quantile", quantile, 1.0),
        ("least_emissivity", least_emissivity, 1.0),
    ):
        if not 0.0 < value <= largest:
            limit = "0 < value <= 1" if largest == 1.0 else "above 0"
            raise EvaluationError(f"{name}: {value:g}; allowed: {limit}")
    return Goal(error_K=error_K, emissivity_error=emissivity_error, quantile=quantile)


def _figure(
    subject: Subject,
    candidates: Sequence[Design],
    best: Design,
    goal: Goal,
    shot_s: float,
    name: str,
) -> Figure:
    """Error of each design against the time of the measurement."""
    lines = [
        (design, *error_against_time(subject, design, goal, shot_s=shot_s)) for design in candidates
    ]
    return design_figure(lines, best, goal, title=f"{name}: error against time")


def _coldest_opaque_K(subject: Subject, design: Design, error_K: float) -> float:
    """Temperature down to which a design resolves an opaque spray to `error_K`."""
    sizes = {"shots": design.shots, "references": design.references}
    backgrounds_K = design.backgrounds_K
    return float(coldest_K(subject, backgrounds_K, error_K=error_K, emissivity=1.0, **sizes))


def _opaque_errors(subject: Subject, backgrounds_K: Sequence[float]) -> dict[float, float]:
    """Errors of opaque sprays by their temperature; none for a single background."""
    if len(backgrounds_K) < 2:
        return {}
    errors_K = opaque_errors_K(subject, np.array(_OPAQUE_K), backgrounds_K, emissivity=1.0)
    return dict(zip(_OPAQUE_K, errors_K.tolist(), strict=True))


def separate(
    one: Scene | str | Path,
    other: Scene | str | Path,
    out: str | Path | None = None,
    *,
    delays: Times | None = None,
    bands: Sequence[Scene | str | Path] = (),
    unknowns: Mapping[str, float | str] | str | Path | None = None,
    least_emissivity: float = LEAST_EMISSIVITY,
    limits_K: tuple[float, float] | None = None,
    device: Device | None = None,
    progress: Say | None = None,
) -> PlannedSeparation:
    """Plans a measurement that separates two models of a spray; `cldit plan --separate`.

    Args:
        one, other: scenes, shipped names, or YAML files.
        out: folder of the runs and of plan.yaml; None: runs/ONE-or-OTHER.
        delays: to choose from, as `times` of `cldit.run_series`; None: those of the first scene.
        bands: scenes whose filter and optical properties are further choices, such as
            `gdi-extinction`. The plan then names its filter, of a wheel, as its scene.
        unknowns: standard deviation of each key that is not known, in its unit or as `"5 %"`, or a
            YAML file of them; `[*]` is each item of a list. None: mixing length, cone angle, drop
            size, mass, start and temperature of the gas, as far as the scene has them.
        least_emissivity, limits_K: as for `cldit.plan`.
        device: OpenCL device; None chooses.
        progress: called with lines of text.

    Returns:
        The nearest plan of each delay and band, and the plan of the fastest, or None.

    Raises:
        EvaluationError: the scenes are not seen alike.
        StudyError: a key or deviation of `unknowns` is not allowed.
        ClditError: as `cldit.simulate`.
    """
    baseline, rival = chosen_scene(one), chosen_scene(other)
    folder = Path("runs") / f"{baseline.name}-or-{rival.name}" if out is None else Path(out)
    delays_s = SeriesPlan.of(baseline, delays).scenes if delays else baseline.plan.delays_s
    filters = _filters(baseline, [chosen_scene(band) for band in bands])
    free = unknowns_of(baseline, DEFAULT if unknowns is None else unknowns)
    separations = separations_of(
        baseline,
        rival,
        folder,
        _blackbody(baseline, limits_K),
        delays_s=tuple(delays_s),
        bands=filters,
        unknowns=free,
        least_emissivity=least_emissivity,
        device=device,
        progress=progress,
    )
    texts = tuple(unknown.text for unknown in free)
    planned = PlannedSeparation(
        separations=tuple(separations), unknowns=texts, plan=None, folder=folder, files=()
    )
    return _with_plan(planned, baseline, filters)


def _filters(baseline: Scene, bands: Sequence[Scene]) -> dict[str, Scene]:
    """Scenes of further bands by name, which are the names of filters of a wheel."""
    filters = {scene.name: scene for scene in bands}
    if filters:
        names = [baseline.name, *filters]
        background_K = min(baseline.background.temperatures_K)
        parse_plan({"backgrounds_K": [background_K], "filters": names}, source="names of scenes")
    return filters


def _with_plan(
    planned: PlannedSeparation, baseline: Scene, filters: Mapping[str, Scene]
) -> PlannedSeparation:
    """Writes the plan of the fastest measurement; no number of shots may be enough."""
    best = planned.chosen
    if best.shots is None:
        return planned
    measured = baseline if best.delay_s is None else scene_at(baseline, best.delay_s)
    if best.band:
        measured = in_band(measured, filters[best.band])
    sizes = {"backgrounds_K": best.backgrounds_K, "shots": best.shots, "references": best.shots}
    wheel = (best.band or baseline.name,) if filters else ()
    update = {**sizes, "delays_s": (), "filters": wheel}
    measurement = plan_from_scene(measured).model_copy(update=update)
    file = planned.folder / "plan.yaml"
    write_text(file, measurement.dump())
    return replace(planned, plan=measurement, files=(file,))


def _blackbody(scene: Scene, limits_K: tuple[float, float] | None) -> BlackBody:
    """The black body of a scene's simulated rig."""
    backgrounds_K = scene.background.temperatures_K
    return BlackBody(
        limits_K=limits_K or (min(backgrounds_K), max(backgrounds_K)),
        start_K=scene.rig.background_start_K,
        time_constant_s=scene.rig.background_time_constant_s,
        stability=Stability(),
    )
