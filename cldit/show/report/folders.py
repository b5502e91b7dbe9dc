"""Figures and pages of folders, from what they contain: a run, a series, evaluated shots."""

from collections.abc import Iterator
from pathlib import Path

from cldit.acquisition.measured import Measured, open_recorded
from cldit.acquisition.record import Acquisition, maps_of_group
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.run import open_run
from cldit.run.series_plan import SERIES_FILE
from cldit.show.figures.maps import map_figure
from cldit.show.figures.panels import ImageFrame
from cldit.show.figures.style import write_figure
from cldit.show.report.evaluation import write_evaluation_page
from cldit.show.report.run_report import write_figures
from cldit.show.report.series_report import FILM_FILE


def write_pages(folder: str | Path) -> tuple[Path, ...]:
    """Writes a page beside the maps of an acquisition or of measured data, one for each filter and
    delay.

    folder: evaluated acquisition, folder with measured.yaml, or such a file itself. Returns the
    pages' paths.
    """
    recorded = open_recorded(folder)
    frame = ImageFrame(pixel_m=recorded.pixel_m, centre_m=recorded.centre_m)
    return tuple(
        write_evaluation_page(
            place, frame, title=f"{recorded.folder.resolve().name}: acquired{when}"
        )
        for place, when in _evaluated(recorded)
    )


def _evaluated(recorded: Acquisition | Measured) -> Iterator[tuple[Path, str]]:
    """Folders of maps, and ` at 0.95 ms` for each of several filters and delays."""
    if not isinstance(recorded, Acquisition) or len(recorded.plan.groups) < 2:
        yield recorded.folder / "maps", ""
        return
    for group in recorded.plan.groups:
        place = maps_of_group(recorded.folder, recorded.plan, group)
        if place.is_dir():
            yield place, f" at {', '.join(recorded.plan.words(group))}"


def show_folder(folder: str | Path, *, suffix: str = ".png") -> Path:
    """Draws the maps of a run, an acquisition or measured data; returns the first figure's path.

    For a series, returns the film that the series itself made. suffix: .png, .pdf or .svg.
    """
    place = Path(folder)
    if (place / SERIES_FILE).is_file():
        film = place / FILM_FILE
        if not film.is_file():
            raise RunFolderError(
                f"{place}: the series has no film; `cldit run {place / SERIES_FILE} --times .. "
                f"--out {place}` completes it"
            )
        return film
    if (place / "scene.yaml").is_file():
        write_figures(open_run(place), suffix=suffix)
        return place / "pictures" / f"maps{suffix}"
    recorded = open_recorded(place)
    if not (recorded.folder / "maps").is_dir():
        raise RunFolderError(
            f"{recorded.folder}: is not evaluated yet; run `cldit evaluate {recorded.folder}` first"
        )
    frame = ImageFrame(pixel_m=recorded.pixel_m, centre_m=recorded.centre_m)
    drawn: list[Path] = []
    for maps, when in _evaluated(recorded):
        title = f"{recorded.folder.resolve().name}: acquired{when}"
        # one delay: beside the folder of its maps, as before there were several
        path = (maps if when else recorded.folder) / f"maps{suffix}"
        drawn.append(write_figure(map_figure(Maps.load(maps), frame, title=title), path))
    return drawn[0]
