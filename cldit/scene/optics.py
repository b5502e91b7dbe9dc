"""What light is counted, and what the spray's optical properties are taken to be."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from cldit.scene.checks import Section, Within
from cldit.scene.values import Filter, Material, Wavelength


class Optics(Section):
    """What light the camera counts, and what the spray's optical properties are taken to be.

    `paper`: one wavelength, one refractive index, one vapour cross section, as in the paper's
    Section 2. `spectral`: of the liquid and the vapour over the filter, with as many wavelengths
    as `wavelengths` says or `spectral_error_K` (RMS, in T_app) needs.
    """

    preset: Literal["paper", "spectral"] = "paper"
    filter_um: Filter = (3.3, 3.5)  # two edges of a rectangle, or a curve
    wavelength_um: Wavelength = 3.4  # paper
    n: Annotated[float, Within(0.1, 10.0)] = 1.338  # paper
    k: Annotated[float, Within(0.0, 10.0)] = 0.0341  # paper
    vapour_m2_mol: Annotated[float, Within(0.0, 1e6)] = 50.0  # paper
    liquid: Material | None = None  # spectral: name or table; the spray's fuel where left out
    vapour: Material | None = None  # spectral: name or table; the spray's fuel where left out
    vapour_area_km_mol: Annotated[float, Within(1e-3, 1e5)] | None = None  # None: the default's
    wavelengths: Annotated[int, Within(1, 64)] | None = None  # None: chosen from the next
    spectral_error_K: Annotated[float, Within(1e-3, 100.0)] = 0.1
    compare_paper: bool = True  # spectral: trace the paper's properties too, and report by how much

    @model_validator(mode="after")
    def _ordered(self) -> Optics:
        if isinstance(self.filter_um[0], float) and self.filter_um[0] >= self.filter_um[1]:
            raise ValueError(
                f"filter_um: {self.filter_um[0]:g} to {self.filter_um[1]:g} is empty; "
                "allowed is a lower and a higher wavelength"
            )
        return self
