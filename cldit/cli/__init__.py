"""The command line: a thin layer over the Python API."""

from __future__ import annotations

from importlib import import_module

import click

from cldit import __version__

# Command -> where it is. Loaded when asked for, so that each pays for what it uses alone.
_COMMANDS = {
    "run": "run:run",
    "scenes": "lists:scenes",
    "devices": "lists:devices",
    "optics": "lists:optics",
    "fit-liquid": "liquid:fit_liquid",
    "spray": "sprays:spray_command",
    "import": "sprays:import_command",
    "droplet": "sprays:droplet",
    "plan": "plan:plan_command",
    "acquire": "rig:acquire_command",
    "evaluate": "evaluate:evaluate",
    "export": "rig:export_command",
    "scattering": "scattering:scattering_command",
    "show": "rig:show",
    "study": "study:study",
    "bench": "bench:bench",
}


class _Commands(click.Group):
    """Commands by name, each imported on its first use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        module, _, name = _COMMANDS[cmd_name].partition(":")
        command = getattr(import_module(f"cldit.cli.{module}"), name)
        assert isinstance(command, click.Command)
        return command


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def main() -> None:
    """Differential infrared thermography of fuel sprays: simulated, acquired, evaluated."""
