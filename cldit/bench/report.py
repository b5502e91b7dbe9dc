"""What a measurement leaves behind: JSON of its numbers, a table to read, a picture."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from cldit.bench import PARTS
from cldit.gpu.device import Device
from cldit.io.files import make_folder, write_bytes, write_text
from cldit.show.figures.sheet import png_of


@dataclass(frozen=True)
class Table:
    """Rows of text under a head."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, head: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
        """A table of `rows` below their `head`."""
        return cls(tuple(head), tuple(tuple(row) for row in rows))

    def markdown(self) -> str:
        """The table as Markdown."""
        lines = [self.head, ("---",) * len(self.head), *self.rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)


@dataclass(frozen=True)
class Part:
    """One measurement. text: paragraphs under the tables; data: what JSON takes."""

    name: str
    title: str
    tables: tuple[Table, ...]
    data: Any
    text: tuple[str, ...] = ()
    figure: Figure | None = None
    alternative: str = field(default="")  # what the picture shows, in words


def write_part(part: Part, folder: Path, *, command: str, device: Device) -> Path:
    """Writes `folder`/bench/NAME.json, .md, .png, and `folder`/benchmarks.md, whose path it gives.

    Parts of other runs stay, each with the command that made it.

    Args:
        part: measured.
        folder: made if need be.
        command: makes the part again.
        device: measured on.
    """
    inside = folder / "bench"
    make_folder(inside)
    write_text(inside / f"{part.name}.json", json.dumps(part.data, indent=1) + "\n")
    blocks = [f"## {part.title}", f"```sh\n{command}\n```", _machine(device)]
    if part.figure is not None:
        write_bytes(inside / f"{part.name}.png", png_of(part.figure))
        blocks.append(f"![{part.alternative}](bench/{part.name}.png)")
    blocks += [table.markdown() for table in part.tables]
    blocks += part.text
    write_text(inside / f"{part.name}.md", "\n\n".join(blocks) + "\n")
    page = folder / "benchmarks.md"
    found = [inside / f"{name}.md" for name in PARTS]
    write_text(
        page,
        "# Benchmarks\n\nWritten by `cldit bench`; every part stands under the command that made "
        "it. Times are of that machine: compare rows, not machines.\n\n"
        + "\n".join(path.read_text(encoding="utf-8") for path in found if path.is_file()),
    )
    return page


def _machine(device: Device) -> str:
    info = device.info
    return (
        f"{info.name}, {info.compute_units} compute units, {info.version}; cldit "
        f"{version('cldit')}, Python {platform.python_version()}."
    )


def number(value: float | None, digits: int = 3) -> str:
    """`value` for a table, with `digits` significant ones; a dash for None and NaN."""
    if value is None or value != value:
        return "-"
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:,.0f}"
