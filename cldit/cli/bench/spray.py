"""`cldit bench spray`: the computed spray against correlations and measurements."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.bench.spray.page import SECTIONS, page
from cldit.cli.console import OUT, plain_errors, say
from cldit.io.files import append_text, write_text
from cldit.io.terminal import tell
from cldit.run import default_cache


@click.command("spray")
@click.option("--out", type=click.Path(path_type=Path), help="Markdown file; else printed.")
@click.option("--spacing-mm", type=click.FloatRange(0.5, 4.0), default=1.0, show_default=True)
@click.option(
    "--only", type=click.Choice(list(SECTIONS)), multiple=True, help="Sections; may be repeated."
)
@plain_errors
def bench_spray_command(out: Path | None, spacing_mm: float, only: tuple[str, ...]) -> None:
    """The computed spray against correlations and measurements; takes minutes.

    Sections are written as they are done; `half`, with half the spacing, takes as long as the rest.
    """
    if out is not None:
        write_text(out, "")
    for piece in page(default_cache(), spacing_m=1e-3 * spacing_mm, only=only, say=say):
        if out is None:
            tell(piece, end="")
        else:
            append_text(out, piece)
    if out is not None:
        OUT.print(str(out))
