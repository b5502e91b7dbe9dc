"""A disk that takes no file above a size, as a quota and a full disk do: by the process's limit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def full_disk(*, most_bytes: int) -> Iterator[None]:
    """Writes beyond `most_bytes` of any file fail with EFBIG, and what fits is written."""
    resource = pytest.importorskip("resource", reason="the system knows no limits of a process")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
