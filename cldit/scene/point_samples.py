"""Samples of a point spread: a text table or a TIFF, checked and divided by their sum."""

from pathlib import Path

import numpy as np

from cldit.errors import FileError, RunFolderError, SceneError
from cldit.io.images import read_image
from cldit.io.text_tables import number_table, read_table_text

Samples = tuple[tuple[float, ...], ...]
_MOST = 129  # samples along a side: 64 on either side of the middle


def read_samples(path: Path) -> Samples:
    """Reads a table of numbers, a row of the image in each line, or a TIFF of one image."""
    try:
        if path.suffix.lower() in (".tif", ".tiff"):
            return check_samples(read_image(path)[0].tolist(), source=str(path))
        table = number_table(read_table_text(path))
    except (FileError, RunFolderError) as error:
        raise SceneError(str(error)) from error
    except ValueError as error:
        raise SceneError(f"{path}: {error}; allowed: a table of numbers, or a .tif") from error
    return check_samples([row.values for row in table.rows], source=str(path))


def check_samples(rows: object, *, source: str) -> Samples:
    """Samples (odd, odd) of sum 1; raises SceneError for what is no point spread."""
    try:
        samples = np.array(rows, np.float64)
    except (TypeError, ValueError) as error:
        raise SceneError(f"{source}: no table of numbers; allowed: rows of equal length") from error
    odd = f"allowed: odd numbers of rows and columns, 3 to {_MOST}"
    if samples.ndim != 2 or any(n % 2 == 0 or not 3 <= n <= _MOST for n in samples.shape):
        raise SceneError(f"{source}: {' x '.join(map(str, samples.shape))} samples; {odd}")
    if invalid := samples[~(np.isfinite(samples) & (samples >= 0.0))].tolist():
        raise SceneError(f"{source}: a sample is {invalid[0]:g}; allowed: finite numbers from 0")
    total = float(samples.sum())
    if not total > 0.0:
        raise SceneError(f"{source}: all samples are 0; allowed: a sum above 0")
    if abs(total - 1.0) > 1e-12:  # those of a stored scene stay as they are
        samples = samples / total
    return tuple(map(tuple, samples.tolist()))
