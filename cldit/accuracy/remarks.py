"""Remarks of a run: its expected cost, and an error that is too large."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cldit.accuracy.allocation import Allocation
from cldit.accuracy.errors import Errors
from cldit.accuracy.sources import BY_NAME, SOURCES
from cldit.medium.frame import Cube
from cldit.medium.resolution import counted
from cldit.prepare.cell_choice import cell_bytes, memory_bytes
from cldit.prepare.medium import Prepared
from cldit.transport.trace import TraceSettings
from cldit.transport.trace_cost import TraceCost

_SOURCE_OF = {name: source for source in SOURCES for name in (source.name, *source.also)}


def too_large(
    errors: Errors,
    tolerance_K: float,
    limits: Mapping[str, str],
    *,
    emissivity: float | None = None,
) -> tuple[str, ...]:
    """Remark that an error exceeds its tolerance, with its largest source and a remedy.

    `limits` has the reason why a source cannot be made smaller, by its name; `emissivity` is the
    tolerance of its error, if it has one.
    """
    too_warm = errors.exceed(tolerance_K)
    largest = errors.largest(of_emissivity=not too_warm)
    if largest is None or not errors.exceed(tolerance_K, emissivity):
        return ()
    source = _SOURCE_OF.get(largest.name)
    remedy = {"": "a larger transport.accuracy_K"} if source is None else source.remedy
    advice = limits.get(largest.name, f"allowed: {remedy.get(largest.fixed, remedy[''])}")
    held = f", set by {largest.fixed}" if largest.fixed else ""
    stated, asked = errors.text, f"transport.accuracy_K: {tolerance_K:g}"
    part = largest.text
    if not too_warm:
        stated, part = f"of emissivity {errors.emissivity_text}", largest.emissivity_text
        asked = f"transport.accuracy_emissivity: {emissivity:.2g}"
    return (
        f"stated error {stated} RMS, more than {asked} asks for: {largest.name} "
        f"contribute{'' if largest.name.endswith('s') else 's'} {part}{held}; {advice}",
    )


_LONG_s, _MUCH = 60.0, 0.5  # core seconds, and share of the free memory, that are announced
_FEW_ORDINATES = 24  # of an image of 4 K or so


def expected(
    prepared: Prepared,
    frame: Cube,
    settings: Sequence[TraceSettings],
    *,
    coarse: Sequence[TraceCost],
    allocation: Allocation,
) -> tuple[str, ...]:
    """Remark on an image that takes a minute or half of the memory: its cost by source.

    `coarse` are the costs of the traces before it; without any, the time is unknown.
    """
    scene, device, count = prepared.scene, prepared.device, len(settings)
    counts = counted(frame, prepared.sources, device)
    phase = any(setting.phase is not None for setting in settings)
    stored = counts.memory_cells * cell_bytes(wavelengths=count, phase=phase)
    ordinates = sum(setting.final_directions for setting in settings)
    columns, rows = scene.camera.pixels
    measured = max(coarse, key=lambda cost: cost.cells, default=None)
    size = counts.swept, ordinates, columns * rows, count
    spent_s = 0.0 if measured is None else measured.scaled_s(*size)
    if spent_s <= _LONG_s and stored <= _MUCH * memory_bytes(device):
        return ()
    per_node = round(ordinates / count)
    needs = {
        "cells": (counts.swept / 32**3, f"{counts.swept:.2g} cells of {1e3 * frame.cell_m:.2g} mm"),
        "trace": (per_node / _FEW_ORDINATES, f"{per_node} ordinates"),
        "wavelengths": (float(count), f"{count} wavelength{'' if count == 1 else 's'}"),
    }
    largest = max(needs, key=lambda name: needs[name][0])
    key = BY_NAME[largest].key(scene)
    reason = f"set by {key}" if key else f"for {allocation[largest]:.2g} K"
    took = "" if measured is None else f"{spent_s:.2g} core-s and "
    product = ", ".join(need for _, need in needs.values())
    return (
        f"expected for the image: {took}{stored / 1e9:.2g} GB, by {product}; most of it by "
        f"{largest}, {reason}",
    )
