"""FITS: an image, or a cube of images, in one of the file's units (HDU)."""

import warnings
from contextlib import suppress
from typing import Any

from cldit.acquisition.pictures.source import ArrayStack, ImageMetadata, Source, moment_s, pick
from cldit.errors import EvaluationError
from cldit.io.extras import needed
from cldit.io.files import check_regular


class Fits(ArrayStack):
    """Images of a unit, by its number or its name, scaled by BSCALE and BZERO; parts are read."""

    def __init__(self, source: Source) -> None:
        fits = needed(
            "astropy.io.fits", extra="fits", needed_by=f"{source.path}: FITS", error=EvaluationError
        )
        check_regular(source.path)
        self._file = fits.open(source.path, mode="readonly", memmap=False)
        try:
            images = {n: unit for n, unit in enumerate(_units(self._file)) if unit.is_image}
            units = {unit.name or str(n): unit for n, unit in images.items() if len(unit.shape) > 1}
            named = units | {str(n): unit for n, unit in images.items()}
            image = pick(source, named, lambda: {n: u.shape for n, u in units.items()}, line=False)
            head = image.header
            super().__init__(image.section, source.axes, unit=str(head.get("BUNIT", "")))
            self._flipped = str(head.get("ROWORDER", "")).upper() == "BOTTOM-UP"
            self.notes += () if "ROWORDER" in head else ("no ROWORDER: first row at the top",)
            self.metadata = (self._metadata(head),) * len(self)
        except BaseException:
            self._file.close()
            raise

    def _metadata(self, head: Any) -> ImageMetadata:
        """Exposure of all images, and the time of a single one (FITS 4.0: DATE-OBS, EXPTIME)."""
        time_s = None
        if len(self) == 1 and "DATE-OBS" in head:
            with suppress(ValueError):
                time_s = moment_s(str(head["DATE-OBS"]))
        exposed = head.get("EXPTIME")
        return ImageMetadata(time_s, float(exposed) if isinstance(exposed, (int, float)) else None)

    def read(self, number: int) -> Any:
        """Image `number`, (rows, columns)."""
        image = super().read(number)
        return image[::-1] if self._flipped else image

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def _units(file: Any) -> list[Any]:
    """All units; a truncated file is an error, a keyword that is not standard is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message=".*truncated")
        return list(file)
