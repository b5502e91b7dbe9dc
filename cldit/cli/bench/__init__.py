"""`cldit bench`: what this computer can do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cldit.bench import ACCURACIES_K, ASKED_K, BUDGET_SCENES, PARTS
from cldit.cli.console import plain_errors
from cldit.cli.lazy import LazyGroup
from cldit.cli.units import KELVIN, device_option

_COMMANDS = {
    "rig": "cldit.cli.bench.rig:bench_rig_command",
    "evaluate": "cldit.cli.bench.evaluate:bench_evaluate_command",
    "optics": "cldit.cli.bench.optics:bench_optics_command",
    "presets": "cldit.cli.bench.presets:bench_presets_command",
    "spray": "cldit.cli.bench.spray:bench_spray_command",
    "droplet": "cldit.cli.bench.droplet:bench_droplet_command",
    "stability": "cldit.cli.bench.stability:bench_stability_command",
}

_OLD_PARTS = {"floor": "roofline", "peers": "mitsuba"}  # names of 0.1.0


@click.group(cls=LazyGroup, commands_at=_COMMANDS, invoke_without_command=True)
@click.option("--scene", default="gdi", show_default=True, help="A shipped name or a YAML file.")
@click.option(
    "--only",
    "parts",
    multiple=True,
    type=click.Choice([*PARTS, *_OLD_PARTS]),
    metavar=f"[{'|'.join(PARTS)}]",
    callback=lambda _, __, parts: tuple(_OLD_PARTS.get(part, part) for part in parts),
    help="One part; may be repeated.",
)
@click.option(
    "--mitsuba",
    "--peers",
    "mitsuba",
    is_flag=True,
    help="Also Mitsuba 3, if it is installed.",
)
@click.option(
    "--every",
    type=click.IntRange(1),
    default=5,
    show_default=True,
    help="The reference, path and branching trace every n-th pixel across and down (odd); 1: all.",
)
@click.option(
    "--samples",
    type=click.IntRange(256),
    default=512,
    show_default=True,
    help="Of the reference, a pixel.",
)
@click.option(
    "--accuracy",
    "accuracies_K",
    type=KELVIN,
    multiple=True,
    default=ACCURACIES_K,
    show_default=True,
    help="K that source is asked for; may be repeated.",
)
@click.option(
    "--pixels",
    type=click.IntRange(16),
    default=100,
    show_default=True,
    help="Of budget, along an edge; there must be references of so many.",
)
@click.option(
    "--asked",
    "asked_K",
    type=KELVIN,
    multiple=True,
    default=ASKED_K,
    show_default=True,
    help="Of budget, K that the picture may err; may be repeated.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Of budget: runs at each accuracy.",
)
@click.option(
    "--budget-scene",
    "budget_scenes",
    type=click.Choice(BUDGET_SCENES),
    multiple=True,
    default=BUDGET_SCENES,
    help="Of budget: a scene with a reference; may be repeated; all.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("bench"),
    show_default=True,
    help="Folder of benchmarks.md and of tables, pictures and JSON.",
)
@device_option
@click.pass_context
@plain_errors
def bench(context: click.Context, /, **options: Any) -> None:
    """Measure this computer: error against run time of all methods, growth of cost, memory, what
    leaving out saves, kernels against their roofline, solvers, several rays a pixel."""
    if context.invoked_subcommand is not None:
        return
    from cldit.cli.bench.transport import Asked, bench_transport  # not for the commands below

    bench_transport(Asked(**options))
