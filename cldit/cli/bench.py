"""`cldit bench`: what this computer can do."""

from __future__ import annotations

import tempfile
from pathlib import Path

import click
from rich.table import Table

from cldit.acquisition.bench import bench_rig
from cldit.bench_optics import ABSORPTIONS, check_table, table_use, with_preset
from cldit.cli.console import OUT, plain_errors, say
from cldit.dit.bench import bench_evaluation
from cldit.optics.wavelengths import wavelengths
from cldit.report.droplets import convergence_picture
from cldit.report.pictures import nodes_picture
from cldit.rig.errors import RigError
from cldit.run import default_cache
from cldit.scene import load_scene
from cldit.spray.droplet.convergence import measure_all
from cldit.spray.source import make_spray


@click.group()
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
@plain_errors
def bench_rig_command(folder: Path, frames: int, rate_Hz: float) -> None:
    """Full frames (640 x 512) that the runner saves per second, every guarantee kept."""
    result = bench_rig(folder, frames=frames)
    OUT.print(
        f"{result.frames_per_s:.0f} frames/s saved, {result.lost} lost; the camera takes "
        f"{rate_Hz:g}/s"
    )
    if result.lost:
        raise RigError(f"{result.lost} frames are lost; do not acquire on this disk")


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
    """Time and memory that the evaluation of SHOTS full frames (640 x 512) takes."""
    with tempfile.TemporaryDirectory(dir=folder, prefix="cldit-bench-") as place:
        result = bench_evaluation(Path(place), shots=shots)
    OUT.print(
        f"{result.shots} shots of 640 x 512 in {result.seconds:.1f} s, of which "
        f"{result.read_s:.1f} s to read them; {result.peak_bytes / 2**20:.0f} MiB at most, "
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
    table = Table("k", "Q_sca", "Q_abs", "g", "10 % wide", box=None)
    worst = 0.0
    for k in ABSORPTIONS:
        found = check_table(k=k, cache=default_cache(), **at)
        worst = max(worst, found.largest)
        single = (found.single.scattering, found.single.absorption, found.single.asymmetry)
        table.add_row(f"{k:g}", *(f"{value:.1e}" for value in (*single, found.narrow)))
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


@bench.command("spray")
@click.option("--out", type=click.Path(path_type=Path), help="Markdown file; else printed.")
@plain_errors
def bench_spray_command(out: Path | None) -> None:
    """The computed spray against correlations and measurements; takes minutes."""
    from cldit.spray.flow.verification import page

    text = page(default_cache(), say=say)
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
