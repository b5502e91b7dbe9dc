"""The pictures and the report of a run folder, and the map picture of an acquisition folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.errors import Cause
from cldit.acquisition.measured import is_measured, open_measured
from cldit.acquisition.record import Acquisition, maps_folder, open_acquisition
from cldit.camera.view import SensorView
from cldit.dit.delay_table import DelayRow
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.io.files import make_folder, write_bytes
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.run import Run, open_run
from cldit.run.series_plan import SERIES_FILE
from cldit.scene import dump_scene
from cldit.scene.delays import delay_text, spray_time_s
from cldit.show.figures.figures import human_figures
from cldit.show.figures.panels import Frame
from cldit.show.figures.pictures import (
    camera_pictures,
    error_maps_picture,
    errors_picture,
    map_picture,
    nodes_picture,
    weights_picture,
)
from cldit.show.figures.shares import Shares
from cldit.show.report.evaluation import evaluation_content, write_evaluation_page
from cldit.show.report.html import EvaluationContent, Picture, ReportContent, write_report
from cldit.show.report.series_report import FILM_FILE


def _folder(run: Run) -> Path:
    if run.folder is None:
        raise RunFolderError("the run is not stored; give `out` to simulate")
    return run.folder


def _frame(run: Run, pixel_m: tuple[float, float]) -> Frame:
    x, _, z = run.scene.target_m
    return Frame(pixel_m=pixel_m, centre_m=(x, z))


def _title(run: Run, what: str) -> str:
    return f"{run.scene.name}: {what}"


def write_pictures(run: Run) -> dict[str, Picture]:
    """Writes the PNG pictures of a stored run into its folder `pictures` and returns them."""
    traced = _frame(run, run.pixel_m)
    sensor = _frame(run, SensorView.from_scene(run.scene).pixel_m)
    pictures: dict[str, Picture] = {}
    if run.measured is not None:
        pictures["maps"] = Picture(
            map_picture(run.measured, sensor, title=_title(run, "DIT of the acquired shots")),
            "What the rig acquired: hue is the apparent temperature, saturation the emissivity.",
        )
        pictures["errors"] = Picture(
            errors_picture(run.measured, sensor, title=_title(run, "standard errors")),
            "Standard errors of the acquired maps, scatter from shot to shot included.",
        )
    for number, delay_s in enumerate(run.scene.plan.delays_s):
        place = maps_folder(_folder(run) / "acquisition", run.scene.plan.delays_s, number)
        if len(run.scene.plan.delays_s) > 1 and place.is_dir():
            maps = Maps.load(place)
            pictures[f"maps_{place.name}"] = Picture(
                map_picture(
                    maps, sensor, title=_title(run, f"DIT of the shots at {delay_text(delay_s)}")
                ),
                f"{DelayRow.of(delay_s, maps).text}.",
            )
    pictures["maps_noise_free"] = Picture(
        map_picture(run.maps, traced, title=_title(run, "DIT of the trace, without noise")),
        "The same from the traced radiances themselves, on the traced field.",
    )
    pictures["weights"] = Picture(
        weights_picture(run.weights, traced, title=_title(run, "weights of the trace")),
        "Where the light of every pixel comes from; one trace serves every background.",
    )
    if run.error_maps:
        pictures["simulation_errors"] = Picture(
            error_maps_picture(
                run.error_maps, traced, title=_title(run, "standard error of the simulated T_app")
            ),
            "What the simulation itself errs by; errors/ holds a map of every cause.",
        )
    if run.info.spectral is not None and run.info.spectral.errors_K:
        pictures["wavelengths"] = Picture(
            nodes_picture(
                run.info.spectral.errors_K,
                chosen=len(run.info.spectral.nodes),
                title=_title(run, "error against number of wavelengths"),
            ),
            "Estimated error in T_app: lines of sight through this spray, against a fine spectrum.",
        )
    folder = _folder(run) / "pictures"
    make_folder(folder)
    if "maps" not in pictures:
        pictures["maps"] = pictures["maps_noise_free"]
    for name, picture in pictures.items():
        write_bytes(folder / f"{name}.png", picture.png)
    return pictures


def _camera(run: Run, acquisition: Acquisition) -> tuple[tuple[float, Picture], ...]:
    """Mean of the injection shots at every background, all in one scale."""
    frame = Frame(pixel_m=acquisition.pixel_m, centre_m=acquisition.centre_m)
    sums: dict[float, tuple[NDArray[np.float64], int]] = {}
    for shot in acquisition.shots:
        if shot.kind == "injection":
            total, count = sums.get(shot.background_setpoint_K, (np.zeros(acquisition.shape), 0))
            sums[shot.background_setpoint_K] = (total + acquisition.load(shot), count + 1)
    means = {at: (total / count).astype(np.float32) for at, (total, count) in sorted(sums.items())}
    drawn = camera_pictures(means, frame, title=run.scene.name)
    return tuple(
        (at, Picture(png, f"Mean of {sums[at][1]} injections.")) for at, png in drawn.items()
    )


def _of_run(run: Run, acquisition: Acquisition) -> Acquisition:
    """The shots of the time that the run itself shows."""
    time_s = spray_time_s(run.scene)
    delays = acquisition.plan.delays
    if time_s is None or len(delays) == 1:
        return acquisition
    return acquisition.at_delay(min(range(len(delays)), key=lambda at: abs(delays[at] - time_s)))


def _evaluation(run: Run) -> EvaluationContent:
    """Of the shots of the time that the run itself shows."""
    if run.measured is None:
        return EvaluationContent()
    delays, time_s = run.scene.plan.delays_s, spray_time_s(run.scene)
    number = 0
    if time_s is not None and delays:
        number = min(range(len(delays)), key=lambda at: abs(delays[at] - time_s))
    return evaluation_content(
        maps_folder(_folder(run) / "acquisition", delays, number),
        _frame(run, SensorView.from_scene(run.scene).pixel_m),
        title=run.scene.name,
    )


def _shares(run: Run) -> Shares:
    """Shares before the middle background."""
    whole = Boundary.in_filter(
        Surroundings.from_scene(run.scene),
        run.quadrature.filter_um,
        reference_K=run.quadrature.reference_K,
    )
    leaves = float(whole.leaving(run.quadrature.reference_K))
    return Shares.of(
        run.weights, run.reference, background=leaves, wall=whole.wall, patches=whole.patches
    )


def _spectral(run: Run) -> dict[str, str]:
    """The nodes, their error, and what the paper's properties would have given."""
    info = run.info.spectral
    if info is None or not info.errors_K:
        return {}
    shares = ", ".join(f"{um:.3f} um ({100 * share:.0f} %)" for um, share in info.nodes)
    figures = {
        "wavelengths": f"{len(info.nodes)}: {shares} of the light at {info.reference_K:g} K",
        "estimated error of the wavelengths in T_app": f"{info.error_K:.2g} K RMS",
    }
    if info.from_paper is not None:
        d = info.from_paper
        figures["T_app against the paper's optical properties"] = (
            f"{d.mean_K:+.3g} K in the mean, {d.rms_K:.3g} K RMS over {d.pixels} pixels"
        )
        figures["emissivity against the paper's optical properties"] = (
            f"{d.mean_emissivity:+.3g} in the mean"
        )
    return figures


def _spray(run: Run) -> dict[str, str]:
    remarks = {f"remark {n}": text for n, text in enumerate(run.info.remarks, start=1)}
    return human_figures(run.info.spray) | remarks


def _trace(run: Run) -> dict[str, str]:
    figures = {name.replace("_", " "): str(value) for name, value in run.info.counts.items()}
    figures["integration time"] = f"{run.info.integration_time_s * 1e6:.4g} µs"
    figures |= _spectral(run)
    figures["phase function"] = run.info.phase
    figures["precision"] = run.info.precision
    if run.info.closure is not None:
        balance = run.info.closure
        figures["energy balance: weights and isothermal emission, less 1"] = (
            f"{balance.largest:+.2g} at most, {balance.mean:+.2g} in the mean; the "
            f"{balance.value} is allowed {balance.bound:.2g}"
        )
    if run.errors is not None:
        figures["error of T_app, RMS over the pixels that have one"] = run.errors.text
        for cause in run.errors.causes:
            figures[f"error of T_app by {cause.name}"] = _cause(cause)
        for cause in run.errors.model:
            figures[f"model, not in the sum: {cause.name}"] = f"{cause.text}: {cause.how}"
    if run.info.plan is not None:
        figures["accuracy asked for"] = f"{run.scene.transport.accuracy_K:g} K"
    if run.info.accuracy_K is not None:
        figures["estimated error of the trace in T_app"] = f"{run.info.accuracy_K:.2g} K RMS"
    for file, defines in run.info.defines.items():
        figures[f"{file} compiled with"] = " ".join(f"{k}={v}" for k, v in sorted(defines.items()))
    return figures


def _cause(cause: Cause) -> str:
    held = f" (held by {cause.fixed})" if cause.fixed else ""
    return f"{cause.text}: {cause.how}{held}"


def _commands(run: Run) -> tuple[str, ...]:
    """What does the run again, from its folder."""
    if run.measured is None:
        return (
            "cldit repeat .  # anew, and what differs",
            "cldit run scene.yaml --trace-only --out again",
        )
    return (
        "cldit repeat .                               # anew, and what differs",
        "cldit run scene.yaml --out again             # all of it",
        "cldit acquire rig.yaml plan.yaml --out shots # the shots alone",
        "cldit evaluate shots",
    )


def write_run_report(run: Run) -> Path:
    """Writes pictures and report.html of a stored run.

    Returns the report's path.

    Raises:
        RunFolderError: the run is not stored, or its acquisition is damaged.
    """
    folder = _folder(run)
    pictures = write_pictures(run)
    shares = _shares(run)
    camera: tuple[tuple[float, Picture], ...] = ()
    shown = [pictures["maps"]]
    if run.measured is not None:
        camera = _camera(run, _of_run(run, open_acquisition(folder / "acquisition")))
        shown.append(pictures["maps_noise_free"])
    shown += [picture for name, picture in pictures.items() if name.startswith("maps_delay_")]
    middle_K = float(np.median(run.scene.background.temperatures_K))
    maps = run.maps if run.measured is None else run.measured
    content = ReportContent(
        name=run.scene.name,
        description=run.scene.description,
        maps=tuple(shown),
        camera=camera,
        shares=shares.means(),
        share_pictures=(
            Picture(
                shares.picture(_frame(run, run.pixel_m), title=_title(run, "origin of the signal")),
                f"Shares of the radiance before a background of {middle_K:g} K.",
            ),
        ),
        more_pictures=tuple(
            pictures[name]
            for name in ("simulation_errors", "errors", "weights", "wavelengths")
            if name in pictures
        ),
        evaluation=_evaluation(run),
        reasons={reason.text: count for reason, count in maps.count().items()},
        figures=_spray(run),
        trace=_trace(run),
        stages=tuple((stage.name, stage.seconds) for stage in run.info.stages),
        notes={stage.name: stage.note for stage in run.info.stages if stage.note},
        device=f"{run.info.device}: {run.info.device_reason}",
        versions=run.info.versions | ({} if run.info.origin is None else run.info.origin.text),
        commands=_commands(run),
        scene_yaml=dump_scene(run.scene),
    )
    path = folder / "report.html"
    write_report(path, content)
    return path


def write_pages(folder: str | Path) -> tuple[Path, ...]:
    """Writes a page beside the maps of an acquisition or of measured data, one for each delay.

    Args:
        folder: of an acquisition, or with measured.yaml, or such a file itself; evaluated.

    Returns:
        The pages' paths.

    Raises:
        RunFolderError: a file is missing or damaged.
    """
    found = open_measured(folder) if is_measured(folder) else open_acquisition(folder)
    frame = Frame(pixel_m=found.pixel_m, centre_m=found.centre_m)
    title = f"{found.folder.resolve().name}: DIT of the shots"
    if isinstance(found, Acquisition) and len(found.plan.delays) > 1:
        delays = found.plan.delays
        return tuple(
            write_evaluation_page(place, frame, title=f"{title} at {delay_text(delay_s)}")
            for number, delay_s in enumerate(delays)
            if (place := maps_folder(found.folder, delays, number)).is_dir()
        )
    return (write_evaluation_page(found.folder / "maps", frame, title=title),)


def show_folder(folder: str | Path) -> Path:
    """Draws the maps of a run, acquisition or measured data; returns the picture's path.

    Of a series it is the film, which the series itself made.

    Raises:
        RunFolderError: the folder holds none of these, or was not evaluated yet.
    """
    place = Path(folder)
    if (place / SERIES_FILE).is_file():
        film = place / FILM_FILE
        if not film.is_file():
            raise RunFolderError(
                f"{place}: the series has no film; `cldit run {place / SERIES_FILE} --times .. "
                f"--out {place}` ends it"
            )
        return film
    if (place / "scene.yaml").is_file():
        write_pictures(open_run(place))
        return place / "pictures" / "maps.png"
    acquisition = open_measured(place) if is_measured(place) else open_acquisition(place)
    place = acquisition.folder
    if not (place / "maps").is_dir():
        raise RunFolderError(f"{place}: is not evaluated yet; run `cldit evaluate {place}` first")
    frame = Frame(pixel_m=acquisition.pixel_m, centre_m=acquisition.centre_m)
    title = f"{place.resolve().name}: DIT of the acquired shots"
    if isinstance(acquisition, Acquisition) and len(acquisition.plan.delays) > 1:
        return _show_delays(acquisition, frame, title)
    path = place / "maps.png"
    write_bytes(path, map_picture(Maps.load(place / "maps"), frame, title=title))
    return path


def _show_delays(acquisition: Acquisition, frame: Frame, title: str) -> Path:
    """A picture a delay, in the folder of its maps; the path of the first."""
    drawn: list[Path] = []
    delays = acquisition.plan.delays
    for number, delay_s in enumerate(delays):
        place = maps_folder(acquisition.folder, delays, number)
        if place.is_dir():
            picture = map_picture(
                Maps.load(place), frame, title=f"{title} at {delay_text(delay_s)}"
            )
            drawn.append(place / "maps.png")
            write_bytes(drawn[-1], picture)
    return drawn[0]
