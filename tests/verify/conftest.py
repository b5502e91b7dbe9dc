"""Blocks of given coefficients, traced without an estimate of the error: the truth is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cldit.gpu.device import Device
from cldit.run import Run
from tests.verify.blocks import Blocks


@pytest.fixture
def run_block(tmp_path: Path, tables: Path, device: Device) -> Callable[..., Run]:
    """Function with the arguments of `Blocks.run`."""
    blocks = Blocks(device, tmp_path, tables)

    def run(arrays: dict[str, Any], *, size_m: tuple[float, float, float], **scene: Any) -> Run:
        transport = {"audit": False, "accuracy_K": 0.1, **scene.pop("transport", {})}
        return blocks.run(arrays, size_m=size_m, transport=transport, **scene)

    return run
