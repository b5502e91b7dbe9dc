"""Time and memory that an image is expected to take, from the coarse traces before it."""

from __future__ import annotations

from collections.abc import Sequence

from cldit.accuracy.allocation import Allocation
from cldit.accuracy.coarse_cost import CoarseCost
from cldit.accuracy.sources import BY_NAME
from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import Sources
from cldit.medium.resolution import memory_cells, swept_cells
from cldit.prepare.cell_choice import cell_bytes, memory_bytes
from cldit.scene import Scene
from cldit.transport.trace import TraceSettings

_LONG_s, _MUCH = 60.0, 0.5  # core seconds, and share of the free memory, that are announced
_FEW_ORDINATES = 24  # of an image of 4 K or so


def expected(
    scene: Scene,
    device: Device,
    frame: Frame,
    sources: Sources,
    settings: Sequence[TraceSettings],
    *,
    coarse: Sequence[CoarseCost],
    allocation: Allocation,
) -> tuple[str, ...]:
    """Remark on an image that takes a minute or half of the memory: how much, and which source
    needs it; else nothing.

    `coarse` are the costs of the traces before it; without any, the time is unknown.
    """
    cells, count = swept_cells(frame, sources), len(settings)
    phase = any(one.phase is not None for one in settings)
    stored = memory_cells(frame, sources) * cell_bytes(wavelengths=count, phase=phase)
    ordinates = sum(one.final_directions for one in settings)
    columns, rows = scene.camera.pixels
    most = max(coarse, key=lambda one: one.cells, default=None)
    spent_s = 0.0 if most is None else most.scaled_s(cells, ordinates, columns * rows, count)
    if spent_s <= _LONG_s and stored <= _MUCH * memory_bytes(device):
        return ()
    each = round(ordinates / count)
    needs = {
        "cells": (cells / 32**3, f"{cells:.2g} cells of {1e3 * frame.cell_m:.2g} mm"),
        "trace": (each / _FEW_ORDINATES, f"{each} ordinates"),
        "wavelengths": (float(count), f"{count} wavelength{'' if count == 1 else 's'}"),
    }
    largest = max(needs, key=lambda name: needs[name][0])
    key = BY_NAME[largest].key(scene)
    why = f"set by {key}" if key else f"for {allocation[largest]:.2g} K"
    took = "" if most is None else f"{spent_s:.2g} core-s and "
    product = ", ".join(text for _, text in needs.values())
    return (
        f"expected for the image: {took}{stored / 1e9:.2g} GB, by {product}; most of it by "
        f"{largest}, {why}",
    )
