"""`cldit scenes`: what is shipped."""

from __future__ import annotations

import click
from rich.table import Table

from cldit.cli.console import OUT
from cldit.scene import shipped_scenes


@click.command()
def scenes() -> None:
    """The scenes that are shipped."""
    table = Table("scene", "", box=None)
    for name, description in shipped_scenes().items():
        table.add_row(name, description)
    OUT.print(table)
