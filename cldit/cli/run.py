"""`cldit run`: the main job."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click

from cldit.accuracy.errors import Errors
from cldit.api.experiment import run_experiment
from cldit.api.series import run_series
from cldit.cli.as_json import Outcome, json_option
from cldit.cli.case_options import case_options, spray_keys
from cldit.cli.console import OUT, ProgressBar, escaped, folded_table, plain_errors
from cldit.cli.scene_name import SCENE
from cldit.cli.series import series_outcome
from cldit.cli.units import KELVIN
from cldit.errors import SceneError
from cldit.gpu.device import open_device
from cldit.run import Run, simulate
from cldit.scene import Scene, load_scene, parse_scene
from cldit.scene.change import parse_change
from cldit.show.figures.figures import human_figures

_QUICK_PIXELS = (128, 128)
_QUICK_K = 4.0


@click.command()
@click.argument("scene", type=SCENE)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the run; runs/SCENE.")
@click.option(
    "--cfd",
    type=click.Path(path_type=Path),
    help="Take the spray from a CFD result, or from what `cldit import` wrote.",
)
@case_options
@click.option("--order", type=int, help="Most scatterings, beyond which the wall is seen; or all.")
@click.option(
    "--method",
    type=click.Choice(["source", "path", "branching"]),
    help="source: fast (default); path: unbiased, slow; branching: the paper's.",
)
@click.option(
    "--phase", help="isotropic, mie, or g of Henyey and Greenstein; as the preset has it."
)
@click.option(
    "--preset",
    type=click.Choice(["paper", "spectral"]),
    help="Optics at one wavelength, as in the paper, or over all of the filter.",
)
@click.option(
    "--accuracy",
    "accuracy_K",
    type=KELVIN,
    help="Error allowed in T_app, K, of all causes of the simulation together; 1 K.",
)
@click.option(
    "--device",
    help="OpenCL device: platform:device, or part of its name; several with commas.",
)
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Any key of the scene, such as walls.temperature_K=500; as often as wanted.",
)
@click.option("--pixels", metavar="N|NxM", help="Columns and rows of the picture.")
@click.option("--field", "field_mm", metavar="MM|MMxMM", help="Width and height of the field, mm.")
@click.option(
    "--times",
    metavar="all|A,B,..|::N",
    help="A series: all times of the case, some (0.5ms,1ms), or every Nth; one folder a time.",
)
@click.option("--quick", is_flag=True, help="A first look: 128 x 128 pixels, 4 K.")
@click.option("--trace-only", is_flag=True, help="Without the rig: trace and noise-free maps.")
@json_option
@plain_errors
def run(
    scene: str,
    out: Path | None,
    cfd: Path | None,
    order: int | None,
    method: str | None,
    phase: str | None,
    preset: str | None,
    accuracy_K: float | None,
    device: str | None,
    changes: tuple[str, ...],
    pixels: str | None,
    field_mm: str | None,
    times: str | None,
    quick: bool,
    trace_only: bool,
    **options: Any,
) -> Outcome:
    """Simulate SCENE (a shipped name or a YAML file), record it with the rig, evaluate."""
    transport = {
        "order": order,
        "method": method,
        "phase": _phase(phase),
        "accuracy_K": accuracy_K,
    }
    keys = spray_keys(options)
    if times is not None and "time_s" in keys:
        raise SceneError(f"--times {times} and --time {keys['time_s']}: allowed is one of them")
    if "mapping" in keys:
        keys["mapping"] = str(keys["mapping"].resolve())
    chosen = _changed(load_scene(scene), cfd=cfd, keys=keys, preset=preset, transport=transport)
    chosen = chosen.with_(**picture_changes(pixels, field_mm, quick=quick, accuracy_K=accuracy_K))
    chosen = chosen.with_(**dict(parse_change(text) for text in changes))
    folder = out or Path("runs") / chosen.name
    opened = open_device(device)
    OUT.print(f"{chosen.name}: {chosen.description}")
    OUT.print(f"OpenCL device {opened.info.index} {opened.info.name}: {opened.reason}")
    with ProgressBar() as bar:
        if times is not None:
            series = run_series(
                chosen,
                folder,
                times=times,
                trace_only=trace_only,
                device=opened,
                progress=bar.say,
                watch=bar.watch,
            )
        elif trace_only:
            result = simulate(chosen, folder, device=opened, progress=bar.say, watch=bar.count)
        else:
            result = run_experiment(
                chosen, folder, device=opened, progress=bar.say, watch=bar.watch
            )
    if times is not None:
        return series_outcome(series)
    _summary(result)
    return Outcome(_data(result))


def _data(result: Run) -> dict[str, Any]:
    """What scripts want to know of a run."""
    maps = {"trace": result.maps, "acquired": result.measured}
    pixels = {
        name: {reason.name.lower(): count for reason, count in one.count().items()}
        for name, one in maps.items()
        if one is not None
    }
    return {"name": result.scene.name, "folder": result.folder, "pixels": pixels,
            **result.info.to_dict()}  # fmt: skip


def picture_changes(
    pixels: str | None, field_mm: str | None, *, quick: bool, accuracy_K: float | None
) -> dict[str, Any]:
    """What the short options change, as `Scene.with_` takes it.

    Args:
        pixels: columns and rows, `N` or `NxM`.
        field_mm: width and height, as `pixels`.
        quick: whether it is a first look.
        accuracy_K: that was asked for, which `quick` leaves as it is.

    Returns:
        Values by the path of their key.

    Raises:
        SceneError: a text is neither one number nor two.
    """
    made: dict[str, Any] = {}
    if quick:
        made["camera.pixels"] = list(_QUICK_PIXELS)
        if accuracy_K is None:
            made["transport.accuracy_K"] = _QUICK_K
    if pixels is not None:
        made["camera.pixels"] = [int(one) for one in _two("--pixels", pixels, r"[0-9]+")]
    if field_mm is not None:
        sides = _two("--field", field_mm, r"[0-9]*\.?[0-9]+")
        made["camera.field_m"] = [float(one) * 1e-3 for one in sides]
    return made


def _two(option: str, text: str, number: str) -> tuple[str, str]:
    """`N` or `NxM`."""
    match = re.fullmatch(rf"({number})(?:x({number}))?", text.strip())
    if match is None:
        raise SceneError(f"{option} {text}: allowed is one number for both sides, or two as 3x4")
    return match[1], match[2] or match[1]


def _phase(text: str | None) -> str | dict[str, float] | None:
    """A number is g of Henyey and Greenstein; names are left for the scene's checks."""
    try:
        return None if text is None else {"henyey_greenstein": float(text)}
    except ValueError:
        return text


def _changed(
    scene: Scene,
    *,
    cfd: Path | None,
    keys: dict[str, Any],
    preset: str | None,
    transport: dict[str, Any],
) -> Scene:
    """The scene with what the command line overrides, checked again."""
    data = scene.model_dump(mode="json")
    if cfd is not None:
        data["spray"] = {"model": "cfd", "file": str(cfd.resolve()), **keys}
        data["name"] = f"{scene.name}-{cfd.resolve().name}"
        data["description"] = f"the spray of {cfd.name} before the rig of {scene.name}"
    else:
        data["spray"].update(keys)
    if preset is not None:
        data["optics"]["preset"] = preset
    data["transport"].update({key: value for key, value in transport.items() if value is not None})
    return parse_scene(data, source="command line")


def _print_errors(errors: Errors) -> None:
    """Prints the error of T_app, and what each cause adds."""
    OUT.print(f"error of T_app, RMS over the pixels that have one: {errors.text}")
    table = folded_table("cause", "K", "held by", "how it is known")
    for cause in errors.causes:
        table.add_row(cause.name, cause.text.removesuffix(" K"), cause.fixed, cause.how)
    OUT.print(table)
    if errors.model:
        OUT.print("the model's own spread, not in the sum:")
        for cause in errors.model:
            OUT.print(f"  {cause.name}: {cause.text} ({cause.how})", style="dim")


def _summary(result: Run) -> None:
    table = folded_table("stage", "s", "")
    for stage in result.info.stages:
        table.add_row(stage.name, f"{stage.seconds:.2f}", stage.note)
    OUT.print(table)
    if result.errors is not None:
        _print_errors(result.errors)
    elif result.info.accuracy_K is not None:
        OUT.print(f"estimated error of the trace in T_app: {result.info.accuracy_K:.2g} K RMS")
    for file in result.info.files:
        OUT.print(escaped(f"  {file.text}"), style="dim")
    for name, text in human_figures(result.info.spray).items():
        OUT.print(f"  {name}: {text}", style="dim")
    if result.folder is not None:
        for name in ("pictures/maps.png", "report.html"):
            if (result.folder / name).is_file():
                OUT.print(f"{result.folder / name}")
