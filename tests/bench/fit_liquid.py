"""Bands of a shipped liquid, fitted to a table of n and k; minutes.

    python -m tests.bench fit_liquid TABLE --out cldit/optics/data/NAME.yaml

Bands are added where the misfit of k is largest, a few at a time, and all are refined together by
least squares with exact derivatives. k counts relative to k + 0.005: by its own size where it
matters, by 5e-5 a percent where it is weak. n follows from the bands; its background, linear, is
fitted last.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import wofz

from cldit.arrays import Floats
from cldit.errors import OpticsError
from cldit.optics.liquid import Bands, Table, liquid
from cldit.optics.liquid_table import read_liquid_table

STRONG_K = 0.005
_REFERENCE_PER_CM = 3000.0  # of the background, as in `liquid`
_AT_ONCE = 4  # bands added before all are refined
_APART_PER_CM = 15.0  # of two that are added at once
_LIMITS_PER_CM = (0.05, 400.0)  # of widths


@dataclass(frozen=True)
class FitError:
    """Error of fitted bands: of k, relative where k > 0.005 and absolute elsewhere, and of n."""

    strong_rms: float
    strong_largest: float
    weak_largest: float
    n_rms: float
    n_largest: float

    def __str__(self) -> str:
        return (
            f"k {100 * self.strong_rms:.2g} % rms and {100 * self.strong_largest:.2g} % at most "
            f"where k > {STRONG_K:g}, {self.weak_largest:.1e} at most elsewhere; n "
            f"{self.n_rms:.1e} rms and {self.n_largest:.1e} at most"
        )


def fit_error(bands: Bands, table: Table) -> FitError:
    """Error of bands at all points of a table."""
    n, k = bands.at(table.wavelength_um)
    strong = table.k > STRONG_K
    relative = np.abs(k[strong] / table.k[strong] - 1.0) if strong.any() else np.zeros(1)
    weak = np.abs(k - table.k)[~strong] if not strong.all() else np.zeros(1)
    off = np.abs(n - table.n)
    return FitError(
        strong_rms=float(np.sqrt(np.mean(relative**2))),
        strong_largest=float(relative.max()),
        weak_largest=float(weak.max()),
        n_rms=float(np.sqrt(np.mean(off**2))),
        n_largest=float(off.max()),
    )


def fit_bands(
    table: Table, *, bands: int = 40, say: Callable[[str], None] | None = None
) -> tuple[Bands, FitError]:
    """Fits `bands` bands, which do not depend on temperature, to a table; `say` gets progress."""
    if not 1 <= bands <= len(table.k) // 4:
        raise OpticsError(
            f"fit: {bands} bands to {len(table.k)} points; allowed: 1..{len(table.k) // 4}"
        )
    if not np.any(table.k > 0):
        raise OpticsError("fit: k is 0 everywhere")
    number = 1e4 / table.wavelength_um
    weight = 1.0 / (table.k + STRONG_K)
    unknowns = np.zeros((0, 4))
    while len(unknowns) < bands:
        missing = (table.k - _k(unknowns, number)) * weight
        more = _peaks(missing, table.k, number, min(_AT_ONCE, bands - len(unknowns)))
        unknowns = _refined(np.concatenate([unknowns, more]), number, table.k, weight)
        if say is not None:
            rms = float(np.sqrt(np.mean(((_k(unknowns, number) - table.k) * weight) ** 2)))
            say(f"{len(unknowns)} bands: misfit {100 * rms:.2g} %")
    order = np.argsort(unknowns[:, 1])
    rows = np.column_stack(
        [np.exp(unknowns[:, 0]), unknowns[:, 1], np.exp(unknowns[:, 2]), np.exp(unknowns[:, 3])]
    )[order]
    bare = Bands(rows, (0.0, 0.0, 0.0), 0.0, 1000.0, (0.3, 0.3))
    ratio = (number / _REFERENCE_PER_CM) ** 2
    columns = np.column_stack([np.ones_like(ratio), ratio, 1.0 / ratio])
    rest = table.n - bare.at(table.wavelength_um)[0]
    c0, c1, c2 = (float(c) for c in np.linalg.lstsq(columns, rest, rcond=None)[0])
    fitted = Bands(rows, (c0, c1, c2), 0.0, 1000.0, (0.3, 0.3))
    return fitted, fit_error(fitted, table)


def _parts(unknowns: Floats, number: Floats) -> tuple[Any, Any, Any, Any, Any, Any]:
    height, lorentz, gauss = np.exp(unknowns[:, [0, 2, 3]]).T
    scale = np.sqrt(2.0) * gauss
    z = (number[:, None] - unknowns[:, 1] + 1j * lorentz) / scale
    mirror = (number[:, None] + unknowns[:, 1] + 1j * lorentz) / scale
    return height, lorentz, scale, z, mirror, (wofz(z), wofz(mirror))


def _k(unknowns: Floats, number: Floats) -> Floats:
    """Absorption of bands with ln height, centre, ln Lorentz and ln Gaussian width (B, 4)."""
    height, _, _, _, _, (band, mirror) = _parts(unknowns, number)
    return np.asarray(np.sum(height * (band - mirror).real, axis=1))


def _slopes(unknowns: Floats, number: Floats) -> Floats:
    """(N, 4 B) derivatives of `_k`; w' = -2 z w + 2 i / sqrt(pi)."""
    height, lorentz, scale, z, mirror, (w, wm) = _parts(unknowns, number)
    dw = -2.0 * z * w + 2j / np.sqrt(np.pi)
    dm = -2.0 * mirror * wm + 2j / np.sqrt(np.pi)
    columns = [
        height * (w - wm).real,
        height * ((-dw - dm) / scale).real,
        height * ((dw - dm) * 1j * lorentz / scale).real,
        height * (-dw * z + dm * mirror).real,
    ]
    return np.stack(columns, axis=2).reshape(len(number), -1)


def _peaks(missing: Floats, k: Floats, number: Floats, count: int) -> Floats:
    """Initial bands (count, 4) where the misfit is largest."""
    left = missing.copy()
    rows = []
    for _ in range(count):
        at = int(np.argmax(left))
        height = np.log(max(abs(float(missing[at])) * (float(k[at]) + STRONG_K), 1e-6))
        rows.append([height, float(number[at]), np.log(3.0), np.log(6.0)])
        left[np.abs(number - number[at]) < _APART_PER_CM] = -np.inf
    return np.array(rows)


def _refined(start: Floats, number: Floats, k: Floats, weight: Floats) -> Floats:
    span = float(number.max() - number.min())
    low = np.array([-16.0, float(number.min()) - span / 4, *2 * [np.log(_LIMITS_PER_CM[0])]])
    high = np.array([1.0, float(number.max()) + span / 4, *2 * [np.log(_LIMITS_PER_CM[1])]])

    def misfit(x: Floats) -> Floats:
        return (_k(x.reshape(-1, 4), number) - k) * weight

    def slopes(x: Floats) -> Floats:
        return _slopes(x.reshape(-1, 4), number) * weight[:, None]

    found = least_squares(
        misfit,
        np.clip(start, low + 1e-9, high - 1e-9).ravel(),
        jac=slopes,
        bounds=(np.tile(low, len(start)), np.tile(high, len(start))),
        x_scale="jac",
        max_nfev=40,
    )
    return np.asarray(found.x).reshape(-1, 4)


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


def main(arguments: list[str] | None = None) -> None:
    """Fits bands to a table, or compares those of a shipped liquid with it."""
    parser = argparse.ArgumentParser(prog=sys.argv[0], description=__doc__)
    parser.add_argument(
        "table", type=Path, help="wavelength_um, n, k, or a refractiveindex.info file"
    )
    parser.add_argument("--shipped", help="only compare the bands of this liquid with the table")
    parser.add_argument("--bands", type=int, default=40)
    parser.add_argument("--out", type=Path, help="YAML file for the fitted bands")
    given = parser.parse_args(arguments)
    source = read_liquid_table(given.table).model
    assert isinstance(source, Table)
    if given.shipped is not None:
        known = liquid(given.shipped).model
        if not isinstance(known, Bands):
            raise OpticsError(f"{given.shipped}: is not a sum of bands")
        print(f"{given.shipped} as shipped, {len(known.bands)} bands: {fit_error(known, source)}")
        return
    fitted, error = fit_bands(source, bands=given.bands, say=print)
    print(f"{len(fitted.bands)} bands: {error}")
    if given.out is not None:
        given.out.write_text(_text(fitted, error), encoding="utf-8")
