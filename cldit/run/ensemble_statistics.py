"""Statistics of the injections whose mean light is a run: maps, and their figures."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cldit.arrays import Image
from cldit.dit.maps import Maps
from cldit.io.images import read_image, words, write_maps

STATISTICS = "ensemble"
"""Folder of the maps in that of the run."""

_UNITS = {
    "apparent_temperature_nominal_K": "K",
    "apparent_temperature_mean_K": "K",
    "apparent_temperature_deviation_K": "K",
    "apparent_temperature_standard_error_K": "K",
    "emissivity_mean": "1",
    "emissivity_deviation": "1",
    "emissivity_standard_error": "1",
    "injections": "1",
}


@dataclass(frozen=True)
class Ensemble:
    """Statistics of the members of a run; maps (H, W) float32, NaN where there is no value.

    members: their number. maps: T_app of the nominal injection; mean and standard deviation of the
    members' T_app and emissivity, of T_app over the members that have one (`injections`); standard
    errors of the run's own maps, those of the mean light.
    """

    members: int
    maps: Mapping[str, Image] = field(repr=False)

    def __getitem__(self, name: str) -> Image:
        return self.maps[name]

    def save(self, folder: Path, *, pixel_m: tuple[float, float]) -> None:
        """Writes a TIFF for each map, for pixels of `pixel_m`."""
        maps = {name: (image, _UNITS[name]) for name, image in self.maps.items()}
        write_maps(folder, maps, pixel_m=pixel_m)

    @classmethod
    def load(cls, folder: Path, members: int) -> "Ensemble":
        """Reads the files of `save`; raises RunFolderError if one is missing or damaged."""
        return cls(members, {name: read_image(folder / f"{name}.tif")[0] for name in _UNITS})

    @property
    def labelled(self) -> dict[str, tuple[Image, str, str]]:
        """Image, unit and description of each map, for `cldit.run.labelled`."""
        return {
            f"ensemble_{name}": (
                image,
                _UNITS[name],
                f"{words(name)} of {self.members} injections",
            )
            for name, image in self.maps.items()
        }

    def text(self, light: Maps) -> str:
        """The figures on one line."""
        figures = (f"{_FIGURES[name]} {rms_K:.2g} K" for name, rms_K in self.figures(light).items())
        return f"T_app, RMS: {', '.join(figures)}"

    def figures(self, light: Maps) -> dict[str, float]:
        """RMS over pixels where all members and the mean light have a T_app: deviation of one
        injection, standard error of the mean light, mean of T_app less T_app of the mean light, and
        this less the nominal one's. `light` are the maps of the mean light."""
        light_K = light.apparent_temperature_K
        images = {
            "deviation_K": self["apparent_temperature_deviation_K"],
            "standard_error_K": self["apparent_temperature_standard_error_K"],
            "mean_less_mean_light_K": self["apparent_temperature_mean_K"] - light_K,
            "mean_light_less_nominal_K": light_K - self["apparent_temperature_nominal_K"],
        }
        valid_everywhere = light.has_temperature & (self["injections"] == self.members)
        return {
            name: float(np.sqrt(np.mean(image[valid].astype(float) ** 2)))
            for name, image in images.items()
            if (valid := valid_everywhere & np.isfinite(image)).any()
        }


_FIGURES = {
    "deviation_K": "standard deviation of one injection",
    "standard_error_K": "standard error of the mean light",
    "mean_less_mean_light_K": "mean of T_app less T_app of the mean light",
    "mean_light_less_nominal_K": "mean light less the nominal injection",
}
