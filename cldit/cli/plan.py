"""`cldit plan`: the measurement that reaches a requested error in the least time."""

from pathlib import Path

import click

from cldit.api.planning import (
    LEAST_EMISSIVITY,
    PlannedMeasurement,
    PlannedSeparation,
    plan,
    separate,
)
from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, ProgressBar, plain_errors, print_table, say
from cldit.cli.options import KELVIN, PATH, SCENE, device_option, figures_option
from cldit.cli.program import Exit
from cldit.cli.results import print_files, print_next
from cldit.dit.separation import OBSERVABLES, Separation
from cldit.run.trusted import open_device
from cldit.scene.delays import delay_text


@click.command("plan")
@click.argument("scene", type=SCENE, required=False)
@click.option("--error", "error_K", type=KELVIN, help="Requested for T_app: 2K.")
@click.option(
    "--separate",
    "rivals",
    type=(SCENE, SCENE),
    metavar="A B",
    help="In place of SCENE and --error: tell two models of a spray apart.",
)
@click.option("--delays", metavar="MS,MS,..", help="With --separate: delays to choose from.")
@click.option(
    "--band",
    "bands",
    type=SCENE,
    multiple=True,
    help="With --separate: a scene with another filter to choose from, such as gdi-extinction.",
)
@click.option(
    "--unknowns",
    type=PATH,
    help="With --separate: YAML file of what is not known, KEY: DEVIATION.",
)
@click.option("--out", type=PATH, help="Folder; default: runs/SCENE-plan.")
@figures_option
@device_option
@json_option
@plain_errors
def plan_command(
    scene: str | None,
    error_K: float | None,
    rivals: tuple[str, str] | None,
    delays: str | None,
    bands: tuple[str, ...],
    unknowns: Path | None,
    out: Path | None,
    suffix: str | None,
    device: str | None,
) -> Outcome:
    """Design the measurement of SCENE: backgrounds, shots and references for an error.

    Writes plan.yaml, rig.yaml (simulated) and a figure into the folder of a traced run. With
    --separate, the plan is for the difference of two models, or none is enough (status 3).
    """
    if rivals is not None:
        if scene is not None or error_K is not None:
            raise click.UsageError("--separate A B takes the place of SCENE and --error")
        return _separate(
            separate(
                *rivals,
                out,
                delays=delays,
                bands=bands,
                unknowns=unknowns,
                device=open_device(device),
                progress=say,
            )
        )
    if scene is None or error_K is None or delays or bands or unknowns:
        raise click.UsageError(
            "allowed: SCENE --error K, or --separate A B with --delays, --band and --unknowns"
        )
    if not error_K > 0.0:
        raise click.BadParameter(f"{error_K:g} K; allowed: more than 0", param_hint="--error")
    with ProgressBar() as bar:
        planned = plan(
            scene,
            error_K,
            out,
            suffix=suffix or ".png",
            device=open_device(device),
            progress=bar.say,
        )
    _print_designs(planned)
    _print_opaque(planned)
    print_files(*planned.files)
    plan_file, rig_file, _ = planned.files
    print_next("cldit", "acquire", rig_file, plan_file, "--out", planned.folder / "shots")
    return Outcome(planned.to_dict())


def _separate(planned: PlannedSeparation) -> Outcome:
    """Prints the plans to tell two models apart; the status is 3 if none is enough."""
    _print_separations(planned.separations)
    OUT.print(f"not known: {', '.join(planned.unknowns) or 'nothing'}")
    OUT.print(planned.chosen.text, style="bold")
    print_files(*planned.files)
    return Outcome(planned.to_dict(), Exit.DIFFERS if planned.plan is None else Exit.DONE)


def _print_opaque(planned: PlannedMeasurement) -> None:
    """Prints the errors of opaque sprays, and down to which temperature the plan resolves one."""
    if planned.opaque_errors_K:
        errors = ", ".join(
            f"{error:.2g} K at {kelvin:g} K" for kelvin, error in planned.opaque_errors_K.items()
        )
        OUT.print(
            "One reference and one injection in front of each of the scene's backgrounds give the "
            f"temperature of an opaque spray with an error of {errors}."
        )
    OUT.print(
        f"With a {planned.chosen.integration_time_s * 1e6:g} us exposure, this plan resolves an "
        f"opaque spray to {planned.goal.error_K:g} K down to {planned.coldest_opaque_K:.0f} K.",
        style="bold",
    )


def _print_separations(separations: tuple[Separation, ...]) -> None:
    rows = [
        (
            "" if separation.delay_s is None else delay_text(separation.delay_s),
            separation.band or "the scenes'",
            f"{len(separation.backgrounds_K)}: "
            f"{separation.backgrounds_K[0]:g} .. {separation.backgrounds_K[-1]:g}",
            "none" if separation.shots is None else str(separation.shots),
            f"{separation.distance:.2g}",
            *(f"{separation.distances[name]:.2g}" for name in OBSERVABLES),
            f"{separation.of_noise:.2g}",
            f"{separation.rms_K:.2g}",
            f"{separation.rms_emissivity:.2g}",
            "" if separation.time_s is None else f"{separation.time_s / 60:.0f}",
        )
        for separation in separations
    ]
    single = (f"by {name}" for name in OBSERVABLES)
    errors = ("by noise", "RMS / K", "of emissivity", "min")
    print_table("delay", "band", "backgrounds / K", "shots", "sigma", *single, *errors, rows=rows)


def _print_designs(planned: PlannedMeasurement) -> None:
    goal = planned.goal
    OUT.print(
        f"{100 * goal.quantile:g} % of the pixels of emissivity {LEAST_EMISSIVITY:g} and more "
        f"within {goal.error_K:g} K and {goal.emissivity_error:g}:"
    )
    rows = [
        (
            "->" if design is planned.chosen else "",
            f"{len(design.backgrounds_K)}: "
            f"{design.backgrounds_K[0]:g} .. {design.backgrounds_K[-1]:g}",
            str(design.shots),
            str(design.references),
            f"{design.error_K:.2f}",
            f"{design.emissivity_error:.3f}",
            f"{design.time_s / 60:.0f}",
            f"{design.waiting_s / 60:.0f}",
        )
        for design in planned.designs
    ]
    heads = ("", "backgrounds / K", "shots", "refs", "T_app / K", "eps", "min", "waiting")
    print_table(*heads, rows=rows)
