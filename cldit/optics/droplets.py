"""Mie cross sections of droplets over their size, as a table for one wavelength and liquid.

The refractive index is m = n - ik. Efficiencies come from miepython; the table is built over the
size parameter x = pi d / wavelength and kept on disk if a folder is given.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import miepython
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from cldit.errors import ClditError

Floats = NDArray[np.float64]

SMALLEST_M = 0.05e-6
LARGEST_M = 500e-6
_KNOTS = 2000  # Mie solutions ...
_POINTS = 16384  # ... and points between them, evenly spaced in ln x, for fast linear look-up
_FORM = 1  # of the file


class DropletError(ClditError, ValueError):
    """A droplet is outside the range of the table."""


@dataclass(frozen=True)
class DropletTable:
    """Efficiencies over ln x; made by `droplet_table`.

    scattering, absorption: efficiencies over their Rayleigh forms, x^4 / (1 + x^4) and
    x / sqrt(1 + x^2), which keeps them of order one; asymmetry: g. All (POINTS,).
    """

    wavelength_um: float
    n: float
    k: float
    log_x_start: float
    log_x_step: float
    scattering: Floats
    absorption: Floats
    asymmetry: Floats

    @property
    def largest_m(self) -> float:
        last = self.log_x_start + self.log_x_step * (len(self.scattering) - 1)
        return float(np.exp(last)) * self.wavelength_um * 1e-6 / np.pi

    def efficiencies(self, diameter_m: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Q_ext, Q_sca and g, shaped as `diameter_m`.

        Below the table (x < 0.01, or d < 0.05 um) the Rayleigh limit continues it.

        Raises:
            DropletError: a diameter is not positive, or above the table.
        """
        d = np.asarray(diameter_m, dtype=float)
        if d.size and not (d.min() > 0 and d.max() <= self.largest_m * (1 + 1e-9)):
            bad = d[~((d > 0) & (d <= self.largest_m))].reshape(-1)[0]
            raise DropletError(
                f"droplet diameter: {bad:g} m is outside 0..{self.largest_m:g} m, the range of "
                f"the Mie table for {self.wavelength_um:g} um"
            )
        x = d * (np.pi / (self.wavelength_um * 1e-6))
        place = (np.log(x) - self.log_x_start) / self.log_x_step
        last = len(self.scattering) - 1
        place = np.clip(place, 0.0, last)
        cell = np.minimum(place.astype(np.intp), last - 1)
        part = place - cell
        x2 = x * x
        q_sca = _between(self.scattering, cell, part) * (x2 * x2 / (1 + x2 * x2))
        q_abs = _between(self.absorption, cell, part) * (x / np.sqrt(1 + x2))
        return q_sca + q_abs, q_sca, _between(self.asymmetry, cell, part)

    def cross_sections(self, diameter_m: ArrayLike) -> tuple[Floats, Floats]:
        """C_abs and C_sca in m2, shaped as `diameter_m`; raises as `efficiencies`."""
        d = np.asarray(diameter_m, dtype=float)
        q_ext, q_sca, _ = self.efficiencies(d)
        area = d * d * (np.pi / 4)
        return (q_ext - q_sca) * area, q_sca * area


def _between(values: Floats, cell: NDArray[np.intp], part: Floats) -> Floats:
    below = values[cell]
    return np.asarray(below + part * (values[cell + 1] - below))


def droplet_table(*, wavelength_um: float, n: float, k: float, cache: Path | None) -> DropletTable:
    """The table for droplets of refractive index n - ik, from 0.05 um to 500 um and below.

    Against Mie solutions at single diameters it is within 1e-4 for k >= 0.03 and 2e-3 for
    k >= 0.01. With k = 0 whispering gallery resonances are finer than any table: above 3 um, 1 %
    of Q_sca (rms) at a single diameter, 0.1 % over a distribution of sizes.

    Args:
        cache: folder in which tables are kept by content, made if need be; None keeps nothing.

    Raises:
        DropletError: wavelength, n or k is impossible, or the Mie series fails.
    """
    if not (wavelength_um > 0 and n > 0 and k >= 0 and np.isfinite(wavelength_um + n + k)):
        raise DropletError(
            f"droplet optics: wavelength {wavelength_um:g} um, n = {n:g}, k = {k:g}; allowed are "
            "finite numbers, wavelength and n above 0, k not below 0"
        )
    text = f"{_FORM} {_KNOTS} {_POINTS} {miepython.__version__} {wavelength_um!r} {n!r} {k!r}"
    path = None
    if cache is not None:
        path = Path(cache) / f"mie-{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"
        kept = _read(path, text)
        if kept is not None:
            return DropletTable(wavelength_um, n, k, *kept)
    columns = _solve(wavelength_um=wavelength_um, n=n, k=k)
    if path is not None:
        _write(path, text, *columns)
    return DropletTable(wavelength_um, n, k, *columns)


_Columns = tuple[float, float, Floats, Floats, Floats]
_NAMES = ("scattering", "absorption", "asymmetry")


def _solve(*, wavelength_um: float, n: float, k: float) -> _Columns:
    """Start and step in ln x, then the three columns of the table."""
    end = np.log(np.pi * LARGEST_M * 1e6 / wavelength_um)
    start = min(np.log(0.01), np.log(np.pi * SMALLEST_M * 1e6 / wavelength_um), end - 1)
    knots = np.linspace(start, end, _KNOTS)
    x = np.exp(knots)
    q_ext, q_sca, _, g = (np.asarray(v) for v in miepython.efficiencies_mx(complex(n, -k), x))
    if not np.all(np.isfinite(q_ext + q_sca + g)):
        raise DropletError(
            f"droplet optics: the Mie series for n = {n:g}, k = {k:g} is not finite at "
            f"x = {x[np.argmin(np.isfinite(q_ext + q_sca + g))]:g}"
        )
    # With k = 0 the difference would only be rounding, of either sign.
    q_abs = np.maximum(q_ext - q_sca, 0.0) if k > 0 else np.zeros_like(x)
    x4 = x**4
    fine = np.linspace(start, end, _POINTS)
    columns = (q_sca * (1 + x4) / x4, q_abs * np.sqrt(1 + x * x) / x, g)
    smooth = [CubicSpline(knots, column)(fine) for column in columns]
    scattering, absorption = (np.maximum(column, 0.0) for column in smooth[:2])
    return float(start), float(fine[1] - fine[0]), scattering, absorption, smooth[2]


def _read(path: Path, text: str) -> _Columns | None:
    """What `_write` kept; None where there is nothing, or nothing that can be trusted."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            columns = [np.asarray(file[name], dtype=float) for name in _NAMES]
            sound = str(file["text"]) == text and all(c.shape == (_POINTS,) for c in columns)
            start, step = (float(value) for value in file["axis"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    if not sound or not np.all(np.isfinite(columns)):
        return None
    return start, step, columns[0], columns[1], columns[2]


def _write(path: Path, text: str, start: float, step: float, *columns: Floats) -> None:
    """Appears whole or not at all; a folder that cannot be written costs only the time."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(dir=path.parent, suffix=".part")
    except OSError:
        return
    try:
        with os.fdopen(handle, "wb") as stream:
            table = dict(zip(_NAMES, columns, strict=True))
            np.savez(stream, text=np.array(text), axis=np.array([start, step]), **table)  # type: ignore[arg-type]
        os.replace(part, path)
    except OSError:
        Path(part).unlink(missing_ok=True)
