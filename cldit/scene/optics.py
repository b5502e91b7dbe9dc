"""What light is counted, and what the spray's optical properties are taken to be."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from cldit.scene.checks import Section, Within
from cldit.scene.values import Filter, Material, Wavelength

MOST_WAVELENGTHS = 64


class Optics(Section):
    """What light the camera counts, and what the spray's optical properties are taken to be.

    `paper`: one wavelength, one refractive index, one vapour cross section, as in the paper's
    Section 2. `spectral`: of the liquid and the vapour over the filter, with as many wavelengths
    as `wavelengths` says or `spectral_error_K` (RMS, in T_app) needs.
    """

    preset: Literal["paper", "spectral"] = "paper"
    """`paper`: one wavelength and the paper's constants; `spectral`: data over the filter."""
    filter_um: Filter = (3.3, 3.5)
    """Two edges of a rectangle, a list of (um, transmission), or a file of both."""
    wavelength_um: Wavelength = 3.4
    """Of the preset `paper`."""
    n: Annotated[float, Within(0.1, 10.0)] = 1.338
    """Refractive index of the liquid, preset `paper` (paper, Section 2)."""
    k: Annotated[float, Within(0.0, 10.0)] = 0.0341
    """Absorption index of the liquid, preset `paper` (paper, Section 2)."""
    vapour_m2_mol: Annotated[float, Within(0.0, 1e6)] = 50.0
    """Absorption cross section of a mole of vapour, preset `paper` (paper, Section 2)."""
    liquid: Material | None = None
    """Preset `spectral`: name of a liquid, or table of n and k; the spray's fuel where left out."""
    vapour: Material | None = None
    """Preset `spectral`: name of a vapour, or .xsc file; the spray's fuel where left out."""
    vapour_area_km_mol: Annotated[float, Within(1e-3, 1e5)] | None = None
    """Integrated C-H absorption to which the vapour's bands are scaled; left out: the data's own.
    """
    wavelengths: Annotated[int, Within(1, MOST_WAVELENGTHS)] | None = None
    """Number of wavelengths of `spectral`; left out: as many as `spectral_error_K` needs."""
    spectral_error_K: Annotated[float, Within(1e-3, 100.0)] | None = None
    """Wanted error of the wavelengths, RMS in apparent temperature; left out: chosen from
    `transport.accuracy_K`."""
    compare_paper: bool = True
    """Preset `spectral`: trace the paper's properties too, and report the difference."""

    @property
    def bound_K(self) -> float:
        """`spectral_error_K`; where it is left out and nobody chooses, 0.1 K."""
        return 0.1 if self.spectral_error_K is None else self.spectral_error_K

    @model_validator(mode="after")
    def _ordered(self) -> Optics:
        if isinstance(self.filter_um[0], float) and self.filter_um[0] >= self.filter_um[1]:
            raise ValueError(
                f"filter_um: {self.filter_um[0]:g} to {self.filter_um[1]:g} is empty; "
                "allowed is a lower and a higher wavelength"
            )
        return self
