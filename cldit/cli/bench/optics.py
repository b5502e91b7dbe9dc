"""`cldit bench optics`: errors and cost of droplet tables and of wavelengths."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.bench.optics import ABSORPTIONS, check_table, compare_solvers, table_use, with_preset
from cldit.cli.console import OUT, folded_table, plain_errors
from cldit.io.files import make_folder, write_bytes
from cldit.optics.wavelengths import wavelengths
from cldit.prepare.spray_factory import make_spray
from cldit.run import default_cache
from cldit.scene import load_scene
from cldit.show.figures.curves import nodes_picture


@click.command("optics")
@click.argument("scene", default="gdi")
@click.option("--out", type=click.Path(path_type=Path), help="Folder of wavelengths.png.")
@plain_errors
def bench_optics_command(scene: str, out: Path | None) -> None:
    """Errors of droplet tables for k from 0 to 10; cost of SCENE's tables, and its wavelengths."""
    chosen = load_scene(scene)
    at = {"wavelength_um": chosen.optics.wavelength_um, "n": chosen.optics.n}
    table = folded_table("k", "Q_sca", "Q_abs", "g", "10 % wide", "miepython")
    worst = 0.0
    for k in ABSORPTIONS:
        found = check_table(k=k, cache=default_cache(), **at)
        worst = max(worst, found.largest)
        single = (found.single.scattering, found.single.absorption, found.single.asymmetry)
        table.add_row(f"{k:g}", *(f"{value:.1e}" for value in (*single, found.narrow, found.other)))
    OUT.print(table)
    OUT.print(f"largest error of a table of droplets: {100 * worst:.2g} %")
    solvers = folded_table("k", "mean Q_abs: cldit", "miepython", "CPU s: cldit", "miepython")
    for k in (1e-4, 1e-5, 1e-6):
        one = compare_solvers(n=chosen.optics.n, k=k)
        times = (f"{seconds:.3f}" for seconds in (one.own_s, one.other_s))
        solvers.add_row(f"{k:g}", f"{one.own:.1e}", f"{one.other:.1e}", *times)
    OUT.print(solvers)
    spectral = with_preset(chosen, "spectral")
    spray = make_spray(spectral.spray, cache=default_cache())
    for name, use in zip(("first", "second"), table_use(spectral, spray), strict=True):
        OUT.print(
            f"{chosen.name}, {name} use: {use.made} tables made, {use.tables_s:.2f} CPU s; light "
            f"of all parcels and cells: {use.rest_s:.2f} CPU s"
        )
    resolved = wavelengths(spectral, spray, cache=default_cache())
    rows = folded_table("wavelengths", "error of T_app, K RMS")
    for number, error_K in enumerate(resolved.errors_K, start=1):
        mark = " (chosen)" if number == len(resolved.nodes) else ""
        rows.add_row(f"{number}{mark}", f"{error_K:.3f}")
    if resolved.errors_K:
        OUT.print(rows)
    if resolved.errors_K and out is not None:
        make_folder(out)
        title = f"{chosen.name}: error against number of wavelengths"
        count = len(resolved.nodes)
        picture = nodes_picture(resolved.errors_K, chosen=count, title=title)
        write_bytes(out / "wavelengths.png", picture)
        OUT.print(str(out / "wavelengths.png"))
