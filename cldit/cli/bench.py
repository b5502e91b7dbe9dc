"""`cldit bench`: what this computer can do."""

from __future__ import annotations

import tempfile
from pathlib import Path
from statistics import median

import click
from rich.table import Table

from cldit.acquisition.bench import bench_rig
from cldit.bench.case import Lattice
from cldit.bench.error import ACCURACIES_K
from cldit.bench.optics import ABSORPTIONS, check_table, table_use, with_preset
from cldit.bench.presets import CAUSES, compare_presets
from cldit.bench.report import PARTS, Part, write_part
from cldit.bench.suite import MEASUREMENTS, USUAL, Bench
from cldit.cli.console import OUT, escaped, plain_errors, say
from cldit.cli.units import KELVIN
from cldit.dit.bench import bench_evaluation
from cldit.dit.truth import truth_table
from cldit.errors import TransportError
from cldit.gpu.device import open_device
from cldit.optics.wavelengths import wavelengths
from cldit.report.droplets import convergence_picture
from cldit.report.pictures import nodes_picture
from cldit.rig.errors import RigError
from cldit.run import default_cache
from cldit.scene import load_scene
from cldit.spray.droplet.convergence import measure_all
from cldit.spray.source import make_spray

FRAMES_PER_SHOT = (1, 4, 16)


@click.group(invoke_without_command=True)
@click.option("--scene", default="gdi", show_default=True, help="A shipped name or a YAML file.")
@click.option(
    "--only", "parts", multiple=True, type=click.Choice(PARTS), help="One part; may be repeated."
)
@click.option("--peers", is_flag=True, help="Also what others need, where it is installed.")
@click.option(
    "--every",
    type=click.IntRange(1),
    default=5,
    show_default=True,
    help="The reference, path and branching trace every n-th pixel across and down (odd); 1: all.",
)
@click.option(
    "--samples",
    type=click.IntRange(256),
    default=512,
    show_default=True,
    help="Of the reference, a pixel.",
)
@click.option(
    "--accuracy",
    "accuracies_K",
    type=KELVIN,
    multiple=True,
    default=ACCURACIES_K,
    show_default=True,
    help="K that source is asked for; may be repeated.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("bench"),
    show_default=True,
    help="Folder of benchmarks.md and of tables, pictures and JSON.",
)
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@click.pass_context
@plain_errors
def bench(
    context: click.Context,
    scene: str,
    parts: tuple[str, ...],
    peers: bool,
    every: int,
    samples: int,
    accuracies_K: tuple[float, ...],
    out: Path,
    device: str | None,
) -> None:
    """Measure this computer: error against run time of all methods, growth of cost, memory, what
    leaving out saves, kernels against the machine's floor."""
    if context.invoked_subcommand is not None:
        return
    opened = open_device(device)
    OUT.print(f"OpenCL device {opened.info.index} {opened.info.name}: {opened.reason}")

    def save(part: Part) -> None:
        command = f"cldit bench --scene {scene} --only {part.name} --out {out}"
        if part.name == "error":
            command += f" --every {every} --samples {samples}"
            command += "".join(f" --accuracy {kelvin:g}K" for kelvin in accuracies_K)
        page = write_part(part, out, command=command, device=opened)
        OUT.print(f"{page}\n")

    measured = Bench(
        scene=load_scene(scene),
        device=opened,
        cache=default_cache(),
        lattice=Lattice((every, every)),
        samples=samples,
        accuracies_K=accuracies_K,
        say=say,
        save=save,
    )
    for name in parts or (*USUAL, *(["peers"] if peers else [])):
        part = MEASUREMENTS[name](measured)
        _show(part)
        save(part)


def _show(part: Part) -> None:
    OUT.print(part.title, style="bold")
    for table in part.tables:
        shown = Table(*table.head, box=None)
        for row in table.rows:
            shown.add_row(*row)
        OUT.print(shown)
    for text in part.text:
        OUT.print(escaped(text), style="dim")


@bench.command("rig")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=Path("."),
    help="On the disk to be measured; here.",
)
@click.option("--frames", type=click.IntRange(10, 7000), default=240, show_default=True)
@click.option("--repeats", type=click.IntRange(1, 100), default=5, show_default=True)
@click.option("--camera-rate", "rate_Hz", type=float, default=146.7, show_default=True)
@plain_errors
def bench_rig_command(folder: Path, frames: int, repeats: int, rate_Hz: float) -> None:
    """Full frames (640 x 512) that the runner saves per second, every guarantee kept."""
    table = Table(
        "frames a shot", "best/s", "median/s", "worst/s", "lost", "CPU ms",
        "syncs/s", "shots a sync", box=None,
    )  # fmt: skip
    lost = 0
    for count in FRAMES_PER_SHOT:
        result = bench_rig(folder, frames=frames, frames_per_shot=count, repeats=repeats)
        rates, floors = result.frames_per_s, result.syncs_per_s
        lost += result.lost
        table.add_row(
            str(count),
            f"{max(rates):.0f}",
            f"{median(rates):.0f}",
            f"{min(rates):.0f}",
            str(result.lost),
            f"{1e3 * min(result.cpu_s):.1f}",
            f"{min(floors):.0f}..{max(floors):.0f}",
            f"{result.shots_per_sync:.2f}",
        )
    OUT.print(table)
    OUT.print(
        f"{repeats} times {frames} frames; the camera takes {rate_Hz:g}/s. CPU ms: for one frame. "
        "syncs/s: a bare loop of append and fsync beside each run"
    )
    if lost:
        raise RigError(f"{lost} frames are lost; do not acquire on this disk")


@bench.command("evaluate")
@click.option("--shots", type=click.IntRange(10, 100_000), default=1000, show_default=True)
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=None,
    help="Where the pictures are written, and removed; that for temporary files.",
)
@plain_errors
def bench_evaluate_command(shots: int, folder: Path | None) -> None:
    """Bias and errors against known sprays; time and memory of SHOTS full frames (640 x 512)."""
    table = Table(box=None)
    for head in ("eps", "T bias / K", "T error / K", "T chi2", "eps bias", "eps chi2"):
        table.add_column(head)
    last = ""
    for row in truth_table():
        if row.surroundings != last:
            last = row.surroundings
            table.add_section()
            table.add_row(f"surroundings: {last}")
        table.add_row(
            f"{row.emissivity:g}",
            f"{row.bias_K:+.3f}",
            f"{row.error_K:.3f}",
            f"{row.chi2_K:.2f}",
            f"{row.emissivity_bias:+.1e}",
            f"{row.chi2_emissivity:.2f}",
        )
    OUT.print(table)
    with tempfile.TemporaryDirectory(dir=folder, prefix="cldit-bench-") as place:
        result = bench_evaluation(Path(place), shots=shots)
    OUT.print(
        f"{result.shots} shots of 640 x 512 in {result.seconds:.1f} s "
        f"({result.cpu_s:.1f} s of CPU, {result.read_s:.1f} s to read them); "
        f"{result.peak_bytes / 2**20:.0f} MiB at most, "
        f"{result.grown_bytes / 2**20:.0f} MiB more than before"
    )


@bench.command("optics")
@click.argument("scene", default="gdi")
@click.option("--out", type=click.Path(path_type=Path), help="Folder of wavelengths.png.")
@plain_errors
def bench_optics_command(scene: str, out: Path | None) -> None:
    """Errors of droplet tables for k from 0 to 10; cost of SCENE's tables, and its wavelengths."""
    chosen = load_scene(scene)
    at = {"wavelength_um": chosen.optics.wavelength_um, "n": chosen.optics.n}
    table = Table("k", "Q_sca", "Q_abs", "g", "10 % wide", "miepython", box=None)
    worst = 0.0
    for k in ABSORPTIONS:
        found = check_table(k=k, cache=default_cache(), **at)
        worst = max(worst, found.largest)
        single = (found.single.scattering, found.single.absorption, found.single.asymmetry)
        table.add_row(f"{k:g}", *(f"{value:.1e}" for value in (*single, found.narrow, found.other)))
    OUT.print(table)
    OUT.print(f"largest error of a table of droplets: {100 * worst:.2g} %")
    spectral = with_preset(chosen, "spectral")
    spray = make_spray(spectral.spray, cache=default_cache())
    for name, use in zip(("first", "second"), table_use(spectral, spray), strict=True):
        OUT.print(
            f"{chosen.name}, {name} use: {use.made} tables made, {use.tables_s:.2f} CPU s; light "
            f"of all parcels and cells: {use.rest_s:.2f} CPU s"
        )
    resolved = wavelengths(spectral, spray, cache=default_cache())
    rows = Table("wavelengths", "error of T_app, K RMS", box=None)
    for number, error_K in enumerate(resolved.errors_K, start=1):
        mark = " (chosen)" if number == len(resolved.nodes) else ""
        rows.add_row(f"{number}{mark}", f"{error_K:.3f}")
    if resolved.errors_K:
        OUT.print(rows)
    if resolved.errors_K and out is not None:
        out.mkdir(parents=True, exist_ok=True)
        title = f"{chosen.name}: error against number of wavelengths"
        count = len(resolved.nodes)
        picture = nodes_picture(resolved.errors_K, chosen=count, title=title)
        (out / "wavelengths.png").write_bytes(picture)
        OUT.print(str(out / "wavelengths.png"))


@bench.command("presets")
@click.argument("scene", default="gdi")
@click.option("--pixels", type=click.IntRange(8, 1000), default=250, show_default=True)
@click.option("--accuracy", "accuracy_K", type=KELVIN, default=0.5, show_default=True)
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@plain_errors
def bench_presets_command(scene: str, pixels: int, accuracy_K: float, device: str | None) -> None:
    """Why preset `spectral` differs from `paper`: liquid, vapour and phase function in turn."""
    steps = compare_presets(
        load_scene(scene),
        pixels=pixels,
        accuracy_K=accuracy_K,
        device=open_device(device),
        cache=default_cache(),
        say=say,
    )
    table = Table(*CAUSES, "wavelengths", "T_app, mean K", "RMS K", "emissivity", box=None)
    for step in steps:
        marks = ("x" if cause in step.taken else "" for cause in CAUSES)
        d = step.difference
        figures = f"{d.mean_K:.1f}", f"{d.rms_K:.1f}", f"{d.mean_emissivity:.3f}"
        table.add_row(*marks, str(step.nodes), *figures)
    OUT.print(table)


@bench.command("spray")
@click.option("--out", type=click.Path(path_type=Path), help="Markdown file; else printed.")
@click.option("--spacing-mm", type=click.FloatRange(0.5, 4.0), default=1.0, show_default=True)
@plain_errors
def bench_spray_command(out: Path | None, spacing_mm: float) -> None:
    """The computed spray against correlations and measurements; takes minutes."""
    from cldit.spray.flow.page import page

    text = page(default_cache(), spacing_m=1e-3 * spacing_mm, say=say)
    if out is None:
        click.echo(text)
        return
    out.write_text(text, encoding="utf-8")
    OUT.print(str(out))


@bench.command("droplet")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="PNG.")
@plain_errors
def bench_droplet_command(out: Path) -> None:
    """Error of a droplet's life against step size and run time, all models, stiff cases among
    them."""
    out.write_bytes(convergence_picture(*measure_all(default_cache())))
    OUT.print(str(out))


@bench.command("stability")
@click.option("--out", type=click.Path(path_type=Path), help="Markdown file; else printed.")
@click.option("--slow", is_flag=True, help="With 1e7 cells: some 6 GB of memory, minutes.")
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@plain_errors
def bench_stability_command(out: Path | None, slow: bool, device: str | None) -> None:
    """Stiff and extreme cases of the transport, with the error that each reaches."""
    from cldit.bench.stability import bench_stability, cases, page

    opened = open_device(device)
    outcomes = bench_stability(opened, cases(), slow=slow, say=say)
    command = "cldit bench stability" + (" --slow" if slow else "")
    text = page(outcomes, opened, command=f"{command} --out docs/stability.md")
    if out is None:
        click.echo(text)
    else:
        out.write_text(text, encoding="utf-8")
        OUT.print(str(out))
    missed = [outcome.case.name for outcome in outcomes if not outcome.holds]
    if missed:
        raise TransportError(f"the bound is missed in {len(missed)} cases: {'; '.join(missed)}")


@bench.command("rays")
@click.argument("scene", default="gdi")
@click.option("--order", type=click.IntRange(0, 1000), help="Fewer scatterings, as steep, cheaper.")
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@plain_errors
def bench_rays_command(scene: str, order: int | None, device: str | None) -> None:
    """Error and cost of 1, 4, 16 and adaptive rays a pixel on SCENE, against 64."""
    from cldit.bench.case import changed
    from cldit.bench.rays import bench_rays, table

    chosen = changed(load_scene(scene), transport={"order": order})
    click.echo(table(bench_rays(chosen, open_device(device), say=say)).markdown())
