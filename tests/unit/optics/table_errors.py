"""Errors of droplet tables and of Mie's series, against Mie's solutions and miepython."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import miepython
import numpy as np
from numpy.typing import NDArray

from cldit.optics import mie
from cldit.optics.droplets import (
    AVERAGED,
    DropletTable,
    TableError,
    droplet_table,
    resolved,
    table_error,
)

Floats = NDArray[np.float64]
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
    count = resolved(n=table.n, k=table.k, span=8 * _NARROW, minimum=20000)
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
