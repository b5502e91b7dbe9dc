"""Columns of a Parquet table, by pyarrow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.inputs import regular
from cldit.errors import SprayError


def _opened(file: Path) -> Any:
    try:
        from pyarrow.lib import ArrowException
        from pyarrow.parquet import ParquetFile
    except ImportError as error:
        raise SprayError(
            f"{file}: reading Parquet needs pyarrow; install it with: pip install "
            '"cldit[parquet]", or save the table as CSV'
        ) from error
    try:
        # pages have checksums where the writer made them
        return ParquetFile(regular(file), page_checksum_verification=True)
    except SprayError:
        raise
    except (ArrowException, OSError) as error:
        raise SprayError(f"{file}: is damaged, or no Parquet table ({error})") from error


def parquet_names(file: Path) -> list[str]:
    """The names of the columns.

    Raises:
        SprayError: pyarrow is not installed; the file is no Parquet table, or names a column twice.
    """
    names = [str(name) for name in _opened(file).schema_arrow.names]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice or not names:
        what = f"the column {twice[0]!r} twice" if twice else "no columns"
        raise SprayError(f"{file}: holds {what}")
    return names


def parquet_rows(file: Path) -> int:
    """How many rows it has; raises as `parquet_names`."""
    return int(_opened(file).metadata.num_rows)


def parquet_columns(file: Path, names: Sequence[str]) -> dict[str, Column]:
    """Some columns as doubles (N,), rows without a value marked as undefined.

    Args:
        file: the table.
        names: of the columns.

    Returns:
        The columns by name.

    Raises:
        SprayError: the file is damaged, or a column does not hold numbers.
    """
    from pyarrow.lib import ArrowException

    opened = _opened(file)
    for name in names:
        kind = opened.schema_arrow.field(name).type
        if str(kind) not in _NUMBERS:
            raise SprayError(f"{file}: column {name} holds {kind}; expected are numbers")
    try:
        table = opened.read(columns=list(names))
    except (ArrowException, OSError) as error:
        raise SprayError(f"{file}: is damaged or truncated ({error})") from error
    found = {}
    for name in names:
        column = table.column(name)
        empty = column.is_null().to_numpy() if column.null_count else None
        values = np.asarray(column.cast("float64").to_numpy(), np.float64)
        found[name] = Column(f"{file}: column {name}", values, empty)
    return found


_NUMBERS = {"float", "double", "halffloat"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
