"""Users' refractive indices: CSV with three columns, or YAML of refractiveindex.info."""

from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.errors import FileError, OpticsError
from cldit.io.files import read_text
from cldit.io.plain_data import parse_yaml
from cldit.io.text_tables import number_table, split_cells
from cldit.optics.liquid import Liquid, Table

_UNIT_UM = (0.1, 200.0)  # wavelengths outside this are in another unit
_COLUMNS = ["wavelength_um", "n", "k"]


def read_liquid_table(path: Path) -> Liquid:
    """Reads n and k over wavelength from a file; they apply at any temperature.

    CSV: wavelength_um, n, k, with an optional heading and comments that begin with #. YAML: the
    form of refractiveindex.info, with `tabulated nk`, or `tabulated k` with `tabulated n`,
    `formula 1` or `formula 2` (Sellmeier). Wavelengths may rise or fall.
    """
    try:
        content = read_text(path)
    except FileError as error:
        raise OpticsError(str(error)) from error
    if path.suffix.lower() in (".yml", ".yaml"):
        table, source, temperature_K = _from_yaml(content, path)
    else:
        table, source, temperature_K = _from_csv(content, path), str(path), None
    return Liquid(
        name=path.stem,
        source=source,
        status="user",
        temperature_K=temperature_K,
        wavelength_um=(float(table.wavelength_um[0]), float(table.wavelength_um[-1])),
        temperatures_K=(1e-3, 5000.0),
        model=table,
    )


def _from_csv(content: str, path: Path) -> Table:
    allowed = f"allowed: {', '.join(_COLUMNS)} in a line"
    try:
        table = number_table("\n".join(line.split("#")[0] for line in content.splitlines()))
    except ValueError as error:
        raise OpticsError(f"{path}: {error}; {allowed}") from error
    names = [name for line in table.header for name in split_cells(line)[0]]
    if names not in ([], _COLUMNS):
        raise OpticsError(f"{path}: columns {', '.join(names)}; {allowed}")
    if any(row.label is not None or len(row.values) != 3 for row in table.rows):
        raise OpticsError(f"{path}: not three numbers in a line; {allowed}")
    return _table(np.array([row.values for row in table.rows]), path)


def _from_yaml(content: str, path: Path) -> tuple[Table, str, float | None]:
    data = parse_yaml(content, source=str(path), error=OpticsError)
    parts = data.get("DATA") if isinstance(data, dict) else None
    if not isinstance(parts, list) or not all(isinstance(part, dict) for part in parts):
        raise OpticsError(f"{path}: has no DATA list, as files of refractiveindex.info have")
    n: tuple[Floats, Floats] | dict[str, Any] | None = None
    k: tuple[Floats, Floats] | None = None
    for part in parts:
        kind = str(part.get("type", ""))
        if kind == "tabulated nk":
            rows = _columns(part, 3, path)
            n, k = (rows[:, 0], rows[:, 1]), (rows[:, 0], rows[:, 2])
        elif kind in ("tabulated n", "tabulated k"):
            rows = _columns(part, 2, path)
            if kind.endswith("n"):
                n = (rows[:, 0], rows[:, 1])
            else:
                k = (rows[:, 0], rows[:, 1])
        elif kind in ("formula 1", "formula 2"):
            n = part
        else:
            raise OpticsError(
                f"{path}: DATA of type {kind!r}; allowed: tabulated nk, tabulated n, "
                "tabulated k, formula 1 and formula 2"
            )
    if n is None or k is None:
        raise OpticsError(f"{path}: has no {'n' if n is None else 'k'}")
    wavelength, absorbed = k
    if isinstance(n, dict):
        real = _sellmeier(n, wavelength, path)
    else:
        order = np.argsort(n[0])
        if wavelength.min() < n[0].min() or wavelength.max() > n[0].max():
            raise OpticsError(f"{path}: k reaches beyond the wavelengths of n")
        real = np.interp(wavelength, n[0][order], n[1][order])
    table = _table(np.column_stack([wavelength, real, absorbed]), path)
    source = " ".join(str(data.get("REFERENCES", path)).split())
    return table, source, _temperature_K(data)


def _columns(part: dict[str, Any], count: int, path: Path) -> Floats:
    try:
        rows = [[float(cell) for cell in line.split()] for line in str(part["data"]).splitlines()]
    except (KeyError, ValueError) as error:
        raise OpticsError(f"{path}: {part.get('type')}: not numbers in columns ({error})") from None
    rows = [row for row in rows if row]
    if not rows or any(len(row) != count for row in rows):
        raise OpticsError(f"{path}: {part.get('type')}: every line must have {count} numbers")
    return np.array(rows)


def _sellmeier(part: dict[str, Any], wavelength_um: Floats, path: Path) -> Floats:
    """n^2 - 1 = C1 + sum of B l^2 / (l^2 - C^2) (formula 1) or / (l^2 - C) (formula 2)."""
    try:
        c = [float(cell) for cell in str(part["coefficients"]).split()]
        low, high = (float(cell) for cell in str(part["wavelength_range"]).split())
        terms = list(zip(c[1::2], c[2::2], strict=True))
    except (KeyError, ValueError) as error:
        raise OpticsError(f"{path}: {part.get('type')}: incomplete ({error})") from None
    if not (low <= wavelength_um.min() and wavelength_um.max() <= high):
        raise OpticsError(f"{path}: k reaches beyond {low:g}..{high:g} um, the range of n")
    square = wavelength_um**2
    power = 2 if part["type"] == "formula 1" else 1
    squared = np.full(square.shape, 1.0 + c[0])
    for strength, place in terms:
        squared = squared + strength * square / (square - place**power)
    if np.any(squared <= 0):
        raise OpticsError(f"{path}: {part['type']} gives n^2 <= 0")
    return np.asarray(np.sqrt(squared))


def _temperature_K(data: dict[str, Any]) -> float | None:
    conditions = data.get("CONDITIONS")
    temperature = conditions.get("temperature") if isinstance(conditions, dict) else None
    return float(temperature) if isinstance(temperature, int | float) else None


def _table(rows: Floats, path: Path) -> Table:
    if len(rows) < 2:
        raise OpticsError(f"{path}: {len(rows)} lines of numbers; allowed: 2 or more")
    if not np.all(np.isfinite(rows)):
        line = int(np.argmin(np.all(np.isfinite(rows), axis=1)))
        raise OpticsError(f"{path}: line {line + 1} of the numbers is not finite")
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    wavelength, n, k = rows.T
    check_um(wavelength, label=str(path))
    if np.any(np.diff(wavelength) <= 0):
        twice = wavelength[:-1][np.diff(wavelength) <= 0][0]
        raise OpticsError(f"{path}: the wavelength {twice:g} um occurs twice")
    for name, column, sound in (("n", n, n > 0), ("k", k, k >= 0)):
        if not np.all(sound):
            bad = int(np.argmin(sound))
            raise OpticsError(
                f"{path}: {name} = {column[bad]:g} at {wavelength[bad]:g} um; allowed: "
                f"{'n > 0' if name == 'n' else 'k >= 0 (m = n - ik)'}"
            )
    return Table(wavelength, n, k)


def check_um(wavelength_um: Floats, *, label: str) -> None:
    """Checks that wavelengths (N,) can be in um; the error, with `label`, guesses their unit."""
    low, high = float(np.min(wavelength_um)), float(np.max(wavelength_um))
    if _UNIT_UM[0] <= low and high <= _UNIT_UM[1]:
        return
    hint = "another unit than um"
    if 0 < low and high < 1e-3:
        hint = "m (multiply by 1e6)"
    elif low >= 100.0:
        hint = "nm (divide by 1000), or wavenumbers in 1/cm (1e4 divided by them gives um)"
    raise OpticsError(
        f"{label}: wavelengths {low:g}..{high:g} look like {hint}; allowed: "
        f"{_UNIT_UM[0]:g}..{_UNIT_UM[1]:g} um"
    )
