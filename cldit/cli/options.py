"""Arguments and options of several commands: numbers with units, scenes, devices, CFD cases."""

import re
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import click
from click.shell_completion import CompletionItem

from cldit.errors import SceneError
from cldit.io.terminal import warn
from cldit.scene.spray import Check

if TYPE_CHECKING:
    _Float = click.ParamType[float]
    _Text = click.ParamType[str]
    _Pair = click.ParamType[tuple[float, float | None]]
else:
    _Float = _Text = _Pair = click.ParamType  # generic from click 8.5 on

Command = TypeVar("Command", bound=Callable[..., Any])


class Quantity(_Float):
    """A number with or without its unit: `0.1`, `0.1K`, `"0.1 K"`."""

    def __init__(self, unit: str) -> None:
        self.name = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number in `value`; `param` and `ctx` are click's."""
        try:
            return float(str(value).strip().removesuffix(self.name))
        except ValueError:
            self.fail(f"{value!r} is not a number of {self.name}; allowed: e.g. 0.1{self.name}")


class Tolerances(_Pair):
    """Tolerances of T_app and, after a comma, of emissivity: `1K`, `1K,0.01`."""

    name = "K[,emissivity]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float | None]:
        """Both numbers in `value`, None for an absent second one; `param`, `ctx` are click's."""
        kelvin, comma, emissivity = str(value).partition(",")
        try:
            return KELVIN.convert(kelvin, param, ctx), float(emissivity) if comma else None
        except ValueError:
            self.fail(f"{value!r} is no tolerance; allowed: e.g. 1K, or 1K,0.01 with emissivity")


class SceneName(_Text):
    """A shipped name or the path of a YAML file, which `load_scene` checks."""

    name = "scene"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Shipped names that begin with `incomplete`, else the shell's files."""
        files = resources.files("cldit.scene.library").iterdir()
        names = sorted(
            file.name.removesuffix(".yaml") for file in files if file.name[-5:] == ".yaml"
        )
        items = [CompletionItem(name) for name in names if name.startswith(incomplete)]
        return items or [CompletionItem(incomplete, type="file")]


KELVIN = Quantity("K")
PATH = click.Path(path_type=Path)
SCENE = SceneName()
device_option = click.option(
    "--device", help="OpenCL device: platform:device, or part of its name."
)
verbose_option = click.option(
    "-v", "--verbose", is_flag=True, help="Print stages, figures of the spray and error sources."
)
figures_option = click.option(
    "--format",
    "suffix",
    type=click.Choice(["png", "pdf", "svg"]),
    callback=lambda _, __, kind: kind and f".{kind}",
    help="Of figures: png of 300 dpi (default), or vectors.",
)
within_option = click.option(
    "--within",
    "within_K",
    type=KELVIN,
    help="RMS allowed in T_app, K; default: explained by both stated errors.",
)
_CASE = (
    click.option(
        "--cfd-format",
        "format",
        help="openfoam, vtk, ensight, converge, fluent, cgns, amrex, tables; default: by content.",
    ),
    click.option("--mapping", type=PATH, help="YAML file of names and units of fields."),
    click.option(
        "--time", "time_s", help="A time of the case, or `nearest 0.001`; default: the last."
    ),
    click.option("--region", help="Mesh region of an OpenFOAM case with several."),
    click.option("--cloud", help="Cloud of parcels if there are several; `none`: gas only."),
    click.option("--fuel-field", help="Cell field of the fuel's mass fraction; default: C7H16."),
    click.option(
        "--nozzle", "nozzle_m", type=(float, float, float), help="In the case's coordinates, m."
    ),
    click.option(
        "--accept",
        multiple=True,
        metavar="CHECK",
        callback=lambda _, __, names: names or None,
        help=f"Read the case whatever this check finds: {', '.join(get_args(Check))}; repeatable.",
    ),
    click.option("--sector", type=float, help="Angle of the mesh in degrees; 360: whole."),
    click.option(
        "--symmetry",
        callback=lambda _, __, normals: (
            normals and ([] if normals == "none" else normals.split(","))
        ),
        help="Normals of mirror planes, as x or x,y; `none`: whole.",
    ),
    click.option("--axis", help="Direction of injection: -y, +z, or three numbers as 0,-1,0."),
)


def case_options(command: Command) -> Command:
    """Adds options for a CFD case to a command, which takes them as keywords for `spray_keys`."""
    for option in reversed(_CASE):
        command = option(command)
    return command


def hide_case_options(command: click.Command) -> None:
    """Takes the options of `cldit import` out of the help of a command, which still has them."""
    shared = {option.name for option in click.command()(case_options(lambda **_: None)).params}
    for option in command.params:
        if isinstance(option, click.Option) and option.name in shared:
            option.hidden = True


def replaced_by(successor: str) -> Callable[[click.Context, click.Parameter, Any], Any]:
    """Callback of an old option, hidden: prints what replaces it if it is given."""

    def callback(_: click.Context, option: click.Parameter, value: Any) -> Any:
        if value:
            warn(f"{option.opts[0]} is deprecated; use {successor}")
        return value

    return callback


def spray_keys(options: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of the `spray` section of a scene, from the options that were given."""
    keys = {name: value for name, value in options.items() if value is not None}
    if "sector" in keys:
        keys["sector"] = {"angle_deg": keys["sector"]}
    if "," in (axis := keys.get("axis", "")):
        try:
            keys["axis"] = [float(part) for part in axis.split(",")]
        except ValueError as error:
            where = "--axis"
            raise click.BadParameter(f"{axis!r} is not a direction", param_hint=where) from error
    return keys


def two_numbers(option: str, value: str, pattern: str) -> tuple[str, str]:
    """The numbers in `N`, for both, or `NxM`."""
    match = re.fullmatch(rf"({pattern})(?:x({pattern}))?", value.strip())
    if match is None:
        raise SceneError(f"{option} {value}: allowed: one number for both sides, or two as 3x4")
    return match[1], match[2] or match[1]


def pixels_of(value: str) -> int | list[int]:
    """Columns and rows of `--pixels`, or pixels along the longer side of the field."""
    columns, rows = (int(count) for count in two_numbers("--pixels", value, r"[0-9]+"))
    return [columns, rows] if "x" in value else columns
