"""`cldit study`: the paper's studies, and sweeps over a scene's keys."""

import time
from pathlib import Path

import click

from cldit.acquisition.progress import Progress
from cldit.cli.console import OUT, ProgressBar, escaped, plain_errors, print_table, say
from cldit.cli.options import PATH, device_option, figures_option, replaced_by
from cldit.cli.results import print_files
from cldit.errors import StudyError
from cldit.run import RunCache, default_cache
from cldit.run.trusted import open_device
from cldit.scene import load_scene
from cldit.study.lab import Lab, reduced
from cldit.study.page import AGREES, DISAGREES, StudyPage, write_overview, write_page
from cldit.study.paper import STUDIES, run_study, studies_of
from cldit.study.sweep import Progress as Swept
from cldit.study.sweep import run_sweep


@click.command()
@click.argument("name", required=False)
@click.option("--quick", is_flag=True, help="Reduced pixels and accuracy.")
@click.option("--out", type=PATH, help="Default: studies, or sweeps/SCENE.")
@click.option("--markdown", is_flag=True, hidden=True)  # for docs/studies
@click.option("--grid", "grid_text", help="KEY=VALUES,...: a sweep over the scene NAME.")
@click.option("--scheduler", help="Address of a dask scheduler; default: this machine.")
@click.option("--workers", type=click.IntRange(1, 1024), help="Processes; default: one a core.")
@click.option("--cache", type=PATH, hidden=True, callback=replaced_by("XDG_CACHE_HOME"))
@figures_option
@device_option
@plain_errors
def study(
    name: str | None,
    quick: bool,
    out: Path | None,
    markdown: bool,
    grid_text: str | None,
    scheduler: str | None,
    workers: int | None,
    cache: Path | None,
    suffix: str | None,
    device: str | None,
) -> None:
    """Run the paper's study NAME, or all; or a sweep over the scene NAME (gdi) with --grid.

    \b
    By name, or by figure (fig12):
      methane           fig2          order             fig9
      optics            fig3, fig4    walls             fig10
      visible           fig5          sizes             fig11
      camera            fig6          index             fig12
      conditions        fig7, fig8    vapour            fig13
      evaporation       fig14         models            fig14
      fuel-temperature  fig15

    --grid "walls.temperature_K=300:600:25,fuel.temperature_K=330,350,370": all combinations;
    start:stop:step includes the stop.
    """
    if grid_text is not None:
        if device is not None:
            raise StudyError("--device: a sweep assigns the devices itself; omit it")
        _sweep(name or "gdi", grid_text, quick, out, scheduler, workers, cache)
        return
    if scheduler is not None or workers is not None:
        raise StudyError("--scheduler and --workers are for sweeps; give --grid too")
    names = studies_of(name or "")
    folder = out or Path("studies")
    lab = Lab(RunCache(cache or default_cache()), quick, open_device(device), say)
    pages: list[StudyPage] = []
    start = time.perf_counter()
    for number, study_name in enumerate(names, start=1):
        since = f", {(time.perf_counter() - start) / 60:.0f} min so far" if number > 1 else ""
        OUT.print(f"study {study_name} ({number} of {len(names)}{since})")
        began = time.perf_counter()
        page = run_study(study_name, lab)
        pages.append(page)
        path = write_page(page, folder, markdown_only=markdown, suffix=suffix)
        OUT.print(f"{path}: {page.summary} ({time.perf_counter() - began:.0f} s)")
    overview = write_overview(folder, list(STUDIES), markdown_only=markdown)
    _print_verdicts(pages)
    print_files(overview)


def _print_verdicts(pages: list[StudyPage]) -> None:
    colours = {AGREES: "green", DISAGREES: "red"}
    rows = [
        (
            page.name,
            escaped(verdict.claim),
            verdict.found,
            verdict.allowed,
            f"[{colours.get(verdict.word, 'yellow')}]{verdict.word}[/]",
        )
        for page in pages
        for verdict in page.verdicts
    ]
    print_table("study", "the paper", "found", "agrees if", "", rows=rows)


def _sweep(
    name: str,
    grid_text: str,
    quick: bool,
    out: Path | None,
    scheduler: str | None,
    workers: int | None,
    cache: Path | None,
) -> None:
    base = load_scene(name)
    if quick:
        base = reduced(base)
    start = time.perf_counter()
    with ProgressBar() as bar:

        def watch(progress: Swept) -> None:
            bar.watch(Progress("scenes", progress.done, progress.total, progress.remaining_s))

        record = run_sweep(
            base,
            grid_text,
            out,
            scheduler=scheduler,
            workers=workers,
            cache=cache,
            watch=watch,
        )
    seconds = time.perf_counter() - start
    OUT.print(
        f"{record.folder}: {record.scenes} scenes, {record.stored} of them computed before, "
        f"{record.traces} traces in {seconds:.1f} s"
    )
    OUT.print(f'next: cldit.open_study("{record.folder}") opens them as one data set')
    if record.failed:
        lines = "\n".join(f"scene {number}: {reason}" for number, reason in record.failed[:10])
        raise StudyError(f"{len(record.failed)} scenes failed:\n{lines}")
