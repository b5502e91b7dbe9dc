"""Tests of an extra, skipped where it is not installed."""

from __future__ import annotations

from importlib.util import find_spec

import pytest


def needs(*modules: str, extra: str) -> pytest.MarkDecorator:
    """Mark that skips a test if a top-level module is missing; imports none of them.

    Each worker collects every test, so an import at the top of a test file costs each of them.
    """
    missing = ", ".join(name for name in modules if find_spec(name) is None)
    return pytest.mark.skipif(bool(missing), reason=f"{missing} is missing; install cldit[{extra}]")
