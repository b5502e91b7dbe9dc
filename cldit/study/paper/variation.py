"""Error of a study's figures: the study repeated with other random numbers and on coarser cells.

A figure is a property of one image or a change between two. Both images of a change have the same
random numbers and cells in each repetition, so that what both share is no part of its error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from cldit.scene.spray import LagrangianSpray
from cldit.study.lab import Lab
from cldit.study.page import Row
from cldit.study.paper.results import Results, Value

_SIGMA = 0.8413  # quantile of one standard error
MOST_SEEDS = {False: 4, True: 2}  # by `quick`


def repeat(
    study: Callable[[Lab], Results], lab: Lab, *, decided: Callable[[Results], bool]
) -> Results:
    """Runs `study` with the seed of `lab`, on its cells and on cells of twice the edge.

    If it has computed sprays, further seeds follow until all verdicts are `decided`, at least one
    and at most `MOST_SEEDS` in all.
    """
    initial = study(lab)
    if not lab.used or not initial.repeated:
        return initial
    aside = replace(lab, used={})
    coarse = study(replace(aside, coarser=2.0))
    repetitions = [initial]
    if not any(isinstance(scene.spray, LagrangianSpray) for scene in lab.used.values()):
        return replace(_combined(repetitions, coarse, first_seed=lab.seed), seeds=())
    while True:
        repetitions.append(study(replace(aside, seed=lab.seed + len(repetitions))))
        combined = _combined(repetitions, coarse, first_seed=lab.seed)
        if len(repetitions) >= MOST_SEEDS[lab.quick] or decided(combined):
            return combined


def _combined(repetitions: Sequence[Results], coarse: Results, *, first_seed: int) -> Results:
    """Means over the repetitions, and their standard errors."""
    values, errors = _means([repetition.values for repetition in repetitions], coarse.values)
    pairs = [
        _means(rows[:-1], rows[-1])
        for rows in zip(*(repetition.table for repetition in (*repetitions, coarse)), strict=True)
    ]
    return replace(
        repetitions[0],
        values=values,
        table=[row for row, _ in pairs],
        errors=errors,
        row_errors=[row for _, row in pairs],
        seeds=tuple(range(first_seed, first_seed + len(repetitions))),
    )


def _means(
    repetitions: Sequence[Row | Mapping[str, Value]], coarse: Row | Mapping[str, Value]
) -> tuple[dict[str, Value], dict[str, float]]:
    """Means of the numbers of several mappings with one set of keys, and their errors.

    The error is that of the mean (Student's t for few repetitions), and in quadrature the change
    that coarser cells make with the first seed: that of first order at least.
    """
    means: dict[str, Value] = dict(repetitions[0])
    errors: dict[str, float] = {}
    for name, initial in repetitions[0].items():
        if isinstance(initial, str) or isinstance(coarse[name], str):
            continue
        numbers = [float(repetition[name]) for repetition in repetitions]
        chance = 0.0
        if len(numbers) > 1:
            chance = float(stats.sem(numbers) * stats.t.ppf(_SIGMA, len(numbers) - 1))
        means[name] = float(np.mean(numbers))
        errors[name] = math.hypot(chance, float(coarse[name]) - float(initial))
    return means, errors
