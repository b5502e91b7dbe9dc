"""Table of medians over the delays of an acquisition."""

from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from cldit.dit.maps import Maps
from cldit.io.text_tables import csv_text
from cldit.scene.delays import delay_text


@dataclass(frozen=True)
class DelayRow:
    """Medians of the maps of one delay over the `pixels` with an apparent temperature."""

    delay_s: float
    pixels: int
    apparent_temperature_K: float
    apparent_temperature_standard_error_K: float
    emissivity: float
    emissivity_standard_error: float

    @classmethod
    def of(cls, delay_s: float, maps: Maps) -> "DelayRow":
        """The row of the `maps` at `delay_s`."""
        evaluated = np.isfinite(maps.apparent_temperature_K)
        return cls(
            delay_s=delay_s,
            pixels=int(evaluated.sum()),
            apparent_temperature_K=_median(maps.apparent_temperature_K[evaluated]),
            apparent_temperature_standard_error_K=_median(
                maps.apparent_temperature_standard_error_K[evaluated]
            ),
            emissivity=_median(maps.emissivity[evaluated]),
            emissivity_standard_error=_median(maps.emissivity_standard_error[evaluated]),
        )

    @property
    def text(self) -> str:
        """The row as a line."""
        return (
            f"{delay_text(self.delay_s)}: {self.pixels} pixels, in the median T_app "
            f"{self.apparent_temperature_K:.1f} K "
            f"(error {self.apparent_temperature_standard_error_K:.2g} K), emissivity "
            f"{self.emissivity:.3f} (error {self.emissivity_standard_error:.2g})"
        )


def _median(values: NDArray[np.float32]) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def table_csv(rows: Iterable[DelayRow]) -> str:
    """CSV of the table, with a heading and a line per delay."""
    return csv_text((column.name for column in fields(DelayRow)), (astuple(row) for row in rows))
