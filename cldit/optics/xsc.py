"""Reader of HITRAN absorption cross sections, .xsc (Kochanov et al., JQSRT 230, 172 (2019)).

A block has a head of 100 characters (molecule 20, first and last wavenumber 10 each, number of
points 7, temperature 7, pressure in Torr 6, largest value 10, ...), then lines of ten values of ten
characters, cm2 per molecule at equal steps. A file has one block for each temperature.
"""

from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.constants import AVOGADRO_PER_MOL
from cldit.errors import FileError, OpticsError
from cldit.io.files import read_text
from cldit.optics.vapour import VapourBand


def read_xsc(path: Path) -> VapourBand:
    """Reads the absorption of a vapour, linear between the points of the file.

    Blocks are interpolated to the wavenumbers of the first. The band is valid between the
    temperatures of the file, or at 100..1500 K if it has one.
    """
    try:
        lines = read_text(path, encoding="ascii").splitlines()
    except FileError as error:
        raise OpticsError(str(error)) from error
    blocks: list[tuple[float, str, Floats, Floats]] = []
    at = 0
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        block, at = _block(lines, at, path)
        blocks.append(block)
    if not blocks:
        raise OpticsError(f"{path}: has no cross sections")
    blocks.sort(key=lambda block: block[0])
    kelvin, molecules, numbers, values = zip(*blocks, strict=True)
    temperatures = np.array(kelvin)
    if np.any(np.diff(temperatures) <= 0):
        raise OpticsError(
            f"{path}: several blocks at one temperature (other pressures?); keep one of each"
        )
    number = numbers[0]
    for wavenumbers in numbers[1:]:
        shift = np.abs(wavenumbers[[0, -1]] - number[[0, -1]])
        if np.max(shift) > 1.0:
            raise OpticsError(f"{path}: the blocks do not cover the same wavenumbers")
    table = [np.interp(number, *columns) for columns in zip(numbers, values, strict=True)]
    single = len(blocks) == 1
    return VapourBand(
        species=molecules[0],
        source=str(path),
        status="user",
        wavenumber_per_cm=(float(number[0]), float(number[-1])),
        temperatures_K=(100.0, 1500.0)
        if single
        else (float(temperatures[0]), float(temperatures[-1])),
        number_per_cm=number,
        rows_K=temperatures,
        # The file has cm2 per molecule.
        table_m2_mol=np.array(table) * (1e-4 * AVOGADRO_PER_MOL),
    )


def _block(lines: list[str], at: int, path: Path) -> tuple[tuple[float, str, Floats, Floats], int]:
    """Temperature, molecule, wavenumbers and values of the block at a line, and the next line."""
    head = lines[at]
    try:
        low, high = float(head[20:30]), float(head[30:40])
        count, temperature = int(head[40:47]), float(head[47:54])
    except ValueError:
        raise OpticsError(
            f"{path}: line {at + 1} is no head of a HITRAN cross section (.xsc): {head[:60]!r}"
        ) from None
    if not (0 < low < high < 1e6 and count >= 2 and 0 < temperature < 1e4):
        raise OpticsError(
            f"{path}: line {at + 1}: {low:g}..{high:g} 1/cm, {count} points, {temperature:g} K"
        )
    needed = -(-count // 10)
    block_lines = lines[at + 1 : at + 1 + needed]
    cells = [line[place : place + 10] for line in block_lines for place in range(0, 100, 10)]
    try:
        values = np.array([float(cell) for cell in cells[:count] if cell.strip()])
    except ValueError as error:
        raise OpticsError(f"{path}: after line {at + 1}: {error}") from None
    if len(values) < count:
        raise OpticsError(f"{path}: line {at + 1} has {count} points, {len(values)} were found")
    # Negative cross sections are noise up to 2 % of the largest, and taken as 0.
    if not np.all(np.isfinite(values)) or values.min() < -0.02 * max(values.max(), 0.0):
        raise OpticsError(f"{path}: after line {at + 1}: cross sections not finite, or negative")
    number = np.linspace(low, high, count)
    block = temperature, head[:20].strip(), number, np.maximum(values, 0.0)
    return block, at + 1 + needed
