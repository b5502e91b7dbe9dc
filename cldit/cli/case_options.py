"""Options that say what of a CFD result is meant: keys of the `spray` section of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS = (
    click.option("--format", help="openfoam, vtk, ensight, converge, fluent, cgns or tables."),
    click.option(
        "--mapping", type=click.Path(path_type=Path), help="Names and units of fields, YAML."
    ),
    click.option("--time", "time_s", help="One of the case's; the last. Or `nearest 0.001`."),
    click.option("--region", help="Mesh region of an OpenFOAM case, where there are several."),
    click.option("--cloud", help="Cloud of parcels, where there are several; none: gas alone."),
    click.option("--fuel-field", help="Cell field of the fuel's mass fraction; C7H16."),
    click.option(
        "--fuel-molar-mass", "fuel_molar_mass_kg_mol", type=float, help="kg/mol; 0.100204."
    ),
    click.option(
        "--nozzle", "nozzle_m", type=(float, float, float), help="In the case's coordinates, m."
    ),
    click.option("--sector", type=float, help="The mesh is so many degrees of a turn; 360: whole."),
    click.option("--symmetry", help="Normals of planes to mirror at, as x or x,y; none: whole."),
    click.option("--axis", help="Of the injection: -y, +z, or three numbers as 0,-1,0."),
)


def case_options(command: Command) -> Command:
    """Adds the options to a command, which takes them as keywords for `spray_keys`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def spray_keys(options: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of the `spray` section that were given, as a scene file has them.

    Raises:
        click.BadParameter: `--axis` is no direction.
    """
    keys = {name: value for name, value in options.items() if value is not None}
    if "axis" in keys:
        keys["axis"] = _axis(keys["axis"])
    if "sector" in keys:
        keys["sector"] = {"angle_deg": keys["sector"]}
    if "symmetry" in keys:
        keys["symmetry"] = [] if keys["symmetry"] == "none" else keys["symmetry"].split(",")
    return keys


def _axis(text: str) -> str | list[float]:
    """`-y` as it is, `0,-1,0` as numbers."""
    if "," not in text:
        return text
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is no direction", param_hint="--axis") from error
