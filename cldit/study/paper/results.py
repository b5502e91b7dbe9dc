"""Pages of the paper's studies: values and figures of a study, sentences of studies.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure as Drawn

from cldit.errors import StudyError
from cldit.io.plain_data import read_mapping
from cldit.show.page import Figure
from cldit.study.page import Row, StudyPage, Verdict

Value = float | str


@dataclass(frozen=True)
class Results:
    """Results of a study: values for its sentences, a table, and figures by the names of their
    captions.

    repeated: False if the study has repetitions of its own. errors, row_errors: standard errors of
    values and of rows, empty without repetitions. seeds: of the sprays over which values and rows
    are means; empty if no spray is computed.
    """

    values: Mapping[str, Value]
    table: Sequence[Row]
    sheets: Mapping[str, Drawn] = field(default_factory=dict)
    repeated: bool = True
    errors: Mapping[str, float] = field(default_factory=dict)
    row_errors: Sequence[Mapping[str, float]] = ()
    seeds: tuple[int, ...] = ()


@cache
def sentences() -> dict[str, Any]:
    """Contents of studies.yaml by study."""
    return read_mapping(Path(__file__).with_name("studies.yaml"), error=StudyError)


def page_of(name: str, results: Results) -> StudyPage:
    """Page of the study `name`: its sentences with the values filled in, and errors of values."""
    study, values = sentences()[name], results.values

    def filled(sentence: str) -> str:
        return sentence.format_map(values)

    def number(value: Value | None) -> float | None:
        return float(values[value]) if isinstance(value, str) else value

    return StudyPage(
        name=name,
        title=study["title"],
        figure=study["figure"],
        text=filled(study["text"]),
        figures={
            key: Figure.of(sheet, filled(study["figures"][key]), file=f"study-{name}-{key}.png")
            for key, sheet in results.sheets.items()
        },
        table=results.table,
        row_errors=results.row_errors,
        seeds=results.seeds,
        verdicts=tuple(
            Verdict(
                claim=filled(claim["claim"]),
                value=float(values[claim["value"]]),
                error=results.errors.get(claim["value"], 0.0),
                unit=claim.get("unit", ""),
                low=number(claim.get("low")),
                high=number(claim.get("high")),
                reason=filled(claim.get("why", "")),
            )
            for claim in study["claims"]
        ),
    )
