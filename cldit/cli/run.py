"""`cldit run`: simulate a scene, record it with a simulated rig, evaluate."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from cldit.accuracy.errors import Errors
from cldit.acquisition.progress import Progress
from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import (
    OUT,
    ProgressBar,
    escaped,
    plain_errors,
    print_problem,
    print_table,
)
from cldit.cli.options import (
    PATH,
    SCENE,
    Tolerances,
    case_options,
    figures_option,
    hide_case_options,
    pixels_of,
    replaced_by,
    spray_keys,
    two_numbers,
    verbose_option,
)
from cldit.cli.program import Exit
from cldit.cli.results import (
    print_cut,
    print_error,
    print_files,
    print_maps,
    print_next,
    print_reach,
)
from cldit.errors import SceneError
from cldit.io.extras import install_line
from cldit.run import Run, simulate
from cldit.run.folder import free_folder
from cldit.run.series_plan import SERIES_FILE
from cldit.run.stored_files import SCENE_FILE
from cldit.run.trusted import open_device
from cldit.scene import Scene, load_scene, parse_scene
from cldit.scene.change import parse_change
from cldit.scene.delays import delay_folder, same_time, scene_at, spray_time_s, without_delays
from cldit.scene.load import shipped_scenes, short_changes
from cldit.scene.scatter import members_of
from cldit.show.figures.readable import human_figures

if TYPE_CHECKING:
    from cldit.api.series import Series

_ABOVE = 1 / 12  # of a field's height is above the nozzle


@click.command()
@click.argument("scene", type=SCENE)
@click.option(
    "--out", type=PATH, help="Folder; default: runs/SCENE, or runs/SCENE-2 .. if it is taken."
)
@click.option(
    "--cfd",
    type=PATH,
    help="CFD result to take the spray from, or a file of `cldit import`, whose options it takes.",
)
@case_options
@click.option("--order", type=int, help="Largest number of scatterings; beyond it, the wall.")
@click.option(
    "--method",
    type=click.Choice(["source", "path", "branching"]),
    hidden=True,
    callback=replaced_by("--set transport.method=.."),
)
@click.option("--phase", hidden=True, callback=replaced_by("--set transport.phase=.."))
@click.option(
    "--preset",
    type=click.Choice(["paper", "spectral"]),
    help="Optics at one wavelength, as in the paper, or over the filter.",
)
@click.option(
    "--accuracy",
    type=Tolerances(),
    help="Tolerance of T_app, K, for all errors of the simulation, and of emissivity (1K,0.01); "
    "default: 1 K, and the emissivity that changes T_app by as much.",
)
@click.option(
    "--device", help="OpenCL device: platform:device, or part of its name; several with commas."
)
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Any key of the scene, such as walls.temperature_K=500; may be repeated.",
)
@click.option("--pixels", metavar="N|NxM", help="Pixels along the longer side, or both.")
@click.option(
    "--field",
    "field_mm",
    metavar="MM|MMxMM",
    help="Width and height of the field, mm; the nozzle is a twelfth of the height below its top.",
)
@click.option(
    "--times",
    metavar="all|A,B,..|::N",
    help="A series: all times of the case, some (0.5ms,1ms), or every Nth; a folder for each.",
)
@click.option(
    "--ensemble",
    "members",
    type=click.IntRange(1, 1000),
    help="Number of injections, which differ by spray.scatter; the image is their mean.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 1024),
    help="Processes that trace injections or times side by side; default: one after the other.",
)
@click.option("--scheduler", help="Address of a dask scheduler for the injections or times.")
@click.option("--quick", is_flag=True, help="Preview: 128 pixels along the longer side, 4 K.")
@click.option("--trace-only", is_flag=True, help="Without the rig: trace and noise-free maps.")
@figures_option
@verbose_option
@json_option
@plain_errors
def run(
    scene: str,
    out: Path | None,
    device: str | None,
    times: str | None,
    workers: int | None,
    scheduler: str | None,
    trace_only: bool,
    suffix: str | None,
    verbose: bool,
    **options: Any,
) -> Outcome:
    """Simulate SCENE (a shipped name or a YAML file), record it with the rig, evaluate."""
    chosen = _chosen(scene, times, **options)
    kept_scene = SCENE_FILE if times is None else SERIES_FILE
    folder = out or free_folder(Path("runs") / chosen.name, chosen, kept_scene)
    opened = open_device(device)
    OUT.print(f"{chosen.name}: {chosen.description}")
    if out is None and folder.name != chosen.name:
        taken = folder.parent / chosen.name
        OUT.print(escaped(f"{taken} has another scene; this run goes to {folder}"))
    if verbose:
        OUT.print(f"OpenCL device {opened.info.index} {opened.info.name}: {opened.reason}")
    shared = {"workers": workers, "scheduler": scheduler, "device": opened}
    aside = workers is not None or scheduler is not None
    with ProgressBar(stages=verbose) as bar:
        # The rig, the evaluation and figures take seconds to import.
        if times is not None:
            from cldit.api.series import run_series

            series = run_series(
                chosen,
                folder,
                times=times,
                trace_only=trace_only,
                device=opened,
                progress=bar.say,
                watch=bar.watch,
                suffix=suffix or ".png",
                ahead=partial(_times_aside, bar, shared) if aside else None,
            )
            return _series_outcome(series)
        if aside:
            _members_aside(chosen, folder, bar, shared)
        if trace_only:
            result = simulate(chosen, folder, device=opened, progress=bar.say, watch=bar.count)
        else:
            from cldit.api.experiment import run_experiment

            result = run_experiment(
                chosen, folder, device=opened, progress=bar.say, watch=bar.watch
            )
        if suffix is not None and not (suffix == ".png" and result.measured):
            from cldit.show.report.run_report import write_figures

            write_figures(result, suffix=suffix)
    if verbose:
        _print_stages(result)
    _print_run(result, suffix)
    return Outcome(_data(result))


hide_case_options(run)


def _times_aside(bar: ProgressBar, shared: dict[str, Any], scenes: Mapping[Path, Scene]) -> None:
    """Traces the times of a series before the run finds them."""
    from cldit.study.side_by_side import trace_scenes

    trace_scenes(scenes, progress=bar.say, watch=partial(_count, bar, "times"), **shared)


def _count(bar: ProgressBar, label: str, at: Any) -> None:
    bar.watch(Progress(label, at.done, at.total, at.remaining_s))


def _members_aside(scene: Scene, folder: Path, bar: ProgressBar, shared: dict[str, Any]) -> None:
    """Traces the injections of a scene, and of its delays, before the run finds them."""
    from cldit.study.side_by_side import trace_members  # brings the extra `studies`

    if members_of(scene) == 1:
        raise SceneError("--workers, --scheduler: one trace; allowed: with --ensemble N or --times")
    places = {folder: scene}
    for delay_s in scene.plan.delays_s:
        if not same_time(spray_time_s(scene), delay_s):
            places[folder / delay_folder(delay_s)] = without_delays(scene_at(scene, delay_s))
    for place, delay_scene in places.items():
        watch = partial(_count, bar, "injections")
        trace_members(delay_scene, place, progress=bar.say, watch=watch, **shared)


def _data(result: Run) -> dict[str, Any]:
    """Data of a run for scripts."""
    maps = {"trace": result.maps, "acquired": result.measured}
    pixels = {
        name: {reason.name.lower(): count for reason, count in evaluated.count().items()}
        for name, evaluated in maps.items()
        if evaluated is not None
    }
    statistics = result.ensemble
    ensemble = statistics and {"members": statistics.members, **statistics.figures(result.maps)}
    return {"name": result.scene.name, "folder": result.folder, "pixels": pixels,
            "ensemble": ensemble, **result.info.to_dict()}  # fmt: skip


def _field_changes(scene: Scene, field_mm: str | None) -> dict[str, Any]:
    """Changes of the camera by `--field`.

    The nozzle gets into the middle, a twelfth of the height below the upper edge, unless the scene
    has its nozzle at another place of the image, or none.
    """
    if field_mm is None:
        return {}
    sides = two_numbers("--field", field_mm, r"[0-9]*\.?[0-9]+")
    width, height = (float(side) * 1e-3 for side in sides)
    changes: dict[str, Any] = {"camera.field_m": [width, height]}
    target_m, own_m = scene.camera.target_m, _below_nozzle(scene.camera.field_m[1])
    free = target_m is None or np.allclose(target_m, own_m)
    if free and scene.spray.model not in ("none", "grid"):
        changes["camera.target_m"] = _below_nozzle(height)
    return changes


def _below_nozzle(height_m: float) -> list[float]:
    """Middle (x, y, z) of a field with the nozzle near its upper edge."""
    return [0.0, 0.0, -(0.5 - _ABOVE) * height_m]


def _phase(name: str | None) -> str | float | None:
    """Phase function by its name; a number is g of Henyey and Greenstein."""
    try:
        return None if name is None else float(name)
    except ValueError:
        return name


def _chosen(
    name: str,
    times: str | None,
    *,
    cfd: Path | None,
    order: int | None,
    method: str | None,
    phase: str | None,
    preset: str | None,
    accuracy: tuple[float, float | None] | None,
    changes: tuple[str, ...],
    pixels: str | None,
    field_mm: str | None,
    members: int | None,
    quick: bool,
    **case: Any,
) -> Scene:
    """Scene with the values of the command line, checked again."""
    keys = spray_keys(case)
    if times is not None and "time_s" in keys:
        raise SceneError(f"--times {times} and --time {keys['time_s']}: allowed: one of them")
    if "mapping" in keys:
        keys["mapping"] = str(keys["mapping"].resolve())
    scene = load_scene(name)
    data = scene.model_dump(mode="json")
    if cfd is not None:
        data["spray"] = {"model": "cfd", "file": str(cfd.resolve()), **keys}
        data["name"] = f"{scene.name}-{cfd.resolve().name}"
        data["description"] = f"the spray of {cfd.name} in the rig of {scene.name}"
        if scene.name in shipped_scenes():
            del data["transport"]["accuracy_K"]  # what its own spray allows
            del data["camera"]  # of the size of its own spray
    else:
        data["spray"].update(keys)
    if preset is not None:
        data["optics"]["preset"] = preset
    transport = {"order": order, "method": method, "phase": _phase(phase)}
    data["transport"].update({key: value for key, value in transport.items() if value is not None})
    scene = parse_scene(data, source="command line")
    longer = None if quick or field_mm is None else max(scene.camera.pixels)
    counts: int | list[int] | None = longer if pixels is None else pixels_of(pixels)
    scene = scene.with_(**_field_changes(scene, field_mm))
    scene = scene.with_(**short_changes(scene, quick=quick, pixels=counts, accuracy=accuracy))
    scene = scene.with_(**dict(parse_change(change) for change in changes))
    return scene if members is None else scene.with_(**{"spray.scatter.members": members})


def _print_stages(result: Run) -> None:
    """Prints stages, figures of the spray and error sources."""
    rows = ((stage.name, f"{stage.seconds:.2f}", stage.note) for stage in result.info.stages)
    print_table("stage", "s", "", rows=rows)
    for file in result.info.files:
        OUT.print(escaped(f"  {file.text}"), style="dim")
    for name, figure in human_figures(result.info.spray).items():
        OUT.print(f"  {name}: {figure}", style="dim")
    if result.errors is not None:
        _print_causes(result.errors)


def _print_run(result: Run, suffix: str | None) -> None:
    """Prints the result: maps, error, reach of the spray, files and the next command."""
    if result.measured is None:
        print_maps(result.maps, recorded=False)
    else:
        print_maps(result.measured, recorded=True)
    if result.ensemble is not None:
        OUT.print(f"{result.ensemble.members} injections, {result.ensemble.text(result.maps)}")
    if result.errors is not None:
        print_error(result.errors)
    elif result.info.accuracy_K is not None:
        OUT.print(f"error of T_app by the trace, RMS: {result.info.accuracy_K:.2g} K", style="bold")
    print_reach(result.info.spray, result.errors)
    print_cut(result.maps)
    if result.folder is not None:
        drawn = suffix or result.measured is not None
        names = [f"pictures/maps{suffix or '.png'}"] if drawn else ["maps"]
        names += ["report.html"] if result.measured is not None else []
        print_files(*(result.folder / name for name in names))
        print_next("cldit", "view", result.folder)


def _print_causes(errors: Errors) -> None:
    rows = [
        (cause.name, cause.text.removesuffix(" K"), cause.emissivity_text, cause.fixed, cause.how)
        for cause in errors.causes
    ]
    if rows:
        print_table("error by", "T_app, K", "emissivity", "fixed by", "estimated from", rows=rows)
    if errors.model:
        OUT.print("model and camera, not in the sum:")
        for cause in errors.model:
            OUT.print(f"  {cause.name}: {cause.text} ({cause.how})", style="dim")


_OF_TIME = (
    ("liquid_mass_kg", "liquid, mg", 1e6),
    ("vapour_mass_kg", "vapour, mg", 1e6),
    ("liquid_penetration_95_m", "95 % liquid to, mm", 1e3),
    ("vapour_penetration_m", "vapour to, mm", 1e3),
)


def _series_outcome(series: "Series") -> Outcome:
    """Prints a line for each time, the files, and the times that failed, which set the status."""
    from cldit.show.figures.film import mp4_possible

    rows = []
    for series_time in series.times:
        row = [_number(series_time.spray.get(name), factor) for name, _, factor in _OF_TIME]
        warm = None if series_time.dit is None else series_time.dit.apparent_temperature_K
        note = "" if series_time.state == "done" else series_time.state
        rows.append([series.plan.text(series_time.time), *row, _number(warm, 1.0), note])
    print_table("time", *(heading for _, heading, _ in _OF_TIME), "T_app, K", "", rows=rows)
    print_files(*series.files)
    if series.files and not mp4_possible():
        OUT.print(escaped(f"for film.mp4 too: {install_line('film')}"), style="dim")
    for series_time in series.failed:
        print_problem(f"{series.plan.text(series_time.time)}: {series_time.problem}")
    print_next("cldit", "view", series.folder)
    times = [
        {
            "time": series.plan.text(series_time.time),
            "state": series_time.state,
            "folder": series_time.folder,
            "problem": series_time.problem,
            "spray": series_time.spray,
        }
        for series_time in series.times
    ]
    code = Exit.FAILED if series.failed else Exit.DONE
    return Outcome({"times": times, "files": series.files}, code)


def _number(value: float | None, factor: float) -> str:
    return "" if value is None or value != value else f"{factor * value:.4g}"
