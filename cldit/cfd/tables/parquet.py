"""Tables in Parquet, read by pyarrow."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.inputs import regular
from cldit.errors import SprayError
from cldit.io.extras import needed


def _opened(file: Path) -> Any:
    hint = ", or save the table as CSV"
    needed(
        "pyarrow.parquet",
        extra="parquet",
        needed_by=f"{file}: Parquet",
        error=SprayError,
        hint=hint,
    )
    from pyarrow.lib import ArrowException
    from pyarrow.parquet import ParquetFile

    try:
        # pages have checksums where the writer made them
        return ParquetFile(regular(file), page_checksum_verification=True)
    except SprayError:
        raise
    except (ArrowException, OSError) as error:
        raise SprayError(f"{file}: is damaged, or no Parquet table ({error})") from error


def parquet_names(file: Path) -> list[str]:
    """Names of the columns."""
    return [str(name) for name in _opened(file).schema_arrow.names]


def parquet_rows(file: Path) -> int:
    """Number of rows."""
    return int(_opened(file).metadata.num_rows)


def parquet_numbers(file: Path) -> set[str]:
    """Names of the columns of numbers."""
    return {column.name for column in _opened(file).schema_arrow if str(column.type) in _NUMBERS}


def parquet_columns(file: Path, names: Sequence[str]) -> dict[str, Column]:
    """Columns `names` as doubles (N,); rows without a value are marked as undefined."""
    from pyarrow.lib import ArrowException

    opened = _opened(file)
    for name in names:
        kind = opened.schema_arrow.field(name).type
        if str(kind) not in _NUMBERS:
            raise SprayError(f"{file}: column {name} is of type {kind}; expected: numbers")
    try:
        table = opened.read(columns=list(names))
    except (ArrowException, OSError) as error:
        raise SprayError(f"{file}: is damaged or truncated ({error})") from error
    columns = {}
    for name in names:
        column = table.column(name)
        empty = column.is_null().to_numpy() if column.null_count else None
        values = np.asarray(column.cast("float64").to_numpy(), np.float64)
        about = opened.schema_arrow.field(name).metadata or {}
        unit = (about.get(b"unit") or about.get(b"units") or b"").decode() or None
        columns[name] = Column(f"{file}: column {name}", values, empty, unit)
    return columns


_NUMBERS = {"float", "double", "halffloat"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
