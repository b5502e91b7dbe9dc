"""The paper's studies by name, in the order of its figures; their sentences are in studies.yaml."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

from cldit.errors import StudyError
from cldit.study.lab import Lab
from cldit.study.page import OPEN, StudyPage
from cldit.study.paper.instruments import camera, optics, visible_light
from cldit.study.paper.maps import conditions, methane, order, walls
from cldit.study.paper.results import Results, page_of, sentences
from cldit.study.paper.rivals import models
from cldit.study.paper.variants import evaporation, fuel_temperature, index, sizes, vapour
from cldit.study.paper.variation import repeat

_NUMBER = re.compile(r"\d+")

STUDIES: dict[str, Callable[[Lab], Results]] = {
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
    "models": models,
    "fuel-temperature": fuel_temperature,
}


def studies_of(name: str) -> list[str]:
    """Names of the studies called `name`: one of them, `all`, or a figure such as fig12."""
    if name == "all":
        return list(STUDIES)
    figures = {
        study: {f"fig{number}" for number in _NUMBER.findall(sentences()[study]["figure"])}
        for study in STUDIES
    }
    figure = name.lower().replace(".", "").replace(" ", "")
    names = [study for study in STUDIES if study == name or figure in figures[study]]
    if not names:
        allowed = (f"{study} ({sentences()[study]['figure']})" for study in STUDIES)
        raise StudyError(f"{name}: no such study; allowed: {', '.join(allowed)}, or all")
    return names


def run_study(name: str, lab: Lab) -> StudyPage:
    """Runs the study `name` in `lab`, with runs and sprays from its cache."""
    if name not in STUDIES:
        raise StudyError(f"{name}: no such study; allowed: {', '.join(STUDIES)}, all")
    study_lab = replace(lab, used={})

    def decided(results: Results) -> bool:
        return all(verdict.word != OPEN for verdict in page_of(name, results).verdicts)

    page = page_of(name, repeat(STUDIES[name], study_lab, decided=decided))
    reduced = ", with reduced pixels and accuracy" if lab.quick else ""
    return replace(
        page,
        about=f"The paper's {page.figure}{reduced}.",
        command=f"cldit study {name}{' --quick' if lab.quick else ''}",
        scenes=study_lab.used,
        quick=lab.quick,
        device="" if lab.device is None else lab.device.info.name,
    )
