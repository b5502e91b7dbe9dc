"""The paper's studies by name, in the order of its figures."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from cldit.errors import StudyError
from cldit.study.lab import Lab
from cldit.study.page import Page
from cldit.study.paper import (
    camera,
    conditions,
    evaporation,
    fuel_temperature,
    index,
    methane,
    optics,
    order,
    sizes,
    vapour,
    visible,
    walls,
)

STUDIES: dict[str, Callable[[Lab], Page]] = {
    "methane": methane.study,
    "optics": optics.study,
    "visible": visible.study,
    "camera": camera.study,
    "conditions": conditions.study,
    "order": order.study,
    "walls": walls.study,
    "sizes": sizes.study,
    "index": index.study,
    "vapour": vapour.study,
    "evaporation": evaporation.study,
    "fuel-temperature": fuel_temperature.study,
}


def run_study(name: str, lab: Lab) -> Page:
    """Runs the study `name` in `lab`; what it needs and the cache holds is not computed again.

    Raises:
        StudyError: no such study.
        ClditError: as `cldit.simulate`.
    """
    if name not in STUDIES:
        raise StudyError(f"{name}: no such study; there are {', '.join(STUDIES)}, or all")
    start = time.perf_counter()
    own = replace(lab, used={})
    page = STUDIES[name](own)
    reduced = ", with reduced pixels and accuracy" if lab.quick else ""
    return replace(
        page,
        about=f"The paper's {page.figure}{reduced}.",
        command=f"cldit study {name}{' --quick' if lab.quick else ''}",
        scenes=own.used,
        quick=lab.quick,
        seconds=time.perf_counter() - start,
    )
