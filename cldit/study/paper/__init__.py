"""The paper's studies by name, in the order of its figures; their sentences are in studies.yaml."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from cldit.errors import StudyError
from cldit.study.lab import Lab
from cldit.study.page import StudyPage
from cldit.study.paper.found import Found, page_of
from cldit.study.paper.instruments import camera, optics, visible_light
from cldit.study.paper.maps import conditions, methane, order, walls
from cldit.study.paper.variants import evaporation, fuel_temperature, index, sizes, vapour

STUDIES: dict[str, Callable[[Lab], Found]] = {
    "methane": methane,
    "optics": optics,
    "visible": visible_light,
    "camera": camera,
    "conditions": conditions,
    "order": order,
    "walls": walls,
    "sizes": sizes,
    "index": index,
    "vapour": vapour,
    "evaporation": evaporation,
    "fuel-temperature": fuel_temperature,
}


def run_study(name: str, lab: Lab) -> StudyPage:
    """Runs the study `name` in `lab`, with runs and sprays from its cache.

    Raises:
        StudyError: no such study.
        ClditError: as `cldit.simulate`.
    """
    if name not in STUDIES:
        raise StudyError(f"{name}: no such study; allowed: {', '.join(STUDIES)}, all")
    start = time.perf_counter()
    own = replace(lab, used={})
    page = page_of(name, STUDIES[name](own))
    reduced = ", with reduced pixels and accuracy" if lab.quick else ""
    return replace(
        page,
        about=f"The paper's {page.figure}{reduced}.",
        command=f"cldit study {name}{' --quick' if lab.quick else ''}",
        scenes=own.used,
        quick=lab.quick,
        seconds=time.perf_counter() - start,
    )
