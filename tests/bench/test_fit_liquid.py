"""Bands fitted to tables: known bands come back, and the error that is stated is one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.errors import OpticsError
from cldit.optics.liquid import Bands, Table, liquid
from tests.bench.fit_liquid import fit_bands, fit_error, main

WAVELENGTH = np.linspace(3.2, 3.6, 200)
GIVEN = Bands(
    bands=np.array([[0.1, 2860.0, 4.0, 6.0], [0.2, 2930.0, 8.0, 3.0], [0.05, 2960.0, 3.0, 9.0]]),
    background=(1.38, -2e-4, -1e-3),
    dn_dT_per_K=0.0,
    critical_K=1000.0,
    packing=(0.3, 0.3),
)


def table_of(bands: Bands) -> Table:
    return Table(WAVELENGTH, *bands.at(WAVELENGTH))


def test_known_bands_come_back() -> None:
    fitted, error = fit_bands(table_of(GIVEN), bands=3)
    assert error.strong_largest < 1e-3 and error.n_largest < 1e-4
    assert fitted.bands[:, 1] == pytest.approx(GIVEN.bands[:, 1], abs=0.05)
    assert fitted.bands[:, 0] == pytest.approx(GIVEN.bands[:, 0], rel=0.01)


def test_the_error_is_that_of_the_table() -> None:
    """2 % more k everywhere and n shifted by 1e-3 are found as such; 1e-12 for rounding."""
    exact = table_of(GIVEN)
    off = Table(WAVELENGTH, exact.n + 1e-3, exact.k / 1.02)
    error = fit_error(GIVEN, off)
    assert (error.strong_rms, error.strong_largest) == pytest.approx((0.02, 0.02), abs=1e-12)
    assert (error.n_rms, error.n_largest) == pytest.approx((1e-3, 1e-3), abs=1e-12)
    assert fit_error(GIVEN, exact).strong_largest < 1e-12


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The shipped n-octane against a table of its own values, and against other ones."""
    n, k = liquid("n-octane").index(WAVELENGTH, 299.15)
    file = tmp_path / "table.csv"
    np.savetxt(file, np.column_stack([WAVELENGTH, n, 1.05 * k]), delimiter=",")
    main([str(file), "--shipped", "n-octane"])
    assert "k 4.8 % rms and 4.8 % at most" in capsys.readouterr().out
    out = tmp_path / "bands.yaml"
    main([str(file), "--bands", "2", "--out", str(out)])
    assert "2 bands: k " in capsys.readouterr().out
    assert out.read_text().count("  - [") == 2


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(OpticsError, match=r"allowed: 1\.\.50"):
        fit_bands(table_of(GIVEN), bands=51)
    with pytest.raises(OpticsError, match="0 everywhere"):
        fit_bands(Table(WAVELENGTH, 0 * WAVELENGTH + 1.4, 0 * WAVELENGTH), bands=3)
