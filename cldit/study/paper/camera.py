"""Fig. 6: what the camera records, beside the traced picture."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from cldit.camera.sensor import SensorModel
from cldit.camera.view import SensorView
from cldit.radiance.boundary import Boundary, Surroundings, picture
from cldit.run import Run
from cldit.show.figures.panels import Frame
from cldit.show.figures.sheet import figure_of
from cldit.show.report.html import Picture
from cldit.study.lab import Lab
from cldit.study.measures import mean_K, root, visible
from cldit.study.page import Page
from cldit.study.pictures import frame_of, small_png
from cldit.study.verdict import Verdict

_BACKGROUND_K = 443.0
_SCENE = {
    "spray.time_s": 0.3e-3,
    # The paper gives walls of 415 K; the gas is taken 115 K above them, as at 0.6 MPa.
    "spray.ambient": {"pressure_Pa": 0.4e6, "temperature_K": 530.0},
    "walls.temperature_K": 415.0,
    "background.temperatures_K": [413.0, _BACKGROUND_K, 473.0],
    "camera.field_m": [0.08, 0.064],
    "camera.target_m": [0.0, 0.0, -0.025],
    "camera.sensor.pixels": [640, 512],
    "camera.sensor.integration_time_s": 25e-6,
}
_OPAQUE = 0.3
_SIGMAS = 2.0


def _radiance(run: Run) -> NDArray[np.float64]:
    around = Surroundings.from_scene(run.scene)
    bands = [Boundary.of(around, node.radiance, node.pane) for node in run.quadrature.nodes]
    return picture(run.spectral, bands, background_K=_BACKGROUND_K)


def study(lab: Lab) -> Page:
    """One trace, one exposure."""
    pixels = {"camera.pixels": [320, 256] if lab.quick else [1000, 800]}
    run = lab.run(lab.gdi("camera", {**_SCENE, **pixels}))
    sensor = SensorModel.from_scene(run.scene)
    view = SensorView.from_scene(run.scene)
    seen = view.image(_radiance(run))
    raw = sensor.expose(seen, np.random.default_rng(1))
    calibration = sensor.calibration()
    traced = calibration.counts(_radiance(run))
    before = float(
        calibration.counts(np.array([run.quadrature.nodes[0].radiance(_BACKGROUND_K)]))[0]
    )
    noise = float(np.sqrt(calibration.variance_counts2(np.array([before])))[0])
    there = visible(run) & (run.maps.emissivity > _OPAQUE)
    core = float(np.mean(traced[root(run) & there])) if (root(run) & there).any() else np.nan
    rim = float(np.percentile(traced[there], 99.0)) if there.any() else np.nan
    hidden = there & (np.abs(traced - before) < _SIGMAS * noise)
    invisible_K = mean_K(run, hidden)
    return Page(
        name="camera",
        title="What the camera records",
        figure="Fig. 6",
        text=_text(before=before, core=core, rim=rim, invisible_K=invisible_K),
        pictures={
            "images": Picture(
                _picture(raw, traced, Frame(view.pixel_m, view.centre_m), frame_of(run)),
                f"0.4 MPa, 0.3 ms, walls 415 K, background {_BACKGROUND_K:g} K: 640 x 512 pixels, "
                "25 µs, with shot and read noise and bad pixels; and the traced picture.",
            )
        },
        table=[
            {
                "background / counts": before,
                "noise of one exposure / counts": noise,
                "below the nozzle / counts": core,
                "brightest rim / counts": rim,
                "pixels that hide": float(np.count_nonzero(hidden)),
                "their T_app / K": invisible_K,
            }
        ],
        verdicts=(
            Verdict(
                claim="Few photons right below the injector: a cold core "
                "(below the background, in noise of one exposure)",
                value=(before - core) / noise,
                unit="σ",
                low=5.0,
            ),
            Verdict(
                claim="Many at the edges of the plumes: a hot rim (above the background)",
                value=(rim - before) / noise,
                unit="σ",
                low=5.0,
            ),
            Verdict(
                claim="A band between them where spray and background cannot be told apart "
                "(opaque pixels within 2 σ of it)",
                value=float(np.count_nonzero(hidden)),
                unit="pixels",
                low=20.0,
            ),
            Verdict(
                claim="There T_app equals the background's temperature (difference)",
                value=invisible_K - _BACKGROUND_K,
                unit="K",
                low=-5.0,
                high=5.0,
            ),
        ),
    )


def _picture(
    raw: NDArray[np.uint16], traced: NDArray[np.float64], sensor: Frame, ray: Frame
) -> bytes:
    low, high = (float(value) for value in np.percentile(traced, [0.1, 99.9]))
    norm = Normalize(low, high)
    figure = figure_of(11.5, 4.6)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, image, frame, title in (
        (panels[0], raw.astype(float), sensor, "camera, one exposure"),
        (panels[1], traced, ray, "traced"),
    ):
        axes.imshow(
            image,
            extent=frame.extent_mm(image.shape),
            cmap="inferno",
            norm=norm,
            interpolation="nearest",
        )
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("x / mm")
        axes.plot(0.0, 0.0, marker="v", markersize=5, color="white", markeredgecolor="black")
    left, right, bottom, top = sensor.extent_mm(raw.shape)
    panels[0].set_xlim(left, right)
    panels[0].set_ylim(bottom, top)
    panels[0].set_ylabel("z / mm")
    figure.colorbar(ScalarMappable(norm, "inferno"), ax=list(panels), label="counts", extend="both")
    return small_png(figure)


def _text(*, before: float, core: float, rim: float, invisible_K: float) -> str:
    return (
        "Cold fuel before a background of intermediate temperature in hot gas, in counts of the "
        f"camera: the background {before:.0f}, the spray right below the injector {core:.0f}, the "
        f"plumes' edges, where vapour has taken the gas's temperature, up to {rim:.0f}. Between "
        "the first and the last lies a band in which spray and background are alike and the spray "
        "cannot be seen in one picture, though it is opaque. DIT sees it, since it compares "
        f"several backgrounds, and has it at {invisible_K:.1f} K before the background of "
        f"{_BACKGROUND_K:g} K. The gas's temperature is not in the paper and is assumed."
    )
