"""Errors of the droplet tables, cost of the tables of a scene, error against wavelengths.

python -m tests.bench optics --scene gdi-cone --out docs/benchmarks
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.bench.case import changed
from cldit.bench.report import Part, Table
from cldit.gpu.device import open_device
from cldit.io.files import make_folder
from cldit.optics.band import emitters
from cldit.optics.wavelengths import wavelengths
from cldit.prepare.phases import droplets_content, mean_phase
from cldit.prepare.spray_factory import make_spray
from cldit.scene import Scene
from cldit.show.figures.curves import nodes_figure
from cldit.show.figures.style import write_figure
from cldit.spray.result import Spray
from tests.bench.page import Given, write_measured
from tests.unit.optics.table_errors import check_table, compare_solvers

Floats = NDArray[np.float64]
ABSORPTIONS = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 2e-3, 1e-2, 0.0341, 0.1, 1.0, 10.0)


@dataclass(frozen=True)
class TableUse:
    """Cost of the optical properties of a scene.

    made: tables that were made rather than read. tables_s: CPU seconds for them, the choice of
    wavelengths and phase functions included; rest_s: for the optics of all parcels and cells.
    """

    made: int
    tables_s: float
    rest_s: float


def table_use(scene: Scene, spray: Spray) -> tuple[TableUse, TableUse]:
    """Cost of the tables at the first and second use of `scene` with this `spray`."""
    uses = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for _ in range(2):
            before = len(list(folder.iterdir()))
            start = time.process_time()
            bands = wavelengths(scene, spray, cache=folder).bands
            bands += wavelengths(scene, spray, cache=folder, paper=True).bands
            chosen = time.process_time()
            points = [emitters(spray, band)[0] for band in bands]
            lit = time.process_time()
            content = droplets_content(spray)
            for band, one in zip(bands[:-1], points[:-1], strict=True):
                mean_phase(spray, band, one, content=content, cache=folder)
            tables_s = time.process_time() - lit + chosen - start
            made = len(list(folder.iterdir())) - before
            uses.append(TableUse(made, tables_s, lit - chosen))
    return uses[0], uses[1]


def optics(given: Given) -> Part:
    """Checks tables for k from 0 to 10, and measures tables and wavelengths of the scene."""
    scene, cache = given.scene, given.cache
    at = {"wavelength_um": scene.optics.wavelength_um, "n": scene.optics.n}
    checks = [check_table(k=k, cache=cache, **at) for k in ABSORPTIONS]
    errors = [(c.k, c.single.scattering, c.single.absorption, c.single.asymmetry, c.narrow, c.other)
              for c in checks]  # fmt: skip
    solvers = [compare_solvers(n=scene.optics.n, k=k) for k in (1e-4, 1e-5, 1e-6)]
    spectral = changed(scene, optics={"preset": "spectral"})
    spray = make_spray(spectral.spray, open_device(), cache=cache)
    uses = zip(("first", "second"), table_use(spectral, spray), strict=True)
    resolved = wavelengths(spectral, spray, cache=cache)
    count = len(resolved.nodes)
    if resolved.errors_K:
        title = f"{scene.name}: error against number of wavelengths"
        make_folder(given.options.out)
        figure = nodes_figure(resolved.errors_K, chosen=count, title=title)
        write_figure(figure, given.options.out / "wavelengths.png")
    return Part(
        name="optics",
        title=f"Droplet tables and wavelengths: {scene.name}",
        tables=(
            Table.of(
                ("k", "Q_sca", "Q_abs", "g", "10 % wide", "miepython"),
                [(f"{k:g}", *(f"{value:.1e}" for value in row)) for k, *row in errors],
            ),
            Table.of(
                ("k", "mean Q_abs: cldit", "miepython", "CPU s: cldit", "miepython"),
                [
                    (f"{s.k:g}", f"{s.own:.1e}", f"{s.other:.1e}", f"{s.own_s:.3f}",
                     f"{s.other_s:.3f}")
                    for s in solvers
                ],
            ),
            Table.of(
                ("use", "tables made", "CPU s", "optics of parcels and cells, CPU s"),
                [(name, str(u.made), f"{u.tables_s:.2f}", f"{u.rest_s:.2f}") for name, u in uses],
            ),
            Table.of(
                ("wavelengths", "error of T_app, K RMS"),
                [
                    (f"{number}{' (chosen)' if number == count else ''}", f"{error_K:.3f}")
                    for number, error_K in enumerate(resolved.errors_K, start=1)
                ],
            ),
        ),
        data=[asdict(check) for check in checks],
        text=(f"Largest error of a table: {100 * max(c.largest for c in checks):.2g} %.",),
    )  # fmt: skip


def main() -> None:
    """Writes optics.md and wavelengths.png."""
    write_measured(optics)
