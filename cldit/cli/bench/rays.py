"""`cldit bench rays`: one or several rays a pixel."""

from __future__ import annotations

import click

from cldit.bench.case import changed
from cldit.bench.rays import bench_rays, table
from cldit.cli.console import plain_errors, say
from cldit.gpu.device import open_device
from cldit.scene import load_scene


@click.command("rays")
@click.argument("scene", default="gdi")
@click.option("--order", type=click.IntRange(0, 1000), help="Fewer scatterings, as steep, cheaper.")
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@plain_errors
def bench_rays_command(scene: str, order: int | None, device: str | None) -> None:
    """Error and cost of 1, 4, 16 and adaptive rays a pixel on SCENE, against 64."""
    chosen = changed(load_scene(scene), transport={"order": order})
    click.echo(table(bench_rays(chosen, open_device(device), say=say)).markdown())
