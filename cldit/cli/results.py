"""Results that commands print last: range of the maps, files, next command."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cldit.cli.console import OUT, escaped

if TYPE_CHECKING:  # loads scipy, which not every command needs
    from cldit.dit.maps import Maps


def print_maps(maps: Maps) -> None:
    """Prints the range of T_app and emissivity, or the reasons why there is none."""
    known = np.isfinite(maps.apparent_temperature_K)
    if not known.any():
        reasons = "; ".join(f"{count} {reason.text}" for reason, count in maps.count().items())
        OUT.print(f"no pixel has an apparent temperature: {reasons}", style="bold")
        return
    kelvin = np.percentile(maps.apparent_temperature_K[known], (1, 99))
    emissivity = np.percentile(maps.emissivity[known], (1, 99))
    OUT.print(
        f"T_app {kelvin[0]:.1f} to {kelvin[1]:.1f} K, emissivity {emissivity[0]:.2g} to "
        f"{emissivity[1]:.2g} (percentiles 1 and 99 of {int(known.sum())} pixels)",
        style="bold",
    )


def print_files(*paths: Path) -> None:
    """Prints paths, each on a line."""
    for path in paths:
        OUT.print(escaped(str(path)))


def print_next(*words: str | Path) -> None:
    """Prints the command that is usually given next."""
    OUT.print(escaped(f"next: {shlex.join(map(str, words))}"))
