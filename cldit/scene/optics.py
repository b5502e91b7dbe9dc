"""The camera's filter and the optical properties of liquid and vapour."""

from typing import Annotated, Literal

from pydantic import model_validator

from cldit.scene.checks import Section, Within
from cldit.scene.values import Filter, Material, Wavelength

MOST_WAVELENGTHS = 64


class Optics(Section):
    """Filter, liquid and vapour; the constants of preset `paper` are the paper's, Section 2."""

    preset: Literal["paper", "spectral"] = "paper"
    """`paper`: the paper's constants at one wavelength; `spectral`: data across the filter."""
    filter_um: Filter = (3.3, 3.5)
    """Two edges, pairs of wavelength (um) and transmission, or a file of pairs."""
    wavelength_um: Wavelength = 3.4
    """Wavelength, preset `paper`."""
    n: Annotated[float, Within(0.1, 10.0)] = 1.338
    """Refractive index of the liquid, preset `paper`."""
    k: Annotated[float, Within(0.0, 10.0)] = 0.0341
    """Absorption index of the liquid, preset `paper`."""
    vapour_m2_mol: Annotated[float, Within(0.0, 1e6)] = 50.0
    """Molar cross section of the vapour, preset `paper`."""
    liquid: Material | None = None
    """Preset `spectral`: name of a liquid, or a table of n and k. Default: the spray's fuel."""
    vapour: Material | None = None
    """Preset `spectral`: name of a vapour, or an .xsc file. Default: the spray's fuel."""
    vapour_area_km_mol: Annotated[float, Within(1e-3, 1e5)] | None = None
    """C-H band intensity to which the vapour is scaled. Default: no scaling."""
    wavelengths: Annotated[int, Within(1, MOST_WAVELENGTHS)] | None = None
    """Preset `spectral`: number of spectral nodes. Default: as many as `spectral_error_K` needs."""
    spectral_error_K: Annotated[float, Within(1e-3, 100.0)] | None = None
    """Tolerance for the error of `wavelengths`. Default: chosen from `transport.accuracy_K`."""
    compare_paper: bool = True
    """Preset `spectral`: report the difference from the paper's properties."""

    @property
    def bound_K(self) -> float:
        """`spectral_error_K`, or 0.1 K if it is neither given nor chosen."""
        return 0.1 if self.spectral_error_K is None else self.spectral_error_K

    @model_validator(mode="after")
    def _ordered(self) -> "Optics":
        if isinstance(self.filter_um[0], float) and self.filter_um[0] >= self.filter_um[1]:
            raise ValueError(
                f"filter_um: {self.filter_um[0]:g} to {self.filter_um[1]:g} is empty; "
                "allowed: a lower and a higher wavelength"
            )
        return self
