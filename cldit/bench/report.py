"""Benchmark page: tables in Markdown, numbers in JSON, a figure."""

import json
import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from cldit.gpu.device import Device
from cldit.io.files import make_folder, write_text
from cldit.io.origin import commit
from cldit.show import page
from cldit.show.figures.style import write_figure


@dataclass(frozen=True)
class Part:
    """One measurement. text: paragraphs below the tables; data: for JSON; alternative: of the
    figure."""

    name: str
    title: str
    tables: tuple[page.Table, ...]
    data: Any
    text: tuple[str, ...] = ()
    figure: Figure | None = None
    alternative: str = ""


def write_part(
    part: Part, folder: Path, *, command: str, device: Device, suffix: str | None = None
) -> Path:
    """Writes NAME.md, NAME.json and NAME.png into `folder`; returns the path of the page.

    suffix: .pdf or .svg, of one more file of the figure.
    """
    make_folder(folder)
    write_text(folder / f"{part.name}.json", json.dumps(part.data, indent=1) + "\n")
    content: list[page.Block] = [page.Code(command), measured_on(device)]
    if part.figure is not None:
        if suffix is not None:
            write_figure(part.figure, folder / f"{part.name}{suffix}")
        file = f"{part.name}.png"
        content.append(page.Figure.of(part.figure, part.alternative, file=file))
    content += [*part.tables, *part.text]
    return page.write_page(page.Page(part.title, content), folder / f"{part.name}.md")


def measured_on(device: Device) -> str:
    """Sentence with the device, the versions and the commit."""
    info, revision = device.info, commit()
    return (
        f"Measured on {info.name}, {info.compute_units} compute units, {info.version}; cldit "
        f"{version('cldit')}{f' at commit {revision[:7] + revision[40:]}' if revision else ''}, "
        f"Python {platform.python_version()}."
    )


def number(value: float | None, digits: int = 3) -> str:
    """Value with `digits` significant digits; a dash for None and NaN."""
    if value is None or value != value:
        return "-"
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:,.0f}"
