"""Errors of the droplet tables, cost of the tables of a scene, error against wavelengths.

python -m tests.bench optics --scene gdi --out docs/benchmarks
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import miepython
import numpy as np
from numpy.typing import NDArray

from cldit.bench.case import changed
from cldit.bench.report import Part, Table
from cldit.io.files import make_folder, write_bytes
from cldit.optics import mie
from cldit.optics.band import emitters
from cldit.optics.droplets import (
    AVERAGED,
    DropletTable,
    TableError,
    droplet_table,
    resolved,
    table_error,
)
from cldit.optics.wavelengths import wavelengths
from cldit.prepare.phases import droplets_content, mean_phase
from cldit.prepare.spray_factory import make_spray
from cldit.scene import Scene
from cldit.show.figures.curves import nodes_picture
from cldit.spray.result import Spray
from tests.bench.page import Given, write_measured

Floats = NDArray[np.float64]
ABSORPTIONS = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 2e-3, 1e-2, 0.0341, 0.1, 1.0, 10.0)
_NARROW = 0.1  # of a distribution's ln d


@dataclass(frozen=True)
class TableCheck:
    """Errors of one table against Mie's solutions.

    single: at single diameters over the whole range (k < 0.002: against means over 1 % of the
    diameter). narrow: largest relative error of the scattering and absorption of log-normal
    distributions that are 10 % wide, around five sizes, solved for droplet by droplet. other: of
    the solutions themselves, from miepython's: scattering and extinction at single sizes.
    """

    k: float
    single: TableError
    narrow: float
    other: float

    @property
    def largest(self) -> float:
        """The largest error of all."""
        return max(self.single.largest, self.narrow)


def check_table(*, wavelength_um: float, n: float, k: float, cache: Path | None) -> TableCheck:
    """Checks the table of droplets of one refractive index.

    Args:
        wavelength_um: in vacuum.
        n, k: refractive index n - ik.
        cache: folder of tables; None keeps nothing.

    Raises:
        DropletError: as `droplet_table`.
    """
    table = droplet_table(wavelength_um=wavelength_um, n=n, k=k, cache=cache)
    narrow = max(_narrow(table, middle_m) for middle_m in (2e-6, 5e-6, 9e-6, 20e-6, 60e-6))
    return TableCheck(k, table_error(table), narrow, _from_miepython(n=n, k=k))


def _from_miepython(*, n: float, k: float) -> float:
    """Largest relative difference of the solutions from those of miepython."""
    x = np.geomspace(0.2, 2000.0, 101)
    ours = mie.efficiencies(n=n, k=k, x=x)
    q_ext, q_sca, _, _ = miepython.efficiencies_mx(complex(n, -k), x)
    extinction = ours.scattering + ours.absorption
    return float(
        max(np.max(np.abs(extinction / q_ext - 1)), np.max(np.abs(ours.scattering / q_sca - 1)))
    )


@dataclass(frozen=True)
class SolverCheck:
    """Mie's series by cldit and by miepython, at the sizes that make one entry of a table.

    own, other: relative error of the mean Q_abs over 1 % of the diameter, against samples that
    resolve every resonance (two to the half width k / n). own_s, other_s: CPU seconds.
    """

    k: float
    own: float
    other: float
    own_s: float
    other_s: float


def compare_solvers(*, n: float, k: float, x: float = 45.0, spacing: float = 4.1e-5) -> SolverCheck:
    """Compares both at the samples of a table at small k: around x, `spacing` apart in ln x."""

    def samples(apart: float) -> tuple[Floats, Floats]:
        reach = int(AVERAGED / apart)
        offsets = apart * np.arange(-reach, reach + 1)
        weight = 1.0 - np.abs(offsets) / AVERAGED
        return x * np.exp(offsets), weight / weight.sum()

    resolved_at, weight = samples(0.5 * k / n)
    exact = weight @ mie.efficiencies(n=n, k=k, x=resolved_at).absorption
    sizes, weight = samples(spacing)
    start = time.process_time()
    own = weight @ mie.efficiencies(n=n, k=k, x=sizes, spacing=spacing).absorption
    middle = time.process_time()
    q_ext, q_sca, _, _ = miepython.efficiencies_mx(complex(n, -k), sizes)
    own_s, other_s = middle - start, time.process_time() - middle
    other = weight @ (q_ext - q_sca)
    mine, theirs = (abs(float(each / exact) - 1.0) for each in (own, other))
    return SolverCheck(k, mine, theirs, own_s, other_s)


def _narrow(table: DropletTable, middle_m: float) -> float:
    """Error of the mean cross sections of one narrow distribution, by area."""
    count = resolved(n=table.n, k=table.k, span=8 * _NARROW, least=20000)
    spread = _NARROW * np.linspace(-4.0, 4.0, count)
    weight = np.exp(-0.5 * (spread / _NARROW) ** 2)
    d = middle_m * np.exp(spread)
    x = d * (np.pi / (table.wavelength_um * 1e-6))
    solved = mie.efficiencies(n=table.n, k=table.k, x=x, spacing=8 * _NARROW / count)
    q_ext, q_sca, _ = table.efficiencies(d)
    errors = [0.0]
    for found, exact in ((q_sca, solved.scattering), (q_ext - q_sca, solved.absorption)):
        if np.any(exact > 0):
            errors.append(abs(float(weight @ found) / float(weight @ exact) - 1.0))
    return max(errors)


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
    spray = make_spray(spectral.spray, cache=cache)
    uses = zip(("first", "second"), table_use(spectral, spray), strict=True)
    resolved = wavelengths(spectral, spray, cache=cache)
    count = len(resolved.nodes)
    if resolved.errors_K:
        title = f"{scene.name}: error against number of wavelengths"
        make_folder(given.options.out)
        figure = nodes_picture(resolved.errors_K, chosen=count, title=title)
        write_bytes(given.options.out / "wavelengths.png", figure)
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
