"""The command line: a thin layer over the Python API."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import click
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table

from cldit import __version__
from cldit.acquisition.bench import bench_rig
from cldit.acquisition.dry_run import SECONDS_PER_KELVIN, DryRun, dry_run
from cldit.acquisition.plan import load_plan
from cldit.acquisition.progress import Progress
from cldit.acquisition.runner import acquire
from cldit.errors import ClditError, RunFolderError
from cldit.experiment import evaluate_folder, run_experiment
from cldit.gpu.device import choose, list_devices, open_device
from cldit.report.droplets import convergence_picture, life_picture
from cldit.report.optics_figures import optics_picture
from cldit.report.optics_summary import scene_optics
from cldit.report.run_report import show_folder
from cldit.report.spray_report import write_spray
from cldit.rig.drivers import describe_drivers
from cldit.rig.errors import RigError
from cldit.rig.load import open_rig
from cldit.run import Run, default_cache, simulate
from cldit.scene import Scene, load_scene, parse_scene, shipped_scenes
from cldit.scene.schema import LagrangianSpray
from cldit.spray.droplet.convergence import measure_all
from cldit.spray.droplet.evaporation import MODELS
from cldit.spray.droplet.follow import COLUMNS, Life, follow
from cldit.spray.droplet.verification import page
from cldit.spray.flow.simulate import History, simulate_spray
from cldit.spray.importing import cfd_spray, import_case, list_case
from cldit.spray.source import make_spray

P = ParamSpec("P")
_OUT = Console(highlight=False, soft_wrap=True)
_ERR = Console(stderr=True, highlight=False, soft_wrap=True)


def _plain_errors(command: Callable[P, None]) -> Callable[P, None]:
    """Errors that cldit raises on purpose are messages; everything else keeps its traceback."""

    @wraps(command)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except ClditError as error:
            _ERR.print(f"[bold red]error:[/] {_escaped(str(error))}")
            sys.exit(1)
        except KeyboardInterrupt:
            _ERR.print("stopped; run the same command again to go on")
            sys.exit(130)

    return guarded


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def main() -> None:
    """Differential infrared thermography of fuel sprays: simulated, acquired, evaluated."""


@main.command()
@click.argument("scene")
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the run; runs/SCENE.")
@click.option(
    "--cfd",
    type=click.Path(path_type=Path),
    help="Take the spray from a CFD result, or from what `cldit import` wrote.",
)
@click.option("--time", "time_s", type=float, help="Time of the CFD result, s; the last one.")
@click.option("--order", type=int, help="Scattering orders; to a residual if left out.")
@click.option(
    "--method",
    type=click.Choice(["source", "path", "branching"]),
    help="source: fast (default); path: unbiased, slow; branching: the paper's.",
)
@click.option("--phase", help="isotropic, mie, or g of Henyey and Greenstein.")
@click.option("--accuracy", "accuracy_K", type=float, help="Error allowed in T_app, K.")
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@click.option("--trace-only", is_flag=True, help="Without the rig: trace and noise-free maps.")
@_plain_errors
def run(
    scene: str,
    out: Path | None,
    cfd: Path | None,
    time_s: float | None,
    order: int | None,
    method: str | None,
    phase: str | None,
    accuracy_K: float | None,
    device: str | None,
    trace_only: bool,
) -> None:
    """Simulate SCENE (a shipped name or a YAML file), record it with the rig, evaluate."""
    transport = {
        "order": order,
        "method": method,
        "phase": _phase(phase),
        "accuracy_K": accuracy_K,
    }
    chosen = _changed(load_scene(scene), cfd=cfd, time_s=time_s, transport=transport)
    folder = out or Path("runs") / chosen.name
    opened = open_device(device)
    _OUT.print(f"{chosen.name}: {chosen.description}")
    _OUT.print(f"OpenCL device {opened.info.index} {opened.info.name}: {opened.reason}")
    if trace_only:
        result = simulate(chosen, folder, device=opened, progress=_say)
    else:
        with _Bar() as bar:
            result = run_experiment(
                chosen, folder, device=opened, progress=bar.say, watch=bar.watch
            )
    _summary(result)


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
    time_s: float | None,
    transport: dict[str, Any],
) -> Scene:
    """The scene with what the command line overrides, checked again."""
    data = scene.model_dump(mode="json")
    if cfd is not None:
        data["spray"] = {"model": "cfd", "file": str(cfd.resolve()), "time_s": time_s}
        data["name"] = f"{scene.name}-{cfd.resolve().name}"
        data["description"] = f"the spray of {cfd.name} before the rig of {scene.name}"
    elif time_s is not None:
        data["spray"]["time_s"] = time_s
    data["transport"].update({key: value for key, value in transport.items() if value is not None})
    return parse_scene(data, source="command line")


def _say(text: str) -> None:
    _OUT.print(f"  {_escaped(text)}", style="dim")


class _Bar:
    """Lines of text as stages begin, and a bar while the rig records."""

    def __init__(self) -> None:
        self._bar = Bar(
            TextColumn("  {task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeRemainingColumn(),
            console=_OUT,
            transient=True,
        )
        self._task: Any = None

    def __enter__(self) -> _Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def say(self, text: str) -> None:
        if self._task is not None:
            self._bar.stop()
            self._bar.remove_task(self._task)
            self._task = None
        _say(text)

    def watch(self, progress: Progress) -> None:
        if self._task is None:
            self._task = self._bar.add_task(progress.phase, total=progress.total)
            self._bar.start()
        self._bar.update(
            self._task, description=progress.phase, completed=progress.done, total=progress.total
        )


def _summary(result: Run) -> None:
    table = Table("stage", "s", "", box=None)
    for stage in result.info.stages:
        table.add_row(stage.name, f"{stage.seconds:.2f}", stage.note)
    _OUT.print(table)
    if result.info.accuracy_K is not None:
        _OUT.print(f"estimated error of the trace in T_app: {result.info.accuracy_K:.2g} K RMS")
    for name, value in result.info.spray.items():
        _OUT.print(f"  {name}: {value:.5g}", style="dim")
    if result.folder is not None:
        for name in ("pictures/maps.png", "report.html"):
            if (result.folder / name).is_file():
                _OUT.print(f"{result.folder / name}")


@main.command("spray")
@click.argument("scene")
@click.option("--out", type=click.Path(path_type=Path), help="Folder; sprays/SCENE.")
@_plain_errors
def spray_command(scene: str, out: Path | None) -> None:
    """The spray of SCENE alone: pictures, figures against time, files for ParaView."""
    chosen = load_scene(scene)
    folder = out or Path("sprays") / chosen.name
    title = f"{chosen.name}: {chosen.description}" if chosen.description else chosen.name
    history: History | None = None
    if isinstance(chosen.spray, LagrangianSpray):
        with _Bar() as bar:

            def watch(time_s: float, end_s: float, parcels: int) -> None:
                phase = f"{time_s * 1e3:.3f} ms, {parcels} parcels"
                bar.watch(Progress(phase, round(time_s / end_s * 100), 100, None))

            found, history, _ = simulate_spray(chosen.spray, cache=default_cache(), watch=watch)
    else:
        found = make_spray(chosen.spray, cache=default_cache())
    for text in found.remarks:
        _say(text)
    for name, value in found.notes.items():
        _OUT.print(f"  {name}: {value:.5g}", style="dim")
    for path in write_spray(found, history, folder, title=title):
        _OUT.print(str(path))


@main.command("import")
@click.argument("case", type=click.Path(path_type=Path))
@click.option("--list", "listed", is_flag=True, help="Only list times, fields and clouds.")
@click.option("--out", type=click.Path(path_type=Path), help="cldit's own file, .npz.")
@click.option("--format", "kind", help="openfoam, vtk, ensight, converge or tables; else told.")
@click.option("--mapping", type=click.Path(path_type=Path), help="Names and units of fields, YAML.")
@click.option("--time", "time_s", type=float, help="Time, s; the last one.")
@click.option("--cloud", help="Cloud of parcels, where there are several.")
@click.option("--fuel-field", help="Cell field of the fuel's mass fraction; C7H16.")
@click.option("--fuel-molar-mass", "molar_mass", type=float, help="kg/mol; 0.100204.")
@click.option("--nozzle", type=(float, float, float), help="In the case's coordinates, m.")
@click.option("--axis", help="Of the injection: -y, +z, or three numbers as 0,-1,0.")
@_plain_errors
def import_command(
    case: Path,
    listed: bool,
    out: Path | None,
    kind: str | None,
    mapping: Path | None,
    time_s: float | None,
    cloud: str | None,
    fuel_field: str | None,
    molar_mass: float | None,
    nozzle: tuple[float, float, float] | None,
    axis: str | None,
) -> None:
    """Check a CFD result CASE, print its figures, and keep it as cldit's own file."""
    spec = cfd_spray(
        {
            "file": case,
            "format": kind,
            "mapping": mapping,
            "time_s": time_s,
            "cloud": cloud,
            "fuel_field": fuel_field,
            "fuel_molar_mass_kg_mol": molar_mass,
            "nozzle_m": nozzle,
            "axis": _axis(axis),
        }
    )
    lines = list_case(spec) if listed else import_case(spec, out)
    for line in lines:
        _OUT.print(_escaped(line))


def _axis(text: str | None) -> str | list[float] | None:
    """`-y` as it is, `0,-1,0` as numbers."""
    if text is None or "," not in text:
        return text
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is no direction", param_hint="--axis") from error


@main.command()
def scenes() -> None:
    """The scenes that are shipped."""
    table = Table("scene", "", box=None)
    for name, description in shipped_scenes().items():
        table.add_row(name, description)
    _OUT.print(table)


@main.command()
@click.option("--device", help="Show which device this choice means.")
@_plain_errors
def devices(device: str | None) -> None:
    """OpenCL devices: which there are, which is used, and why; and the drivers of instruments."""
    found = list_devices()
    used, reason = choose(found, device)
    table = Table("", "device", "kind", "name", "memory", "float64", "platform", box=None)
    for number, info in enumerate(found):
        table.add_row(
            "*" if number == used else "",
            info.index,
            info.kind,
            info.name,
            f"{info.memory_bytes / 1e9:.1f} GB",
            "yes" if info.float64 else "no",
            info.platform,
        )
    _OUT.print(table)
    _OUT.print(f"* is used: {reason}")
    drivers = Table("driver", "kind", "instrument", "tested", box=None)
    for name, about in describe_drivers().items():
        missing = about.missing()
        note = f"[yellow]needs cldit\\[rig] ({', '.join(missing)})[/]; " if missing else ""
        drivers.add_row(name, about.kind, about.instrument, note + about.tested)
    _OUT.print()
    _OUT.print(drivers)


@main.command()
@click.argument("scene")
@click.option("--out", type=click.Path(path_type=Path), help="The picture; SCENE-optics.png.")
@_plain_errors
def optics(scene: str, out: Path | None) -> None:
    """What SCENE's liquid, droplets, vapour and camera do to light: printed, and as a picture."""
    chosen = load_scene(scene)
    found = scene_optics(chosen, cache=default_cache())
    table = Table("", "scene", "data", "paper", "", box=None)
    for row in found.rows:
        table.add_row(row.quantity, row.scene, row.data, row.paper, f"[dim]{_escaped(row.note)}[/]")
    _OUT.print(table)
    for source in found.sources:
        _OUT.print(_escaped(source), style="dim")
    picture = out or Path(f"{chosen.name}-optics.png")
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_bytes(optics_picture(found))
    _OUT.print(str(picture))


@main.command("acquire")
@click.argument("rig", type=click.Path(path_type=Path))
@click.argument("plan", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the shots.")
@click.option("--dry-run", "dry", is_flag=True, help="Check and estimate; nothing moves or fires.")
@_plain_errors
def acquire_command(rig: Path, plan: Path, out: Path, dry: bool) -> None:
    """Record the sequence in PLAN with the instruments in RIG; resumes where it stopped."""
    sequence = load_plan(plan)
    if dry:
        asked = open_rig(rig)
        try:
            _estimate(dry_run(asked, sequence, out))
        finally:
            asked.close()  # not made safe: that would move the black body
        return
    with open_rig(rig) as opened, _Bar() as bar:
        record = acquire(opened, sequence, out, progress=bar.watch)
    _OUT.print(
        f"{record.saved} of {record.total} shots in {out}; {record.rejected} rejected, "
        f"{record.lost_injections} injections without a kept picture"
    )
    if not record.complete:
        raise RunFolderError("not complete; run the same command again to go on")


@main.group()
def bench() -> None:
    """Measure this computer."""


@bench.command("rig")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=Path("."),
    help="On the disk to be measured; here.",
)
@click.option("--frames", type=click.IntRange(10, 7000), default=300, show_default=True)
@click.option("--camera-rate", "rate_Hz", type=float, default=146.7, show_default=True)
@_plain_errors
def bench_rig_command(folder: Path, frames: int, rate_Hz: float) -> None:
    """Full frames (640 x 512) that the runner saves per second, every guarantee kept."""
    result = bench_rig(folder, frames=frames)
    _OUT.print(
        f"{result.frames_per_s:.0f} frames/s saved, {result.lost} lost; the camera takes "
        f"{rate_Hz:g}/s"
    )
    if result.lost:
        raise RigError(f"{result.lost} frames are lost; do not acquire on this disk")


def _estimate(found: DryRun) -> None:
    _OUT.print(
        f"{found.shots} shots at {len(found.backgrounds_K)} backgrounds: "
        f"{found.time_s / 60.0:.0f} min, of which {found.background_s / 60.0:.0f} min wait for "
        f"backgrounds at {SECONDS_PER_KELVIN:g} s/K; {found.disk_bytes / 1e6:.0f} MB of "
        f"{found.free_bytes / 1e6:.0f} MB free"
    )
    if found.problems:
        raise RigError("the plan cannot run:\n" + "\n".join(found.problems))
    _OUT.print("nothing speaks against it")


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
@_plain_errors
def evaluate(folder: Path) -> None:
    """Evaluate an acquisition FOLDER (or that of a run): its maps go into FOLDER/maps."""
    target = folder / "acquisition" if (folder / "acquisition").is_dir() else folder
    maps = evaluate_folder(target)
    for reason, count in maps.count().items():
        _OUT.print(f"{count:9d} pixels: {reason.text}")
    _OUT.print(f"{target / 'maps'}")


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--open", "opened", is_flag=True, help="Open the picture in the system's viewer.")
@_plain_errors
def show(folder: Path, opened: bool) -> None:
    """The maps of a run or acquisition FOLDER, as a picture."""
    picture = show_folder(folder)
    _OUT.print(str(picture))
    if opened:
        click.launch(str(picture))


@main.command()
@click.option("--fuel", default="n-heptane", show_default=True, help="A name, as CoolProp has it.")
@click.option("--gas", default="nitrogen", show_default=True)
@click.option("--model", default=next(iter(MODELS)), help=", ".join(MODELS))
@click.option("--diameter-um", type=float, default=9.0, show_default=True)
@click.option("--temperature", "temperature_K", type=float, default=370.0, help="Of the liquid, K.")
@click.option("--gas-temperature", "gas_K", type=float, default=573.0, help="K.")
@click.option("--pressure", "pressure_Pa", type=float, default=0.6e6, help="Pa.")
@click.option("--velocity", "velocity_m_s", type=float, default=0.0, help="Through the gas, m/s.")
@click.option("--vapour", type=float, default=0.0, help="Mass fraction of fuel in the gas.")
@click.option("--held", is_flag=True, help="Keep the velocity: no drag.")
@click.option("--duration", "duration_s", type=float, help="s; until it vanishes if left out.")
@click.option("--csv", "as_csv", is_flag=True, help="Print the columns as CSV.")
@click.option("--out", type=click.Path(path_type=Path), help="Draw them into this PNG.")
@click.option(
    "--convergence",
    type=click.Path(path_type=Path),
    help="Draw the error against step size and run time of all models into this PNG, and stop.",
)
@click.option(
    "--verification",
    type=click.Path(path_type=Path),
    help="Write the comparison with published data into this Markdown file, and stop.",
)
@_plain_errors
def droplet(
    fuel: str,
    gas: str,
    model: str,
    diameter_um: float,
    temperature_K: float,
    gas_K: float,
    pressure_Pa: float,
    velocity_m_s: float,
    vapour: float,
    held: bool,
    duration_s: float | None,
    as_csv: bool,
    out: Path | None,
    convergence: Path | None,
    verification: Path | None,
) -> None:
    """Follow one droplet of fuel through hot gas until it has evaporated."""
    cache = default_cache()
    if convergence is not None or verification is not None:
        if convergence is not None:
            _write(convergence, convergence_picture(*measure_all(cache)))
            _OUT.print(f"{convergence}")
        if verification is not None:
            _write(verification, page(cache).encode())
            _OUT.print(f"{verification}")
        return
    life = follow(
        fuel=fuel,
        gas=gas,
        model=model,
        diameter_m=diameter_um * 1e-6,
        temperature_K=temperature_K,
        gas_temperature_K=gas_K,
        pressure_Pa=pressure_Pa,
        velocity_m_s=velocity_m_s,
        vapour=vapour,
        held=held,
        duration_s=duration_s,
        cache=cache,
    )
    if as_csv:
        click.echo(life.csv(), nl=False)
    if out is not None:
        title = f"{fuel}, {diameter_um:g} µm, in {gas} of {gas_K:g} K, {pressure_Pa / 1e6:g} MPa"
        _write(out, life_picture(life, title=f"{title}: {model}"))
    if not as_csv:
        _life_table(life)


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise ClditError(f"{path}: cannot be written ({error.strerror})") from error


def _life_table(life: Life) -> None:
    table = Table(*COLUMNS, box=None)
    for row in list(life.rows())[:: max(1, life.time_s.size // 10)]:
        table.add_row(*(f"{value:.5g}" for value in row))
    _OUT.print(table)
    if life.vanished:
        _OUT.print(f"vanished after {life.time_s[-1]:.5g} s")
