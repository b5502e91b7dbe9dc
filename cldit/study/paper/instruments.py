"""Studies without maps of T_app: optics, visible light, the camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import spearmanr

from cldit.arrays import Floats
from cldit.camera.sensor import SensorModel
from cldit.camera.view import SensorView
from cldit.optics.droplets import droplet_table
from cldit.optics.liquid import liquid
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance
from cldit.run import Run
from cldit.scene import Scene
from cldit.show.figures.colours import COUNTS, NEGATIVE
from cldit.show.figures.maps import frame_of
from cldit.show.figures.optics_figures import optics_figure
from cldit.show.figures.panels import ImageFrame, Panel, joined, panels_figure, window_around
from cldit.show.report.optics_summary import FIG4, PAPER, scene_optics
from cldit.spray.result import Spray
from cldit.spray.sizes import mean_diameter_m
from cldit.study.lab import Lab, ambient, in_gas
from cldit.study.measures import mean_K, named, root, spray_of, visible
from cldit.study.page import SURE, Row
from cldit.study.paper.results import Results

_LARGE_M = 0.49e-3  # shortly before the end of the tables of droplets


def optics(lab: Lab) -> Results:
    """Tables only: nothing is traced."""
    scene = lab.shipped("gdi")
    lab.used["gdi"] = scene
    data = scene_optics(scene, cache=lab.runs.cache)
    at_um = PAPER.wavelength_um
    n, k = (float(value[0]) for value in liquid("n-heptane").index(np.array([at_um]), 300.0))
    table = droplet_table(wavelength_um=at_um, n=PAPER.n, k=PAPER.k, cache=lab.runs.cache)
    extinction = table.efficiencies(np.array([2e-6, 9e-6, _LARGE_M]))[0]
    rows: list[Row] = []
    off: list[float] = []
    for row in FIG4:
        d10_um, d32_um = (1e6 * mean_diameter_m(row.sizes, *powers) for powers in ((1, 0), (3, 2)))
        off += [abs(d10_um - row.d10_um), abs(d32_um - row.d32_um)]
        rows.append(
            {
                "distribution": named(row.sizes),
                "D10 / µm": d10_um,
                "the paper's D10 / µm": row.d10_um,
                "D32 / µm": d32_um,
                "the paper's D32 / µm": row.d32_um,
            }
        )
    stronger, weaker = ("more", "less") if k > PAPER.k else ("less", "more")
    return Results(
        values={
            "um": at_um,
            "k": k,
            "k_ratio": k / PAPER.k,
            "paper_k": PAPER.k,
            "absorb": stronger,
            "scatter": weaker,
            "n_change": n - PAPER.n,
            "large": float(extinction[2]),
            "small_over_middle": float(extinction[0] / extinction[1]),
            "off_um": max(off),
        },
        table=rows,
        sheets={"optics": optics_figure(data)},
    )


# MPa, K: pressure alone, temperature alone, and the corners
_CONDITIONS = ((0.15, 300.0), (0.6, 300.0), (0.3, 500.0), (0.6, 570.0), (0.9, 620.0))
# The paper's holes have "different inclination angles", which it does not give: assumed 33 degrees
# on average, as in gdi, and 8 degrees more towards the lamp.
_AZIMUTHS_DEG = 22.5 + 45.0 * np.arange(8)
_INCLINATIONS_DEG = np.round(33.0 + 8.0 * np.cos(np.radians(_AZIMUTHS_DEG)), 1)
_UNEQUAL = "0.6 MPa, 570 K, unequal holes"
_WITHIN = 0.97  # of the light, or of the liquid's mass
_SIDE_M = 0.2  # of the enclosure (the paper's cube), one side of which is the lamp
# Green light, which n-heptane does not absorb (n at 20 C), seen without perspective.
_LIGHT: dict[str, Any] = {
    "optics.wavelength_um": 0.55,
    "optics.filter_um": [0.54, 0.56],
    "optics.n": 1.388,
    "optics.k": 1e-7,
    "optics.vapour_m2_mol": 0.0,
    "transport.phase": "mie",
    "transport.directions": 48,
    "transport.gather": False,
    "domain.edge_m": _SIDE_M,
    "domain.centre_m": [0.0, 0.0, 0.0],
    "camera.model": "orthographic",
    "camera.target_m": [0.0, 0.0, 0.0],
    "patches": [
        {
            "name": "lamp",
            "centre_m": [0.4999 * _SIDE_M, 0.0, 0.0],
            "facing": [-1.0, 0.0, 0.0],
            "size_m": [_SIDE_M, _SIDE_M],
            "temperature_K": 300.0,  # of no effect: light is a weight of the trace
        }
    ],
}


def within_m(radius_m: Floats, amount: Floats) -> float:
    """Radius of the circle that contains 97 % of an amount at radii, both (N,)."""
    order = np.argsort(radius_m)
    share = np.cumsum(amount[order]) / amount.sum()
    return float(radius_m[order][np.searchsorted(share, _WITHIN)])


def from_below(spray: Spray) -> Spray:
    """The droplets as mirrored to the plane of the camera, which sees them from below.

    Up is y and right is x, as in drawings of an injector.
    """
    assert spray.parcels is not None
    place = spray.parcels.position_m[:, [0, 2, 1]]
    return Spray(parcels=replace(spray.parcels, position_m=place, velocity_m_s=None))


def visible_light(lab: Lab) -> Results:
    """Light of a lamp that droplets scatter to a camera below, 1.5 ms after the start."""
    cases: dict[str, dict[str, Any]] = {
        f"{MPa:g} MPa, {gas_K:g} K": {"spray.ambient": ambient(MPa, gas_K)}
        for MPa, gas_K in _CONDITIONS
    }
    holes = zip(_INCLINATIONS_DEG.tolist(), _AZIMUTHS_DEG.tolist(), strict=True)
    cases[_UNEQUAL] = {"spray.plumes": [
        {"inclination_deg": inclination, "azimuth_deg": azimuth} for inclination, azimuth in holes
    ]}  # fmt: skip
    seen: dict[str, tuple[Floats, ImageFrame]] = {}
    rows: dict[str, Row] = {}
    for case, values in cases.items():
        name = f"visible-{case.replace(' ', '').replace(',', '-')}"
        scene = lab.gdi(name, {"spray.time_s": 1.5e-3, **values, **_LIGHT})
        spray = lab.spray(scene)
        run = lab.run(scene, spray=partial(from_below, spray))
        light = run.weights.patches["lamp"].astype(float)
        seen[case] = light, replace(frame_of(scene), axes=("x", "y"))
        pixels = spray_of(run)
        light_m = within_m(np.hypot(pixels.x_m, pixels.z_m).ravel(), light.ravel())
        rows[case] = {"gas": case, **_reaches(spray, light_m)}
    plumes_mm = reach_of_plumes_mm(spray)
    light_mm = {case: float(row["projected penetration of the light / mm"])
                for case, row in rows.items()}  # fmt: skip

    def told(case: str) -> str:
        liquid_mg, vapour_mg = float(rows[case]["liquid / mg"]), float(rows[case]["vapour / mg"])
        return (
            f"{light_mm[case]:.1f} mm at {case}, with "
            f"{100 * liquid_mg / (liquid_mg + vapour_mg):.0f} % of the fuel still liquid"
        )

    *descriptions, hottest = (
        told(case) for case in cases if case not in ("0.3 MPa, 500 K", _UNEQUAL)
    )
    ratios = [float(row["of the liquid / mm"]) / light_mm[case] for case, row in rows.items()]
    return Results(
        values={
            "within": 100 * _WITHIN,
            "seen": f"{'; '.join(descriptions)}; and {hottest}",
            "least": min(ratios),
            "most": max(ratios),
            "by_pressure_mm": light_mm["0.6 MPa, 300 K"] - light_mm["0.15 MPa, 300 K"],
            "by_temperature_mm": light_mm["0.6 MPa, 570 K"] - light_mm["0.6 MPa, 300 K"],
            "hot_over_cold": light_mm["0.9 MPa, 620 K"] / light_mm["0.15 MPa, 300 K"],
            "least_deg": min(_INCLINATIONS_DEG),
            "most_deg": max(_INCLINATIONS_DEG),
            "least_mm": min(plumes_mm),
            "most_mm": max(plumes_mm),
            "by_inclination": float(spearmanr(_INCLINATIONS_DEG, plumes_mm).statistic),
        },
        table=list(rows.values()),
        sheets={"below": _light_sheet(seen)},
    )


def _reaches(spray: Spray, light_m: float) -> Row:
    """Reach of light, liquid and vapour of the spray, and the masses of both phases."""
    assert spray.parcels is not None
    radius_m = np.hypot(*spray.parcels.position_m[:, :2].T)
    return {
        "projected penetration of the light / mm": light_m * 1e3,
        "of the liquid / mm": within_m(radius_m, spray.parcels.masses_kg) * 1e3,
        "penetration / mm": spray.notes["liquid_penetration_m"] * 1e3,
        "vapour penetration / mm": spray.notes["vapour_penetration_m"] * 1e3,
        "liquid / mg": spray.notes["liquid_mass_kg"] * 1e6,
        "vapour / mg": spray.notes["vapour_mass_kg"] * 1e6,
    }


def reach_of_plumes_mm(spray: Spray) -> list[float]:
    """Projected penetration of the liquid of each of eight plumes."""
    assert spray.parcels is not None
    x, y = spray.parcels.position_m[:, :2].T
    hole = np.floor(np.degrees(np.arctan2(y, x)) % 360.0 / 45.0)
    return [
        1e3 * within_m(np.hypot(x, y)[hole == number], spray.parcels.masses_kg[hole == number])
        for number in range(8)
    ]


def _light_sheet(seen: Mapping[str, tuple[Floats, ImageFrame]]) -> Figure:
    top = max(float(np.percentile(light, 99.9)) for light, _ in seen.values())
    label = "radiance / that of the lamp"
    panels = [
        Panel(light, gas, label, (0.0, top), NEGATIVE, frame=frame)
        for gas, (light, frame) in seen.items()
    ]
    window = joined([window_around(light, frame) for light, frame in seen.values()])
    return panels_figure(
        panels, title="scattered light from below", window=window, columns=3, shared=True
    )


_BACKGROUND_K = 443.0  # paper, Fig. 6
_CAMERA = {
    "spray.time_s": 0.3e-3,
    **in_gas(0.4)[1],
    "background.temperatures_K": [413.0, _BACKGROUND_K, 473.0],
    "camera.field_m": [0.08, 0.064],
    "camera.target_m": [0.0, 0.0, -0.025],
    "camera.sensor.pixels": [640, 512],
    "camera.sensor.integration_time_s": 25e-6,
}
_OPAQUE = 0.3  # emissivity above that of the plumes' rim


def _radiance(run: Run) -> NDArray[np.float64]:
    surroundings = Surroundings.from_scene(run.scene)
    bands = [Boundary.of(surroundings, node.radiance, node.pane) for node in run.quadrature.nodes]
    return camera_radiance(run.spectral, bands, background_K=_BACKGROUND_K)


def camera(lab: Lab) -> Results:
    """One trace, one exposure."""
    pixels = {"camera.pixels": [320, 256] if lab.quick else [1000, 800]}
    run = lab.run(lab.gdi("camera", {**_CAMERA, **pixels}))
    sensor = SensorModel.from_scene(run.scene)
    view = SensorView.from_scene(run.scene)
    seen = view.image(_radiance(run))
    raw = sensor.expose(seen, np.random.default_rng(1))
    calibration = sensor.calibration()
    traced = calibration.counts(_radiance(run))
    behind = np.array([run.quadrature.nodes[0].radiance(_BACKGROUND_K)])
    background_counts = float(calibration.counts(behind)[0])
    noise = float(np.sqrt(calibration.variance_counts2(np.array([background_counts])))[0])
    opaque = visible(run) & (run.maps.emissivity > _OPAQUE)
    core = float(np.mean(traced[root(run) & opaque])) if (root(run) & opaque).any() else np.nan
    rim = float(np.percentile(traced[opaque], 99.0)) if opaque.any() else np.nan
    hidden = opaque & (np.abs(traced - background_counts) < SURE * noise)
    count, invisible_K = float(np.count_nonzero(hidden)), mean_K(run, hidden)
    return Results(
        values={
            "background_K": _BACKGROUND_K,
            "before": background_counts,
            "core": core,
            "rim": rim,
            "core_sigma": (background_counts - core) / noise,
            "rim_sigma": (rim - background_counts) / noise,
            "hidden": count,
            "invisible_K": invisible_K,
            "invisible_change_K": invisible_K - _BACKGROUND_K,
        },
        table=[
            {
                "background / counts": background_counts,
                "noise of one exposure / counts": noise,
                "below the nozzle / counts": core,
                "brightest rim / counts": rim,
                "pixels that hide": count,
                "their T_app / K": invisible_K,
            }
        ],
        sheets={"images": _exposure(raw, traced, run.scene)},
    )


def _exposure(raw: NDArray[np.uint16], traced: NDArray[np.float64], scene: Scene) -> Figure:
    low, high = (float(value) for value in np.percentile(traced, [0.1, 99.9]))
    sensor, label = frame_of(scene, sensor=True), "signal / counts"
    panels = [
        Panel(raw, "camera, one exposure", label, (low, high), COUNTS, frame=sensor),
        Panel(traced, "traced", label, (low, high), COUNTS, frame=frame_of(scene)),
    ]
    window = sensor.extent_mm(raw.shape)
    title = f"signal in front of a background of {_BACKGROUND_K:g} K"
    return panels_figure(panels, title=title, window=window, shared=True)
