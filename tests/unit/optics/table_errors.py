"""Errors of droplet tables and of Mie's series, against Mie's solutions and miepython."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import miepython
import numpy as np

from cldit.optics import mie
from cldit.optics.droplets import (
    DropletTable,
    droplet_table,
    resolved,
    table_error,
)

_NARROW = 0.1  # of a distribution's ln d


@dataclass(frozen=True)
class TableCheck:
    """Errors of one table against Mie's solutions.

    single: of Q_sca, Q_abs and g at single diameters over the whole range (k < 0.002: against means
    over 1 % of the diameter). narrow: largest relative error of the scattering and absorption of
    log-normal distributions that are 10 % wide, around five sizes, solved for droplet by droplet.
    other: of the solutions themselves, from miepython's: scattering and extinction at single sizes.
    """

    k: float
    single: tuple[float, float, float]
    narrow: float
    other: float

    @property
    def largest(self) -> float:
        """The largest error of all."""
        return max(*self.single, self.narrow)


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
