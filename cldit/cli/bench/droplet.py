"""`cldit bench droplet`: errors of the integrator of single droplets."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.bench.droplet.convergence import measure_all
from cldit.bench.droplet.picture import convergence_picture
from cldit.cli.console import OUT, plain_errors
from cldit.io.files import write_bytes
from cldit.run import default_cache


@click.command("droplet")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="PNG.")
@plain_errors
def bench_droplet_command(out: Path) -> None:
    """Error of a droplet's life against step size and run time, all models, stiff cases among
    them."""
    write_bytes(out, convergence_picture(*measure_all(default_cache())))
    OUT.print(str(out))
