"""The command line: a thin layer over the Python API."""

import click

from cldit import __version__
from cldit.cli.program import Program, epilog

_COMMANDS = {
    "run": "cldit.cli.run:run",
    "compare": "cldit.cli.compare:compare_command",
    "scenes": "cldit.cli.scenes:scenes",
    "devices": "cldit.cli.devices:devices",
    "check-driver": "cldit.cli.check_driver:check_driver",
    "import": "cldit.cli.sprays:import_command",
    "fit": "cldit.cli.fit:fit_command",
    "plan": "cldit.cli.plan:plan_command",
    "acquire": "cldit.cli.acquire:acquire_command",
    "evaluate": "cldit.cli.evaluate:evaluate",
    "export": "cldit.cli.export:export_command",
    "show": "cldit.cli.show:show",
    "view": "cldit.cli.show:view_command",
    "study": "cldit.cli.study:study",
}
# Names of earlier versions, which say what replaces them, and the benchmark of developers.
_UNLISTED = {
    "repeat": "cldit.cli.compare:repeat_command",
    "diff": "cldit.cli.compare:diff",
    "optics": "cldit.cli.show:optics_command",
    "spray": "cldit.cli.show:spray_command",
    "droplet": "cldit.cli.sprays:droplet",
    "bench": "cldit.cli.bench:bench",
}


@click.group(
    cls=Program,
    commands_at=_COMMANDS,
    unlisted_at=_UNLISTED,
    epilog=epilog(),
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__)
def main() -> None:
    """Differential infrared thermography of fuel sprays: simulated, acquired, evaluated."""
