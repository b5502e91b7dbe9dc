"""Fixed orders: `source` and the paper's `branching`, each against `path` of the same order."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cldit.bench.case import Case, Lattice, Say, one_pixel
from cldit.bench.error import Compared, Row, Truth

SOURCE_K = (1.0, 0.1)  # what `source` is asked for
EVERY = 25  # spacing of the pixels of `branching` at order 2, whose whole picture takes an hour
_SEEDS = (1, 2)


def bench_orders(
    case: Case, truth: Truth, *, phase: str, lattice: Lattice, say: Say, every: int = EVERY
) -> list[Row]:
    """Compares orders 0 to 2; of `branching` only if the phase function is isotropic.

    `source` makes the whole picture, with light that changes within cells, and with light that is
    even in them, as `branching` has it.

    Args:
        case: with the scene.
        truth: of all orders, on the lattice's pixels.
        phase: phase function.
        lattice: pixels to compare.
        say: takes lines of progress.
        every: spacing of the pixels that `branching` traces at order 2.

    Returns:
        A row for each order and method.
    """
    compared = Compared(case, lattice, truth, phase)
    rows: list[Row] = []
    for order in range(3):
        own = _truth(compared, order)
        found = [_source(compared, own, order, *method) for method in _methods(order)]
        if phase == "isotropic":
            traced = compared
            if order == 2:
                traced = _spaced(compared, every)
                own = _truth(traced, order)
            found.append(_branching(traced, own, order))
        for row in found:
            cost = f"{row.picture_core_s:.4g} core-s, {row.of_order_K:.3f} K RMS"
            say(f"{phase}: {row.label}: {cost}")
        rows += found
    return rows


def _methods(order: int) -> list[tuple[str, str, dict[str, Any]]]:
    """Method, label and keys of the scene's `transport`: at order 0 all are one."""
    label = f"source, order {order}"
    if not order:
        return [("source", label, {})]
    methods: list[tuple[str, str, dict[str, Any]]] = [
        ("source", f"{label}, {accuracy_K:g} K", {"accuracy_K": accuracy_K})
        for accuracy_K in SOURCE_K
    ]
    accuracy_K = SOURCE_K[0]
    even = {"accuracy_K": accuracy_K, "gather": False}
    return [*methods, ("source, no gather", f"{label}, no gather, {accuracy_K:g} K", even)]


def _source(
    compared: Compared, own: Truth, order: int, method: str, label: str, transport: dict[str, Any]
) -> Row:
    case = compared.case
    settings = case.settings(phase=compared.phase, order=order, audit=False, **transport)
    result, cost = case.run(settings)
    weights = compared.lattice.pick(case.scene, result.weights)
    row = compared.row(method, label, weights, cost, order=order)
    temperature_K = compared.part.temperature_K(weights)
    return replace(row, of_order_K=own.rms(temperature_K, own.temperature_K))


def _truth(compared: Compared, order: int) -> Truth:
    samples = compared.truth.samples
    return Truth.of(compared.part, samples=samples, phase=compared.phase, order=order)


def _spaced(compared: Compared, every: int) -> Compared:
    """The same of other pixels."""
    lattice = Lattice((every, every))
    part = compared.case.seen(lattice.of(compared.case.scene))
    truth = Truth.of(part, samples=compared.truth.samples, phase=compared.phase)
    return replace(compared, lattice=lattice, truth=truth)


def _branching(compared: Compared, own: Truth, order: int) -> Row:
    """Run twice, to tell its noise from what it simplifies."""
    case, part = compared.case, compared.part
    settings = part.settings(method="branching", phase=compared.phase, order=order)
    empty = case.seen(one_pixel(case.scene))
    empty.run(settings)  # builds
    fixed = empty.run(settings)[1].core_s
    runs = [part.run(replace(settings, seed=seed)) for seed in _SEEDS]
    result, cost = runs[0]
    row = compared.row(
        "branching",
        f"branching, order {order}",
        result.weights,
        cost,
        fixed_core_s=fixed,
        order=order,
    )
    temperatures_K = [part.temperature_K(run.weights) for run, _ in runs]
    squares = [own.rms(image, own.temperature_K) ** 2 for image in temperatures_K]
    return replace(
        row, of_order_K=float(np.mean(squares)) ** 0.5, left_K=own.common(*temperatures_K)
    )
