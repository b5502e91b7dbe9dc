"""`cldit plan`: the measurement that reaches a requested error in the least time."""

from dataclasses import asdict
from pathlib import Path

import click
import numpy as np

from cldit.acquisition.plan import plan_from_scene
from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, ProgressBar, plain_errors, print_table, say
from cldit.cli.options import KELVIN, PATH, SCENE, device_option, figures_option
from cldit.cli.program import Exit
from cldit.cli.results import print_files, print_next
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
from cldit.dit.subject import Subject, coldest_K, opaque_errors_K
from cldit.io.files import write_text
from cldit.io.plain_data import dump_yaml
from cldit.rig.protocols import Stability
from cldit.rig.simulated import simulated_rig_data
from cldit.run import simulate
from cldit.run.series_plan import SeriesPlan
from cldit.run.trusted import open_device
from cldit.scene import Scene, load_scene
from cldit.scene.delays import delay_text, scene_at
from cldit.show.figures.curves import design_figure
from cldit.show.figures.style import write_figure
from cldit.study.separate import separate as plans_for

_COLD_K = (300.0, 320.0, 340.0, 360.0, 380.0, 420.0)


@click.command("plan")
@click.argument("scene", type=SCENE, required=False)
@click.option("--error", "error_K", type=KELVIN, help="Requested for T_app: 2K.")
@click.option(
    "--separate",
    type=(SCENE, SCENE),
    metavar="A B",
    help="In place of SCENE and --error: tell two models of a spray apart.",
)
@click.option("--delays", metavar="MS,MS,..", help="With --separate: delays to choose from.")
@click.option(
    "--emissivity-error",
    type=click.FloatRange(1e-5, 1.0),
    default=0.02,
    help="Requested for the emissivity.",
)
@click.option(
    "--quantile",
    type=click.FloatRange(0.01, 1.0),
    default=0.9,
    help="Share of the pixels that must reach the error.",
)
@click.option(
    "--emissivity",
    "least_emissivity",
    type=click.FloatRange(1e-3, 1.0),
    default=0.2,
    help="Pixels below it are ignored.",
)
@click.option(
    "--limits",
    "limits_K",
    type=(KELVIN, KELVIN),
    help="Of the black body; default: lowest and highest background of the scene.",
)
@click.option("--out", type=PATH, help="Folder; default: runs/SCENE-plan.")
@figures_option
@device_option
@json_option
@plain_errors
def plan_command(
    scene: str | None,
    error_K: float | None,
    separate: tuple[str, str] | None,
    delays: str | None,
    emissivity_error: float,
    quantile: float,
    least_emissivity: float,
    limits_K: tuple[float, float] | None,
    out: Path | None,
    suffix: str | None,
    device: str | None,
) -> Outcome:
    """Design the measurement of SCENE: backgrounds, shots and references for an error.

    Writes plan.yaml, rig.yaml (simulated) and a figure into the folder of a traced run. With
    --separate, the plan is for the difference of two models, or none is enough (status 3).
    """
    if separate is not None:
        if scene is not None or error_K is not None:
            raise click.UsageError("--separate A B takes the place of SCENE and --error")
        return _separate(*separate, delays, limits_K, least_emissivity, out, device)
    if scene is None or error_K is None or delays is not None:
        raise click.UsageError("allowed: SCENE --error K, or --separate A B with --delays")
    loaded = load_scene(scene)
    folder = out or Path("runs") / f"{loaded.name}-plan"
    with ProgressBar() as bar:
        run = simulate(loaded, folder, device=open_device(device), progress=bar.say)
    subject = Subject.of(
        loaded, run.quadrature, run.spectral, run.reference, least_emissivity=least_emissivity
    )
    known = loaded.background.temperatures_K
    blackbody = _blackbody(loaded, limits_K)
    if not error_K > 0.0:
        raise click.BadParameter(f"{error_K:g} K; allowed: more than 0", param_hint="--error")
    goal = Goal(error_K=error_K, emissivity_error=emissivity_error, quantile=quantile)
    shot_s = shot_time_s(loaded)
    found = designs(subject, blackbody, goal, shot_s=shot_s)
    best = chosen(found)
    _print_designs(found, best, goal, least_emissivity)
    coldest = coldest_K(
        subject,
        best.backgrounds_K,
        error_K=error_K,
        emissivity=1.0,
        shots=best.shots,
        references=best.references,
    )
    if len(known) > 1:
        colds = np.array(_COLD_K)
        errors = opaque_errors_K(subject, colds, known, emissivity=1.0)
        each = ", ".join(f"{e:.2g} K at {k:g} K" for k, e in zip(colds, errors, strict=True))
        OUT.print(
            f"One reference and one injection in front of each of the scene's {len(known)} "
            f"backgrounds give the temperature of an opaque spray with an error of {each}."
        )
    OUT.print(
        f"With a {best.integration_time_s * 1e6:g} us exposure, this plan resolves an opaque spray "
        f"to {error_K:g} K down to {coldest:.0f} K.",
        style="bold",
    )
    rig, plan = folder / "rig.yaml", folder / "plan.yaml"
    write_text(plan, plan_of(best, loaded).dump())
    write_text(rig, dump_yaml(simulated_rig_data(loaded, folder)))
    lines = [(one, *error_against_time(subject, one, goal, shot_s=shot_s)) for one in found]
    figure = design_figure(lines, best, goal, title=f"{loaded.name}: error against time")
    drawn = write_figure(figure, folder / f"design{suffix or '.png'}")
    print_files(plan, rig, drawn)
    print_next("cldit", "acquire", rig, plan, "--out", folder / "shots")
    return Outcome(
        {
            "folder": folder,
            "goal": asdict(goal),
            "designs": [{**asdict(one), "chosen": one is best} for one in found],
            "coldest_opaque_K": coldest,
        }
    )


def _blackbody(scene: Scene, limits_K: tuple[float, float] | None) -> BlackBody:
    known = scene.background.temperatures_K
    return BlackBody(
        limits_K=limits_K or (min(known), max(known)),
        start_K=scene.rig.background_start_K,
        time_constant_s=scene.rig.background_time_constant_s,
        stability=Stability(),
    )


def _separate(
    one: str,
    other: str,
    delays: str | None,
    limits_K: tuple[float, float] | None,
    least_emissivity: float,
    out: Path | None,
    device: str | None,
) -> Outcome:
    """Prints the plan of each delay, and writes that of the fastest one."""
    first, second = load_scene(one), load_scene(other)
    folder = out or Path("runs") / f"{first.name}-or-{second.name}"
    given = SeriesPlan.of(first, delays).scenes if delays else first.plan.delays_s
    found = plans_for(
        first,
        second,
        folder,
        _blackbody(first, limits_K),
        delays_s=tuple(given),
        least_emissivity=least_emissivity,
        device=open_device(device),
        progress=say,
    )
    rows = [
        (
            "" if each.delay_s is None else delay_text(each.delay_s),
            f"{len(each.backgrounds_K)}: {each.backgrounds_K[0]:g} .. {each.backgrounds_K[-1]:g}",
            "none" if each.shots is None else str(each.shots),
            f"{each.distance:.2g}",
            f"{each.of_noise:.2g}",
            f"{each.rms_K:.2g}",
            "" if each.time_s is None else f"{each.time_s / 60:.0f}",
        )
        for each in found
    ]
    heads = ("delay", "backgrounds / K", "shots", "sigma", "by noise", "RMS / K", "min")
    print_table(*heads, rows=rows)
    best = min(found, key=lambda each: each.order)
    OUT.print(best.text, style="bold")
    if best.shots is not None:
        plan = plan_from_scene(first if best.delay_s is None else scene_at(first, best.delay_s))
        sizes = {"backgrounds_K": best.backgrounds_K, "shots": best.shots}
        plan = plan.model_copy(update={**sizes, "references": best.shots, "delays_s": ()})
        write_text(folder / "plan.yaml", plan.dump())
        print_files(folder / "plan.yaml")
    plans = [{**asdict(each), "chosen": each is best, "verdict": each.text} for each in found]
    code = Exit.DONE if best.shots is not None else Exit.DIFFERS
    return Outcome({"folder": folder, "plans": plans}, code)


def _print_designs(found: list[Design], best: Design, goal: Goal, least_emissivity: float) -> None:
    OUT.print(
        f"{100 * goal.quantile:g} % of the pixels of emissivity {least_emissivity:g} and more "
        f"within {goal.error_K:g} K and {goal.emissivity_error:g}:"
    )
    rows = [
        (
            "->" if one is best else "",
            f"{len(one.backgrounds_K)}: {one.backgrounds_K[0]:g} .. {one.backgrounds_K[-1]:g}",
            str(one.shots),
            str(one.references),
            f"{one.error_K:.2f}",
            f"{one.emissivity_error:.3f}",
            f"{one.time_s / 60:.0f}",
            f"{one.waiting_s / 60:.0f}",
        )
        for one in found
    ]
    heads = ("", "backgrounds / K", "shots", "refs", "T_app / K", "eps", "min", "waiting")
    print_table(*heads, rows=rows)
