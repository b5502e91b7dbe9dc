"""`cldit optics` and `cldit fit-liquid`: optical properties of a scene; bands of a liquid."""

from pathlib import Path

import click

from cldit.cli.console import OUT, escaped, plain_errors, print_table, say
from cldit.cli.options import PATH, SCENE, figures_option
from cldit.errors import OpticsError
from cldit.io.files import make_folder, write_text
from cldit.optics.band_fit import fit_bands, fit_error
from cldit.optics.liquid import Bands, Table, liquid
from cldit.optics.liquid_table import read_liquid_table
from cldit.run import default_cache
from cldit.scene import load_scene
from cldit.show.figures.optics_figures import optics_figure
from cldit.show.figures.style import write_figure
from cldit.show.report.optics_summary import scene_optics


@click.command()
@click.argument("scene", type=SCENE)
@click.option("--out", type=PATH, help="Figure (.png, .pdf or .svg); default: SCENE-optics.png.")
@figures_option
@plain_errors
def optics(scene: str, out: Path | None, suffix: str | None) -> None:
    """Print and draw optical properties of SCENE: liquid, droplets, vapour, camera."""
    if out is not None and suffix not in (None, out.suffix):
        raise click.UsageError(f"--format {suffix[1:]} and --out {out}: allowed: one of them")
    chosen = load_scene(scene)
    found = scene_optics(chosen, cache=default_cache())
    rows = (
        (row.quantity, row.scene, row.data, row.paper, f"[dim]{escaped(row.note)}[/]")
        for row in found.rows
    )
    print_table("", "scene", "data", "paper", "", rows=rows)
    for source in found.sources:
        OUT.print(escaped(source), style="dim")
    figure = out or Path(f"{chosen.name}-optics{suffix or '.png'}")
    make_folder(figure.parent)
    write_figure(optics_figure(found), figure)
    OUT.print(escaped(str(figure)))


@click.command("fit-liquid")
@click.argument("table", type=PATH)
@click.option("--shipped", help="Only compare the shipped bands of this liquid with TABLE.")
@click.option("--bands", type=click.IntRange(1, 200), default=40)
@click.option("--out", type=PATH, help="YAML file for the fitted bands.")
@plain_errors
def fit_liquid(table: Path, shipped: str | None, bands: int, out: Path | None) -> None:
    """Fit bands to TABLE (CSV of wavelength_um, n, k, or a refractiveindex.info file); minutes."""
    source = read_liquid_table(table).model
    assert isinstance(source, Table)
    if shipped is not None:
        known = liquid(shipped).model
        if not isinstance(known, Bands):
            raise OpticsError(f"{shipped}: is not a sum of bands")
        OUT.print(f"{shipped} as shipped, {len(known.bands)} bands, against {table}:")
        OUT.print(str(fit_error(known, source)))
        return
    fitted, error = fit_bands(source, bands=bands, say=say)
    OUT.print(f"{len(fitted.bands)} bands against {table}:")
    OUT.print(str(error))
    if out is not None:
        write_text(out, _text(fitted, error))
        OUT.print(escaped(str(out)))


def _text(bands: Bands, error: object) -> str:
    """YAML as in the files of the shipped liquids, without name and source."""
    lines = [
        f'fit: "{error}"',
        "background: [" + ", ".join(f"{c:.7g}" for c in bands.background) + "]",
        "# height of k, centre, Lorentz half width, Gaussian standard deviation (1/cm)",
        "bands:",
    ]
    rows = (f"  - [{h:.4e}, {c:.2f}, {w:.4g}, {s:.4g}]" for h, c, w, s in bands.bands)
    return "\n".join([*lines, *rows]) + "\n"
