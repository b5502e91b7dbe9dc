"""`cldit bench stability`: stiff and extreme cases of the transport."""

from __future__ import annotations

from pathlib import Path

import click

from cldit.bench.stability import bench_stability, cases, page
from cldit.cli.console import OUT, plain_errors, say
from cldit.errors import TransportError
from cldit.gpu.device import open_device


@click.command("stability")
@click.option("--out", type=click.Path(path_type=Path), help="Markdown file; else printed.")
@click.option("--slow", is_flag=True, help="With 1e7 cells: some 6 GB of memory, minutes.")
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@plain_errors
def bench_stability_command(out: Path | None, slow: bool, device: str | None) -> None:
    """Stiff and extreme cases of the transport, with the error that each reaches."""
    opened = open_device(device)
    outcomes = bench_stability(opened, cases(), slow=slow, say=say)
    command = "cldit bench stability" + (" --slow" if slow else "")
    text = page(outcomes, opened, command=f"{command} --out docs/stability.md")
    if out is None:
        click.echo(text)
    else:
        out.write_text(text, encoding="utf-8")
        OUT.print(str(out))
    missed = [outcome.case.name for outcome in outcomes if not outcome.holds]
    if missed:
        raise TransportError(f"the bound is missed in {len(missed)} cases: {'; '.join(missed)}")
