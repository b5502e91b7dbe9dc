"""`cldit import`, `cldit show SCENE --part spray`, and the old `cldit droplet`."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from cldit.acquisition.progress import Progress
from cldit.cfd import mapping_draft
from cldit.cfd.formats import contents
from cldit.cfd.importing import case_lines, cfd_spray, imported, list_case
from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors, print_table, say
from cldit.cli.options import PATH, case_options, device_option, spray_keys
from cldit.cli.results import print_files, print_next
from cldit.errors import SceneError
from cldit.io.files import write_text
from cldit.io.terminal import tell
from cldit.prepare.fitted_scene import fitted_scene
from cldit.prepare.spray_factory import make_spray
from cldit.run import default_cache
from cldit.run.trusted import open_device
from cldit.scene import load_scene
from cldit.scene.spray import LagrangianSpray
from cldit.show.figures.curves import life_figure
from cldit.show.figures.readable import human_figures
from cldit.show.figures.style import write_figure
from cldit.show.report.spray_report import write_spray
from cldit.spray.droplet.follow import COLUMNS, Life, follow
from cldit.spray.droplet.models import MODELS
from cldit.spray.flow.measures import History
from cldit.spray.flow.simulate import simulate_spray


def show_spray(scene: str, out: Path | None, suffix: str | None, device: str | None) -> None:
    """Computes the spray of a scene alone: figures, history, files for ParaView."""
    chosen = load_scene(scene)
    folder = out or Path("sprays") / chosen.name
    history: History | None = None
    if isinstance(chosen.spray, LagrangianSpray):
        with ProgressBar() as bar:

            def watch(time_s: float, end_s: float, parcels: int) -> None:
                phase = f"{time_s * 1e3:.3f} ms, {parcels} parcels"
                bar.watch(Progress(phase, round(time_s / end_s * 100), 100, None))

            spray, history, _ = simulate_spray(
                chosen.spray, open_device(device), cache=default_cache(), watch=watch
            )
    else:
        spray = make_spray(chosen.spray, open_device(device), cache=default_cache())
    for remark in spray.remarks:
        say(remark)
    written = write_spray(spray, history, folder, title=chosen.name, suffix=suffix or ".png")
    for name, figure in human_figures(spray.notes).items():
        OUT.print(f"{name}: {figure}")
    print_files(*written)
    print_next("cldit", "run", scene)


@click.command("import")
@click.argument("file", metavar="CASE", type=PATH)
@click.option("--list", "listed", is_flag=True, help="Only list times, fields and clouds.")
@click.option("--out", type=PATH, help="Keep the spray in this file, .npz.")
@click.option(
    "--write-mapping", type=PATH, help="Write the names found, to edit for --mapping, and stop."
)
@click.option(
    "--fit",
    is_flag=False,
    flag_value="",
    metavar="[SCENE.yaml]",
    help="Write a scene that fits the case; default: CASE.yaml.",
)
@click.option(
    "-v", "--verbose", is_flag=True, help="List every file read, with size, date and SHA-256."
)
@case_options
@json_option
@plain_errors
def import_command(
    listed: bool,
    out: Path | None,
    write_mapping: Path | None,
    fit: str | None,
    verbose: bool,
    file: Path,
    **options: Any,
) -> Outcome:
    """Check a CFD result CASE, print its properties, and keep it as a file of cldit."""
    spec = cfd_spray({"file": file, **spray_keys(options)})
    if write_mapping is not None:
        if listed or out is not None or fit is not None:
            raise SceneError(
                "--write-mapping writes only the names; give --list, --out and --fit without it"
            )
        for line in mapping_draft.write_mapping(spec, write_mapping):
            OUT.print(escaped(line))
        return Outcome({"mapping": write_mapping})
    scene = None if fit is None else Path(fit or f"{file.resolve().stem}.yaml")
    if listed and (out is not None or scene is not None):
        raise SceneError("--list writes nothing; give --out or --fit without it")
    if scene is not None and scene.exists():
        raise SceneError(f"{scene}: exists; --fit OTHER.yaml writes another")

    with ProgressBar() as bar:
        if listed:
            lines, data = list_case(spec), asdict(contents(spec))
        else:
            spray = imported(spec, out, watch=bar.count)
            written = [] if out is None else [out]
            if scene is not None:
                write_text(scene, fitted_scene(spec, spray, name=scene.stem))
                written.append(scene)
            lines = case_lines(spec, spray, files=verbose)
            data = {
                "case": spec.file,
                "figures": spray.notes,
                "remarks": spray.remarks,
                "files": [source.to_dict() for source in spray.files],
                "out": out,
                "scene": scene,
            }
    for line in lines:
        OUT.print(escaped(line))
    if not listed:
        print_files(*written)
        fitted = ["--cfd", str(out or file)] if scene is None else []
        print_next("cldit", "run", scene or "gdi", *fitted)
    return Outcome(data)


@click.command(deprecated="call cldit.spray.droplet.follow.follow in Python")
@click.option("--fuel", default="n-heptane", help="A name of CoolProp.")
@click.option("--gas", default="nitrogen")
@click.option("--model", default=next(iter(MODELS)), help=", ".join(MODELS))
@click.option("--diameter-um", type=float, default=9.0)
@click.option("--temperature", "temperature_K", type=float, default=370.0, help="Of the liquid, K.")
@click.option("--gas-temperature", "gas_temperature_K", type=float, default=573.0, help="K.")
@click.option("--pressure", "pressure_Pa", type=float, default=0.6e6, help="Pa.")
@click.option("--velocity", "velocity_m_s", type=float, default=0.0, help="In the gas, m/s.")
@click.option("--vapour", type=float, default=0.0, help="Mass fraction of fuel in the gas.")
@click.option("--held", is_flag=True, help="Keep the velocity: no drag.")
@click.option("--duration", "duration_s", type=float, help="s; default: until it has vanished.")
@click.option("--csv", "as_csv", is_flag=True, help="Print the columns as CSV.")
@click.option("--out", type=PATH, help="Draw the columns into this file (.png, .pdf or .svg).")
@device_option
@plain_errors
def droplet(diameter_um: float, as_csv: bool, out: Path | None, **conditions: Any) -> None:
    """Follow one droplet of fuel through hot gas until it has evaporated."""
    conditions |= {"device": open_device(conditions["device"]), "cache": default_cache()}
    life = follow(diameter_m=diameter_um * 1e-6, **conditions)
    if as_csv:
        tell(life.csv(), end="")
    if out is not None:
        title = (
            "{fuel}, {um:g} µm, in {gas} of {gas_temperature_K:g} K, {MPa:g} MPa: {model}"
        ).format(um=diameter_um, MPa=conditions["pressure_Pa"] / 1e6, **conditions)
        write_figure(life_figure(life, title=title), out)
    if not as_csv:
        _life_table(life)


def _life_table(life: Life) -> None:
    shown = list(life.rows())[:: max(1, life.time_s.size // 10)]
    print_table(*COLUMNS, rows=([f"{value:.5g}" for value in row] for row in shown))
    if life.vanished:
        OUT.print(f"vanished after {life.time_s[-1]:.5g} s")
