"""`cldit scenes`, `devices` and `optics`: what there is, and what a scene uses."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from cldit.cli.console import OUT, escaped, plain_errors
from cldit.gpu.device import choose, list_devices
from cldit.report.optics_figures import optics_picture
from cldit.report.optics_summary import scene_optics
from cldit.rig.drivers import describe_drivers
from cldit.run import default_cache
from cldit.scene import load_scene, shipped_scenes


@click.command()
def scenes() -> None:
    """The scenes that are shipped."""
    table = Table("scene", "", box=None)
    for name, description in shipped_scenes().items():
        table.add_row(name, description)
    OUT.print(table)


@click.command()
@click.option("--device", help="Show which device this choice means.")
@plain_errors
def devices(device: str | None) -> None:
    """OpenCL devices: which there are, which is used, and why; and the drivers of instruments."""
    found = list_devices()
    used, reason = choose(found, device)
    table = Table("", "device", "kind", "name", "memory", "float64", "platform", box=None)
    for number, info in enumerate(found):
        table.add_row(
            "*" if number == used else "",
            info.index,
            info.kind,
            info.name,
            f"{info.memory_bytes / 1e9:.1f} GB",
            "yes" if info.float64 else "no",
            info.platform,
        )
    OUT.print(table)
    OUT.print(f"* is used: {reason}")
    drivers = Table("driver", "kind", "instrument", "tested", box=None)
    for name, about in describe_drivers().items():
        missing = about.missing()
        note = f"[yellow]needs cldit\\[rig] ({', '.join(missing)})[/]; " if missing else ""
        drivers.add_row(name, about.kind, about.instrument, note + about.tested)
    OUT.print()
    OUT.print(drivers)


@click.command()
@click.argument("scene")
@click.option("--out", type=click.Path(path_type=Path), help="The picture; SCENE-optics.png.")
@plain_errors
def optics(scene: str, out: Path | None) -> None:
    """What SCENE's liquid, droplets, vapour and camera do to light: printed, and as a picture."""
    chosen = load_scene(scene)
    found = scene_optics(chosen, cache=default_cache())
    table = Table("", "scene", "data", "paper", "", box=None)
    for row in found.rows:
        table.add_row(row.quantity, row.scene, row.data, row.paper, f"[dim]{escaped(row.note)}[/]")
    OUT.print(table)
    for source in found.sources:
        OUT.print(escaped(source), style="dim")
    picture = out or Path(f"{chosen.name}-optics.png")
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_bytes(optics_picture(found))
    OUT.print(str(picture))
