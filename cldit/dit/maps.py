"""The result of DIT: maps of emissivity and apparent temperature with their errors."""

from dataclasses import dataclass, fields
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Image, Mask
from cldit.io.digests import read_sealed
from cldit.io.images import read_image, words, write_image
from cldit.radiance.apparent_temperature import has_temperature


class Reason(IntEnum):
    """Reason why a pixel is NaN, the value in `Maps.reason`."""

    OK = 0
    TOO_FEW_BACKGROUNDS = 1
    SATURATED = 2
    BAD_PIXEL = 3
    BACKGROUND_NOT_VISIBLE = 4
    EMISSIVITY_TOO_LOW = 5
    NEGATIVE_RADIANCE = 6

    @property
    def text(self) -> str:
        """One line for the report."""
        return _TEXT[self]


_TEXT = {
    Reason.OK: "evaluated",
    Reason.TOO_FEW_BACKGROUNDS: "fewer than two backgrounds with a finite signal",
    Reason.SATURATED: "saturated at all backgrounds but one",
    Reason.BAD_PIXEL: "defective: named, or of one value in all images",
    Reason.BACKGROUND_NOT_VISIBLE: "does not see the heated background",
    Reason.EMISSIVITY_TOO_LOW: "transparent within its error: no apparent temperature",
    Reason.NEGATIVE_RADIANCE: "no emission above zero within noise: no apparent temperature",
}

EVALUATION = "evaluation.json"  # beside the maps of shots: everything else, and their digests
_SINCE_0_3 = "error_correlation"

UNITS = {
    "emissivity": "1",
    "emissivity_standard_error": "1",
    "apparent_temperature_K": "K",
    "apparent_temperature_standard_error_K": "K",
    "reason": "code",
    "reduced_chi2": "1",
    "fit_probability": "1",
    "error_correlation": "1",
}


@dataclass(frozen=True)
class Maps:
    """Maps (H, W), row 0 at the top; float32, NaN where there is no value, `reason` uint8.

    emissivity: 1 - transmitted share of the background's radiance.
    apparent_temperature_K: temperature of a black body that radiates as the spray does.
    *_standard_error: one standard deviation of either.
    reason: `Reason`, 0 where both have a value.
    reduced_chi2: of the two lines over the backgrounds, about 1 if the errors are right; NaN with
        two backgrounds or without noise. fit_probability: probability of this or a larger value by
        chance; near 0 where the pixel does not follow the measurement equation.
    error_correlation: of the errors of emissivity and T_app; NaN without noise, and in maps of
        cldit before 0.3.
    """

    emissivity: Image
    apparent_temperature_K: Image
    emissivity_standard_error: Image
    apparent_temperature_standard_error_K: Image
    reason: NDArray[np.uint8]
    reduced_chi2: Image
    fit_probability: Image
    error_correlation: Image

    @classmethod
    def unevaluated(cls, shape: tuple[int, int], reason: Reason) -> "Maps":
        """Maps of this `shape` without any value, for one `reason`."""
        nothing = np.full(shape, np.nan, np.float32)
        codes = np.full(shape, int(reason), np.uint8)
        return cls(nothing, nothing, nothing, nothing, codes, nothing, nothing, nothing)

    @property
    def has_temperature(self) -> Mask:
        """Pixels (H, W) with an apparent temperature and an emissivity above 0.05."""
        return has_temperature(self.emissivity, self.apparent_temperature_K)

    @property
    def optical_depth(self) -> Image:
        """Optical depth -ln(1 - emissivity), (H, W); NaN where nothing is transmitted."""
        through = 1.0 - self.emissivity
        return np.asarray(
            -np.log(through, out=np.full(through.shape, np.nan, np.float32), where=through > 0.0)
        )

    def __repr__(self) -> str:
        rows, columns = self.emissivity.shape
        kelvin = self.apparent_temperature_K[np.isfinite(self.apparent_temperature_K)]
        warm = f", {kelvin.min():.4g} to {kelvin.max():.4g} K" if kelvin.size else ""
        return f"<Maps: {columns} x {rows} pixels, {kelvin.size} with T_app{warm}>"

    def count(self) -> dict[Reason, int]:
        """Number of pixels for each reason that occurs, OK first."""
        return {reason: n for reason in Reason if (n := int(np.sum(self.reason == reason)))}

    @property
    def causes(self) -> str:
        """Reasons of the pixels without a T_app, each with its number of pixels."""
        counts = self.count()
        counts.pop(Reason.OK, None)
        return "; ".join(f"{reason.text}: {n} pixels" for reason, n in counts.items())

    def save(self, folder: Path, *, pixel_m: tuple[float, float]) -> None:
        """Writes a TIFF per map into `folder`, with names, units, and pixels of `pixel_m`."""
        folder.mkdir(parents=True, exist_ok=True)
        codes = {"codes": {str(int(reason)): reason.text for reason in Reason}}
        for item in fields(self):
            write_image(
                folder / f"{item.name}.tif",
                getattr(self, item.name),
                name=words(item.name),
                unit=UNITS[item.name],
                pixel_m=pixel_m,
                meta=codes if item.name == "reason" else None,
            )

    @classmethod
    def load(cls, folder: Path) -> "Maps":
        """Reads the files of `save`.

        Raises:
            RunFolderError: a file is missing or damaged, or not of the evaluation that is stored
                beside it, as after a kill.
        """
        if (folder / EVALUATION).is_file():
            read_sealed(folder / EVALUATION)
        names = [item.name for item in fields(cls)]
        if not (folder / f"{_SINCE_0_3}.tif").exists():
            names.remove(_SINCE_0_3)
        images = {name: read_image(folder / f"{name}.tif")[0] for name in names}
        unknown = np.full(images["emissivity"].shape, np.nan, np.float32)
        return cls(**{_SINCE_0_3: unknown, **images})
