"""Images in text, a line for each row of pixels, as cameras' programs export them.

InfraTec's IRBIS writes sections of header lines (`ImageWidth=640`, `TempUnit=°C`) above `[Data]`;
FLIR's programs write `File:` and `Parameters:`, and `Frame 1` in front of each image's first row;
Optris' PIX Connect writes numbers alone; spreadsheets and pandas number rows and columns.
"""

import re

import numpy as np

from cldit.acquisition.pictures.source import ArrayStack, Source
from cldit.arrays import Floats
from cldit.io.text_tables import NumberRow, number_table, read_table_text

_UNIT = re.compile(
    r"(?:unit\w*\s*[=:;,\t]\s*|[\[(]\s*)\"?"
    r"(°?\s?[CF]|K|deg\s?[CF]|celsius|kelvin|fahrenheit|counts|digital levels?|dl|w/\S+)\b",
    re.IGNORECASE,
)
_SIZE = re.compile(r"\b(width|height|columns|cols|rows)\s*[=:;,\t]\s*(\d+)\b", re.IGNORECASE)
_WIDE = ("width", "columns", "cols")
_COLD_C, _HOT_C = -80.0, 800.0  # of what infrared cameras export as temperatures


class TextImages(ArrayStack):
    """Images of a text file: rows of pixels below header rows."""

    def __init__(self, source: Source) -> None:
        table = number_table(read_table_text(source.path))
        images = _images(table.rows)
        notes = [f"header rows omitted: {len(table.header)}"] if table.header else []
        across, down = _evenly(images[0]), _evenly(images[0].T)
        notes += ["first row omitted: it has the columns' positions"] * across
        notes += ["first column omitted: it has the rows' positions"] * down
        images = images[:, int(across) :, int(down) :]
        header = "\n".join(table.header)
        for name, number in _SIZE.findall(re.sub(r"(?i)image(?=width|height)", "", header)):
            actual = images.shape[2 if name.lower() in _WIDE else 1]
            if actual != int(number):
                raise ValueError(f"its header has {name} {number}, its numbers {actual}; cut off?")
        unit = _UNIT.search(header)
        if unit is None:
            low, high = float(images.min()), float(images.max())
            degrees = low > _COLD_C and high < _HOT_C and bool(np.any(images % 1.0))
            maybe = f"; decimals of {low:g} to {high:g} could be degrees Celsius" if degrees else ""
            notes.append(f"no unit, read as counts{maybe}")
        integer = bool(
            np.all(images % 1.0 == 0.0) and images.min() >= 0.0 and images.max() < 65536.0
        )
        counts = images.astype(np.uint16) if integer else images
        super().__init__(counts, source.axes, unit=unit[1] if unit else "")
        self.notes = tuple(notes)


def _images(rows: list[NumberRow]) -> Floats:
    """Images (N, H, W): a label such as `Frame 1` begins one, or blank lines separate them."""
    numbers = np.array([row.values for row in rows])
    begins = [n for n, row in enumerate(rows) if row.label and "frame" in row.label.lower()]
    if not begins:
        begins = [n for n, row in enumerate(rows) if not n or row.block != rows[n - 1].block]
        heights = set(np.diff([*begins, len(rows)]))
        if len(heights) > 1 or heights == {1}:  # blank lines mean nothing here
            begins = [0]
    heights = set(np.diff([*begins, len(rows)]))
    if begins[0] or len(heights) > 1:
        raise ValueError(f"its frames have {', '.join(map(str, sorted(heights)))} rows; cut off?")
    return numbers.reshape(len(begins), -1, numbers.shape[1])


def _evenly(image: Floats) -> bool:
    """True if only the first row (or column) has evenly spaced numbers: no pixels, but places."""

    def even(row: Floats) -> bool:
        steps = np.diff(row)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            return False
        units = 10.0 ** -np.arange(1.0 + np.finfo(np.float32).precision)
        fitting = [
            unit for unit in units if np.allclose(np.rint(row / unit) * unit, row, atol=1e-9)
        ]
        return bool(np.ptp(steps) <= 2.001 * (fitting or [units[-1]])[0])  # both ends are rounded

    return min(image.shape) > 3 and even(image[0, 1:]) and not any(map(even, image[1:, 1:]))
