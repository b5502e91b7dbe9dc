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
class Found:
    """Results of a study: values for its sentences, drawn or captioned figures, and a table.

    repeated: False if the study has repetitions of its own.
    """

    values: Mapping[str, Value]
    table: Sequence[Row]
    sheets: Mapping[str, Drawn] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    repeated: bool = True


@cache
def sentences() -> dict[str, Any]:
    """Contents of studies.yaml by study."""
    return read_mapping(Path(__file__).with_name("studies.yaml"), error=StudyError)


def page_of(
    name: str,
    results: Found,
    *,
    errors: Mapping[str, float],
    row_errors: Sequence[Mapping[str, float]] = (),
) -> StudyPage:
    """Page of the study `name`: its sentences with the values filled in, and errors of values."""
    study, values = sentences()[name], results.values

    def filled(sentence: str) -> str:
        return sentence.format_map(values)

    def number(value: Value | None) -> float | None:
        return float(values[value]) if isinstance(value, str) else value

    captions = {key: filled(text) for key, text in study.get("figures", {}).items()}
    return StudyPage(
        name=name,
        title=study["title"],
        figure=study["figure"],
        text=filled(study["text"]),
        figures={
            **{key: Figure.of(sheet, captions[key]) for key, sheet in results.sheets.items()},
            **results.figures,
        },
        table=results.table,
        row_errors=row_errors,
        verdicts=tuple(
            Verdict(
                claim=filled(claim["claim"]),
                value=float(values[claim["value"]]),
                error=errors.get(claim["value"], 0.0),
                unit=claim.get("unit", ""),
                low=number(claim.get("low")),
                high=number(claim.get("high")),
                reason=filled(claim.get("why", "")),
            )
            for claim in study["claims"]
        ),
    )
