"""Tables as spreadsheets and solvers write them: quotes, semicolons, decimal commas, units."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_tables
from tests.unit.cfd.reading import notes_of, read, refused


def parcels(path: Path, change: Callable[[str], str]) -> dict[str, Any]:
    """Rewrites the table of parcels with commas, then by `change`; its mapping, to be written."""
    file = path.parent / "drops.txt"
    text = file.read_text().replace(" ", ",").replace("made,by,a,test\n", "")
    file.write_bytes(change(text).encode("utf-8", "surrogateescape"))
    mapping: dict[str, Any] = yaml.safe_load(path.read_text())
    del mapping["parcels"]["delimiter"], mapping["parcels"]["header_line"]
    return mapping


def lines(text: str, head: str, row: str) -> str:
    """The table with its header and rows in these forms; `{}` is what was there."""
    first, *rows = text.splitlines()
    return "\n".join([head.format(first), *(row.format(line) for line in rows), ""])


def quoted_cells(text: str) -> str:
    """Every cell in quotes, one of text with a comma and a doubled quote."""
    quoted = re.sub(
        r"(?m)(?<=^)([^\n]+)$", lambda row: '"' + row[1].replace(",", '","') + '"', text
    )
    head = text.splitlines()[0]
    return lines(quoted, f"Name,{head}", '"a ""b"", c",{}')


def repeated_header(text: str) -> str:
    head, *rows = text.splitlines()
    return "\n".join([head, *rows[:5], head, *rows[5:], ""])


def cfd_post(text: str) -> str:
    named = text.replace("X,Y,Z", "X [ mm ], Y [ mm ], Z [ mm ]", 1)
    return f"\n[Name]\nparcels, all of them\n\n[Data]\n{named}"


DIALECTS: dict[str, Callable[[str], str]] = {
    # a column whose name holds the delimiter, before those that count
    "quoted comma": lambda text: lines(text, '"Mass, kg",{}', "7.5,{}"),
    "quoted cells": quoted_cells,
    "semicolons": lambda text: text.replace(",", ";"),
    "tabs": lambda text: text.replace(",", "\t"),
    "marked UTF-8": lambda text: "\ufeff" + text.replace("\n", "\r\n"),
    "decimal commas": lambda text: text.replace(",", ";").replace(".", ","),
    # the degree sign is one byte, which is no UTF-8
    "Latin-1": lambda text: lines(text, "{},room (\udcb0C)", "{},21"),
    "Fortran": lambda text: re.sub(r"e([-+]\d\d)", r"D\1", text),
    "remarks": lambda text: f"% made by a solver\n% {text}",
    # as Excel's "Unicode text"
    "UTF-16": lambda text: ("\ufeff" + text).encode("utf-16-le").decode("utf-8", "surrogateescape"),
    "repeated header": repeated_header,
    "CFD-Post": cfd_post,
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialects(tmp_path: Path, dialect: str) -> None:
    path = write_tables(tmp_path, foam.sample())
    expected = notes_of(path)
    mapping = parcels(path, DIALECTS[dialect])
    if dialect == "decimal commas":
        path.write_text(yaml.safe_dump(mapping))
        refused(path, r"not all numbers.*`decimal: ','`")
        mapping["parcels"]["decimal"] = ","
    path.write_text(yaml.safe_dump(mapping))
    assert notes_of(path) == expected


def with_first_T(cell: str) -> Callable[[str], str]:
    """Writes `cell` as the temperature of the first parcel."""

    def change(text: str) -> str:
        head, row, *rows = text.splitlines()
        cells = row.split(",")
        cells[head.split(",").index("T")] = cell
        return "\n".join([head, ",".join(cells), *rows, ""])

    return change


def test_units_in_the_header(tmp_path: Path) -> None:
    path = write_tables(tmp_path, foam.sample())
    expected = notes_of(path)
    mapping = parcels(
        path,
        lambda text: text.replace(
            "X,Y,Z,R,M,T,rho", "X [mm],Y [mm],Z (mm),R [µm],M [mg],T (K),rho", 1
        ),
    )
    named = mapping["parcels"]
    named["position"], named["radius"], named["mass"] = ["X", "Y", "Z"], "R", "M [mg]"
    path.write_text(yaml.safe_dump(mapping))
    assert notes_of(path) == expected
    named["radius"] = {"column": "R", "unit": "mm"}
    path.write_text(yaml.safe_dump(mapping))
    refused(path, r"column 'R \[µm\]' is in um by its name, and in mm by")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("\n", ",9\n", 2).replace(",9", "", 1), "line 2 has 11 cells"),
        (
            lambda text: text.replace("X,", "X;", 1),
            "line 2 has 1 cells, the header 2",
        ),
        (lambda text: text.replace(".", ","), "line 2 has .* cells, the header 10"),
        (lambda text: text[: len(text) // 2], "last line has no end"),
    ],
)
def test_rows_that_do_not_fit(tmp_path: Path, change: Any, message: str) -> None:
    path = write_tables(tmp_path, foam.sample())
    path.write_text(yaml.safe_dump(parcels(path, change)))
    refused(path, message)


def test_a_quote_that_is_not_closed(tmp_path: Path) -> None:
    """Two stray quotes in a column of text would make the rows between them one cell."""
    path = write_tables(tmp_path, foam.sample())
    mapping = parcels(path, lambda text: text)
    file = tmp_path / "drops.txt"
    rows = [f"{row},x" for row in file.read_text().splitlines()]
    rows[2], rows[5] = f'{rows[2][:-1]}"x', f'{rows[5][:-1]}"x'
    file.write_text("\n".join([*rows, ""]))
    path.write_text(yaml.safe_dump(mapping))
    refused(path, r"drops\.txt: 17 lines make 14 rows: a quote is not closed")


@pytest.mark.parametrize("mark", [",", "\t", " "])
def test_blank_lines_and_comments(mark: str, tmp_path: Path) -> None:
    path = write_tables(tmp_path, foam.sample())
    expected = notes_of(path)
    mapping = parcels(path, lambda text: text.replace("\n", "\n   \n  # a comment\n"))
    file = tmp_path / "drops.txt"
    file.write_text(file.read_text().replace(",", mark))
    path.write_text(yaml.safe_dump(mapping))
    assert notes_of(path) == expected


def test_gas_alone_is_a_choice(tmp_path: Path) -> None:
    path = write_tables(tmp_path, foam.sample())
    spray = read(path, cloud="none")
    assert spray.parcels is None
    assert {Path(file.path).name for file in spray.files} == {"mapping.yaml", "cells.csv"}
    refused(path, "no cloud 'rain'", cloud="rain")


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        (
            "Time (s)",
            "0.0001 0.0002",
            "column Time .s.: has 2 values: 0.0001, 0.0002; .*",
        ),
        ("Particle ID", "a7 a7", "column Particle ID: a7 occurs .* times, so the rows are tracks"),
        ("Particle ID", "7 7", "column Particle ID: 7 occurs .* times, so the rows are tracks"),
        ("step", "10 10", ""),
        ("injector", "1 2", ""),
    ],
)
def test_a_table_of_several_times(tmp_path: Path, name: str, values: str, message: str) -> None:
    path = write_tables(tmp_path, foam.sample())
    mapping = yaml.safe_load(path.read_text())
    file = tmp_path / "drops.txt"
    skipped, head, *rows = file.read_text().replace(" ", ";").splitlines()
    given = values.split()
    rows = [f"{row};{given[n % 2]}" for n, row in enumerate(rows)]
    file.write_text("\n".join([skipped, f"{head};{name}", *rows, ""]))
    mapping["parcels"]["delimiter"] = ";"
    path.write_text(yaml.safe_dump(mapping))
    if not message:
        read(path)
        return
    refused(path, message)


@pytest.mark.parametrize("undefined", ["-1.#IND", "1.#QNAN0", ""])
def test_an_undefined_number_is_one_parcel_omitted(tmp_path: Path, undefined: str) -> None:
    path = write_tables(tmp_path, foam.sample())
    path.write_text(yaml.safe_dump(parcels(path, with_first_T(undefined))))
    spray = read(path, parcels_left_out=0.1)
    assert spray.notes["parcels"] == 16
    assert any("Omitted 1 of 17 parcels" in remark for remark in spray.remarks)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ('"1,384.5"', "row 1 has '1,384.5' in the column T; remove the thousands separators"),
        ('"384,5"', "row 1 has '384,5' in the column T; for a decimal comma give `decimal: ','`"),
        ("warm", "row 1 has 'warm' in the column T; write numbers"),
    ],
)
def test_cells_that_are_no_number(tmp_path: Path, cell: str, message: str) -> None:
    path = write_tables(tmp_path, foam.sample())
    path.write_text(yaml.safe_dump(parcels(path, with_first_T(cell))))
    refused(path, re.escape(message))
