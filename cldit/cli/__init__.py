"""The command line: a thin layer over the Python API."""

from __future__ import annotations

import click

from cldit import __version__
from cldit.cli.bench import bench
from cldit.cli.lists import devices, optics, scenes
from cldit.cli.rig import acquire_command, evaluate, show
from cldit.cli.run import run
from cldit.cli.sprays import droplet, import_command, spray_command
from cldit.cli.study import study


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def main() -> None:
    """Differential infrared thermography of fuel sprays: simulated, acquired, evaluated."""


for command in (
    run,
    scenes,
    devices,
    optics,
    spray_command,
    import_command,
    droplet,
    acquire_command,
    evaluate,
    show,
    bench,
    study,
):
    main.add_command(command)
