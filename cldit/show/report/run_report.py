"""Figures and report of a run folder."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawn

from cldit.accuracy.errors import Cause
from cldit.acquisition.plan import Group
from cldit.acquisition.record import maps_folder, open_acquisition
from cldit.arrays import Floats
from cldit.dit.delay_table import DelayRow
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.io.files import make_folder, write_bytes
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.run import Run
from cldit.scene.delays import delay_text, spray_time_s
from cldit.show.figures.curves import nodes_figure
from cldit.show.figures.maps import (
    camera_figures,
    error_maps_panels,
    errors_panels,
    frame_of,
    injections_panels,
    map_figure,
    shares_of_light,
    spray_figure,
    spray_window,
    weights_panels,
)
from cldit.show.figures.panels import GREY, ImageFrame, Panel, panels_figure
from cldit.show.figures.readable import human_figures
from cldit.show.figures.style import SCREEN_DPI, figure_bytes
from cldit.show.page import (
    Bar,
    Block,
    Cell,
    Code,
    Figure,
    Page,
    Section,
    Slider,
    Table,
    write_page,
)
from cldit.show.report.evaluation import evaluation_sections, pixels_section

_ERRORS = ("injections", "simulation_errors", "emissivity_errors", "errors")
_FURTHER = ("maps_noise_free", "weights", "wavelengths")


def _folder(run: Run) -> Path:
    if run.folder is None:
        raise RunFolderError("the run is not stored; give `out` to simulate")
    return run.folder


def _verdict(maps: Maps, run: Run) -> str:
    """Range of T_app, and the error of the simulation if it is known."""
    visible = maps.has_temperature
    if not visible.any():
        return "No pixel has an apparent temperature and an emissivity above 0.05."
    low, high = np.percentile(maps.apparent_temperature_K[visible], (1, 99))
    error = "" if run.errors is None else f" Error of the simulated T_app: {run.errors.text}."
    return (
        f"{low:.0f} to {high:.0f} K in {np.count_nonzero(visible)} of {maps.reason.size} pixels, "
        f"those with an emissivity above 0.05.{error}"
    )


def _figures(run: Run) -> Iterator[tuple[str, Drawn, str]]:
    """Names, figures and captions of a stored run; the first one is the main figure."""
    traced, sensor = frame_of(run.scene), frame_of(run.scene, sensor=True)
    name, delays = run.scene.name, run.scene.plan.delays_s

    def drawn(
        panels: Sequence[Panel], title: str, frame: ImageFrame = traced, missing: str = ""
    ) -> Drawn:
        legend = [(GREY, missing)] if missing else []
        window = spray_window(run.maps, traced)
        return panels_figure(panels, frame, title=f"{name}: {title}", window=window, legend=legend)

    if run.measured is not None:
        figure = map_figure(run.measured, sensor, title=f"{name}: acquired")
        yield "maps", figure, f"Acquired by the rig. {_verdict(run.measured, run)}"
        caption = "Standard errors of the acquired maps, scatter from shot to shot included."
        yield "errors", drawn(errors_panels(run.measured), "standard errors", sensor), caption
    for number, delay_s in enumerate(delays if len(delays) > 1 else ()):
        place = maps_folder(_folder(run) / "acquisition", delays, number)
        if place.is_dir():
            maps, title = Maps.load(place), f"{name}: acquired at {delay_text(delay_s)}"
            caption = f"{DelayRow.of(delay_s, maps).text}."
            yield f"maps_{place.name}", map_figure(maps, sensor, title=title), caption
    figure = map_figure(run.maps, traced, title=f"{name}: traced, without noise")
    key = "maps" if run.measured is None else "maps_noise_free"
    yield key, figure, f"From the traced radiances. {_verdict(run.maps, run)}"
    caption = "Origin of the light of every pixel; one trace serves every background."
    yield "weights", drawn(weights_panels(run.weights), "weights of the trace"), caption
    caption = "Standard error of the simulation itself; {} has a map of every cause."
    if run.error_maps:
        title, panels = "error of simulated T_app", error_maps_panels(run.error_maps)
        missing = "no apparent temperature, or emissivity below 0.05"
        shown = drawn(panels, title, missing=missing)
        yield "simulation_errors", shown, caption.format("errors/")
    if run.emissivity_error_maps:
        panels = error_maps_panels(run.emissivity_error_maps, unit="")
        shown = drawn(panels, "error of simulated emissivity")
        yield "emissivity_errors", shown, caption.format("errors/emissivity/")
    if run.ensemble is not None:
        panels, title = injections_panels(run.ensemble), f"{run.ensemble.members} injections"
        caption = f"Differences between injections; {run.ensemble.text(run.maps)}."
        yield "injections", drawn(panels, title), caption
    if run.info.spectral is not None and run.info.spectral.errors_K:
        chosen, title = len(run.info.spectral.nodes), f"{name}: error against number of wavelengths"
        yield (
            "wavelengths",
            nodes_figure(run.info.spectral.errors_K, chosen=chosen, title=title),
            "Estimated error in T_app: lines of sight through this spray, against a fine spectrum.",
        )


def write_figures(run: Run, *, suffix: str = ".png") -> dict[str, Figure]:
    """Writes the figures of a stored run into its folder `pictures`, as .png, .pdf or .svg.

    Returns them by name as PNG, none for another suffix.
    """
    folder = _folder(run) / "pictures"
    make_folder(folder)
    figures: dict[str, Figure] = {}
    for name, drawn, caption in _figures(run):
        data = figure_bytes(drawn, suffix)
        write_bytes(folder / f"{name}{suffix}", data)
        if suffix == ".png":
            figures[name] = Figure(data, caption)
    return figures


def _camera(run: Run) -> Slider:
    """Mean of the injection shots at every background, all in one scale."""
    if run.measured is None:
        return Slider("Background", {})
    acquisition = open_acquisition(_folder(run) / "acquisition")
    if len(acquisition.plan.delays) > 1 and spray_time_s(run.scene) is not None:
        delay = _delay_number(run, acquisition.plan.delays)
        acquisition = acquisition.of_group(Group(delay=delay))
    frame = ImageFrame(pixel_m=acquisition.pixel_m, centre_m=acquisition.centre_m)
    sums: dict[float, tuple[Floats, int]] = {}
    for shot in acquisition.shots:
        if shot.kind == "injection":
            total, count = sums.get(shot.background_setpoint_K, (np.zeros(acquisition.shape), 0))
            sums[shot.background_setpoint_K] = (total + acquisition.load(shot), count + 1)
    means = {at: (total / count).astype(np.float32) for at, (total, count) in sorted(sums.items())}
    figures = {
        f"{at:g} K": Figure.of(drawn, f"Mean of {sums[at][1]} injections.", dpi=SCREEN_DPI)
        for at, drawn in camera_figures(means, frame, title=run.scene.name).items()
    }
    return Slider("Background", figures)


def _delay_number(run: Run, delays: Sequence[float]) -> int:
    """Index of the delay whose spray the run itself shows; 0 without a time."""
    time_s = spray_time_s(run.scene)
    if time_s is None or not delays:
        return 0
    return min(range(len(delays)), key=lambda at: abs(delays[at] - time_s))


def _evaluation(run: Run) -> list[Section]:
    if run.measured is None:
        return []
    delays = run.scene.plan.delays_s
    return evaluation_sections(
        maps_folder(_folder(run) / "acquisition", delays, _delay_number(run, delays)),
        frame_of(run.scene, sensor=True),
        title=run.scene.name,
    )


def _origin(run: Run) -> list[Block]:
    """Shares of the signal by origin, in front of the middle background."""
    in_filter = Boundary.in_filter(
        Surroundings.from_scene(run.scene),
        run.quadrature.filter_um,
        reference_K=run.quadrature.reference_K,
    )
    panels, means = shares_of_light(
        run.weights,
        run.reference,
        background=float(in_filter.leaving(run.quadrature.reference_K)),
        wall=in_filter.wall,
        patches=in_filter.patches,
    )
    middle_K = float(np.median(run.scene.background.temperatures_K))
    title, frame = f"{run.scene.name}: origin of the signal", frame_of(run.scene)
    caption = f"Shares of the radiance in front of a background of {middle_K:g} K."
    drawn = spray_figure(panels, run.maps, frame, title=title) if panels else None
    rows: list[list[Cell]] = [
        [name, f"{100 * share:.1f} %", Bar(share)] for name, share in means.items()
    ]
    return [
        "" if drawn is None else Figure.of(drawn, caption),
        "Mean over the pixels where the spray is:" if means else "",
        Table((), rows, numbers=(1,)),
    ]


def _spectral(run: Run) -> dict[str, str]:
    """Wavelengths, their error, and the difference to the paper's optical properties."""
    info = run.info.spectral
    if info is None or not info.errors_K:
        return {}
    shares = ", ".join(f"{um:.3f} um ({100 * share:.0f} %)" for um, share in info.nodes)
    rows = {
        "wavelengths": f"{len(info.nodes)}: {shares} of the light at {info.reference_K:g} K",
        "estimated error of the wavelengths in T_app": f"{info.error_K:.2g} K RMS",
    }
    if info.from_paper is not None:
        d = info.from_paper
        rows["T_app against the paper's optical properties"] = (
            f"{d.mean_K:+.3g} K on average, {d.rms_K:.3g} K RMS over {d.pixels} pixels"
        )
        rows["emissivity against the paper's optical properties"] = (
            f"{d.mean_emissivity:+.3g} on average"
        )
    return rows


def _spray(run: Run) -> dict[str, str]:
    remarks = {f"remark {n}": remark for n, remark in enumerate(run.info.remarks, start=1)}
    return human_figures(run.info.spray) | remarks


def _trace(run: Run) -> dict[str, str]:
    rows = {name.replace("_", " "): str(value) for name, value in run.info.counts.items()}
    rows["lens"] = run.scene.camera.seen_through
    rows["integration time"] = f"{run.info.integration_time_s * 1e6:.4g} µs"
    rows |= _spectral(run)
    rows["phase function"] = run.info.phase
    rows["precision"] = run.info.precision
    if run.info.closure is not None:
        balance = run.info.closure
        rows["energy balance: weights and isothermal emission, less 1"] = (
            f"{balance.largest:+.2g} at most, {balance.mean:+.2g} on average; allowed for the "
            f"{balance.value}: {balance.bound:.2g}"
        )
    if run.errors is not None:
        rows["error of T_app, RMS over the pixels that have one"] = run.errors.text
        rows["error of emissivity, RMS over as many pixels"] = run.errors.emissivity_text
        for cause in run.errors.causes:
            rows[f"error of T_app and emissivity by {cause.name}"] = _cause(cause)
        for cause in run.errors.model:
            rows[f"model, not in the sum: {cause.name}"] = _cause(cause)
    if run.info.plan is not None:
        emissivity = run.info.plan.get("wanted_emissivity")
        also = "" if emissivity is None else f", emissivity {emissivity:.2g}"
        rows["requested accuracy"] = f"{run.scene.transport.accuracy_K:g} K{also}"
    if run.info.accuracy_K is not None:
        rows["estimated error of the trace in T_app"] = f"{run.info.accuracy_K:.2g} K RMS"
    for file, defines in run.info.defines.items():
        rows[f"{file} compiled with"] = " ".join(f"{k}={v}" for k, v in sorted(defines.items()))
    return rows


def _cause(cause: Cause) -> str:
    fixed = f" (fixed by {cause.fixed})" if cause.fixed else ""
    emissivity = "" if cause.emissivity is None else f", {cause.emissivity_text}"
    return f"{cause.text}{emissivity}: {cause.how}{fixed}"


def _stages(run: Run) -> Table:
    total = sum(stage.seconds for stage in run.info.stages)
    rows: list[list[Cell]] = [
        [stage.name, f"{stage.seconds:.2f} s", Bar(stage.seconds / (total or 1.0)), stage.note]
        for stage in run.info.stages
    ]
    return Table((), [*rows, ["all", f"{total:.2f} s", "", ""]] if rows else [], numbers=(1,))


def _commands(run: Run) -> str:
    """Commands that repeat the run, from its folder."""
    if run.measured is None:
        return (
            "cldit compare . --repeat  # compute it again, print the difference\n"
            "cldit run scene.yaml --trace-only --out again"
        )
    return (
        "cldit compare . --repeat                     # compute it again, print the difference\n"
        "cldit run scene.yaml --out again             # all of it\n"
        "cldit acquire rig.yaml plan.yaml --out shots # only the shots\n"
        "cldit evaluate shots"
    )


def write_run_report(run: Run) -> Path:
    """Writes figures and report.html of a stored run; returns the report's path."""
    folder = _folder(run)
    figures = write_figures(run)
    delays = [figure for name, figure in figures.items() if name.startswith("maps_delay_")]
    errors = [figures[name] for name in _ERRORS if name in figures]
    origin = {} if run.info.origin is None else run.info.origin.text
    computed = {"device": f"{run.info.device}: {run.info.device_reason}"}
    content: list[Block] = [
        run.scene.description,
        Section("Apparent temperature and emissivity", [figures["maps"], *delays]),
        Section("Camera images", [_camera(run)]),
        Section("Origin of the signal", _origin(run)),
        Section("Errors", errors),
        Section(
            "Further figures",
            [figures[name] for name in _FURTHER if name in figures],
            folded=True,
        ),
        *_evaluation(run),
        pixels_section(run.maps if run.measured is None else run.measured),
        _folded("Spray", _spray(run)),
        _folded("Trace", _trace(run)),
        Section("Run times", [_stages(run)], folded=True),
        _folded("Computed with", computed | run.info.versions | origin),
        Section("How to repeat it", ["`scene.yaml` has every key.", Code(_commands(run))]),
    ]
    return write_page(Page(run.scene.name, content), folder / "report.html")


def _folded(title: str, values: Mapping[str, str]) -> Section:
    return Section(title, [Table.pairs(values)], folded=True)
