"""xarray, if it is installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from cldit.errors import ClditError


def xarray_module() -> Any:
    """The module `xarray`; ClditError if it is not installed."""
    try:
        return import_module("xarray")
    except ImportError as error:
        raise ClditError(
            'labelled data sets need xarray, which is not installed: pip install "cldit[studies]"'
        ) from error
