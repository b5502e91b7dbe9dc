"""`cldit bench spray`: the computed spray against correlations and measurements."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.cli.console import OUT, plain_errors, say
from cldit.run import default_cache
from cldit.spray.flow.page import page


@click.command("spray")
@click.option("--out", type=click.Path(path_type=Path), help="Markdown file; else printed.")
@click.option("--spacing-mm", type=click.FloatRange(0.5, 4.0), default=1.0, show_default=True)
@plain_errors
def bench_spray_command(out: Path | None, spacing_mm: float) -> None:
    """The computed spray against correlations and measurements; takes minutes."""
    text = page(default_cache(), spacing_m=1e-3 * spacing_mm, say=say)
    if out is None:
        click.echo(text)
        return
    out.write_text(text, encoding="utf-8")
    OUT.print(str(out))
