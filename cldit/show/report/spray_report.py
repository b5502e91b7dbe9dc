"""Figures of a spray: from the side, from below, and against time."""

from dataclasses import fields
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

from cldit.arrays import Floats
from cldit.constants import AVOGADRO_PER_MOL
from cldit.io.files import make_folder, write_text
from cldit.io.text_tables import csv_text
from cldit.show.figures.colours import MASS
from cldit.show.figures.curves import time_figure
from cldit.show.figures.panels import ImageFrame, Panel, panels_figure
from cldit.show.figures.style import write_figure
from cldit.spray.extent import Box
from cldit.spray.flow.measures import History
from cldit.spray.result import Spray
from cldit.spray.vtk_export import write_vtk

View = Literal["side", "below"]

_AXES = {"side": (0, 2), "below": (0, 1)}
_NAMES = "xyz"
_NOTHING = np.empty((0, 3)), np.empty(0)  # places and masses


def extent(spray: Spray) -> tuple[Floats, Floats]:
    """Lower and upper corner (3,) of the region with fuel, the injector included."""
    points = [np.zeros((1, 3))]
    if spray.parcels is not None:
        points.append(spray.parcels.position_m)
    if spray.vapour is not None and np.any(spray.vapour.number_density_m3 > 0):
        dense = spray.vapour.number_density_m3 > 1e-3 * spray.vapour.number_density_m3.max()
        points += [spray.vapour.cells.lower_m[dense], spray.vapour.cells.upper_m[dense]]
    corners_m = np.concatenate(points)
    return corners_m.min(axis=0) - 2e-3, corners_m.max(axis=0) + 2e-3


def liquid_mass(spray: Spray, view: View, *, pixel_m: float) -> tuple[Floats, ImageFrame]:
    """Mass of the droplets along the line of sight (from below: the paper's Fig. 5), kg/m2 (H, W),
    and its place. The sum over the pixels is exact."""
    points, smoothing = _NOTHING, 0.0
    if (parcels := spray.parcels) is not None:
        points, smoothing = (
            (parcels.position_m, parcels.masses_kg),
            1.0,
        )  # pixel: parcels are points
        if isinstance(parcels.extent, Box):
            half = parcels.extent.edge_m / 2
            corners = parcels.position_m - half, parcels.position_m + half
            points, smoothing = _filled(*corners, parcels.masses_kg, view, pixel_m), 0.0
    return _project(*points, extent(spray), view, pixel_m, smoothing)


def vapour_mass(spray: Spray, view: View, *, pixel_m: float) -> tuple[Floats, ImageFrame]:
    """Mass of the fuel vapour along the line of sight, kg/m2 (H, W), and its place."""
    points = _NOTHING
    if (vapour := spray.vapour) is not None:
        mass = vapour.number_density_m3 * vapour.cells.volume_m3
        mass = mass * vapour.molar_mass_kg_mol / AVOGADRO_PER_MOL
        points = _filled(vapour.cells.lower_m, vapour.cells.upper_m, mass, view, pixel_m)
    return _project(*points, extent(spray), view, pixel_m, 0.0)


def _filled(
    lower_m: Floats, upper_m: Floats, mass: Floats, view: View, pixel_m: float
) -> tuple[Floats, Floats]:
    """Points (N, 3) in place of boxes, so close that no pixel is missed, and their masses (N,)."""
    edge = upper_m - lower_m
    parts = int(np.clip(np.ceil(2 * edge.max(initial=0.0) / pixel_m - 1e-6), 1, 6))
    right_axis, up_axis = _AXES[view]
    places, masses = [], []
    for i in range(parts):
        for j in range(parts):
            at = lower_m + 0.5 * edge
            at[:, right_axis] += ((i + 0.5) / parts - 0.5) * edge[:, right_axis]
            at[:, up_axis] += ((j + 0.5) / parts - 0.5) * edge[:, up_axis]
            places.append(at)
            masses.append(mass / parts**2)
    return np.concatenate(places), np.concatenate(masses)


def _project(
    place: Floats,
    mass: Floats,
    bounds: tuple[Floats, Floats],
    view: View,
    pixel_m: float,
    smoothing: float,
) -> tuple[Floats, ImageFrame]:
    axes = _AXES[view]
    edges = [
        np.arange(np.floor(bounds[0][a] / pixel_m), np.ceil(bounds[1][a] / pixel_m) + 1) * pixel_m
        for a in axes
    ]
    right, up = axes
    image = np.histogram2d(place[:, right], place[:, up], bins=edges, weights=mass)[0].T[::-1]
    if smoothing:
        image = gaussian_filter(image, smoothing, mode="constant")
    x, y = (0.5 * (along[0] + along[-1]) for along in edges)
    frame = ImageFrame((pixel_m, pixel_m), (x, y), axes=(_NAMES[right], _NAMES[up]))
    return np.asarray(image) / pixel_m**2, frame


def views_figure(spray: Spray, *, title: str, pixel_m: float = 5e-4) -> Figure:
    """Figure of droplets and vapour from the side and from below, with pixels of `pixel_m`."""
    views: tuple[View, View] = ("side", "below")
    kinds = {"droplets": liquid_mass, "vapour": vapour_mass}
    panels = [
        _mass_panel(*of(spray, view, pixel_m=pixel_m), f"{name}, {view}")
        for view in views
        for name, of in kinds.items()
    ]
    return panels_figure(panels, title=title)


def _mass_panel(mass: Floats, frame: ImageFrame, title: str) -> Panel:
    """Panel of mass per area (H, W), three decades below the largest; white below them."""
    top = float(mass.max(initial=0.0))
    low = 1e-3 * top
    image = 1e3 * np.where(mass >= low, mass, np.nan if top > 0 else 0.0)
    return Panel(
        image,
        title if top > 0 else f"{title}: none",
        "mass per area / (g/m²)",
        (1e3 * low, 1e3 * top) if top > 0 else (0.0, 1.0),
        MASS,
        logarithmic=top > 0,
        clear=np.isnan(image),
        frame=frame,
    )


def history_figure(history: History, *, title: str) -> Figure:
    """Figure of penetration, droplet size, masses and coldest gas against time."""
    penetrations = [
        (1e3 * history.vapour_m, "vapour, along the plumes (0.001)", ""),
        (1e3 * history.liquid_m, "liquid, axial (2e-3 mm³/mm²)", ""),
        (1e3 * history.thin_liquid_m, "liquid, axial (0.2e-3 mm³/mm²)", ""),
    ]
    masses = [
        (1e6 * history.injected_kg, "injected", ""),
        (1e6 * history.liquid_kg, "liquid", ""),
        (1e6 * history.vapour_kg, "vapour", ""),
    ]
    panels = [
        ("penetration / mm", True, penetrations),
        ("Sauter mean diameter / µm", False, [(1e6 * history.sauter_mean_diameter_m, "", "")]),
        ("mass / mg", True, masses),
        ("coldest gas / K", False, [(history.coldest_K, "", "")]),
    ]
    time_ms, label = 1e3 * history.time_s, "time after start of injection / ms"
    return time_figure(time_ms, label, panels, title=title, height_in=4.8, columns=2)


def write_spray(
    spray: Spray, history: History | None, folder: Path, *, title: str, suffix: str = ".png"
) -> list[Path]:
    """Writes figures, the history as CSV if known, and files for ParaView; returns the files."""
    make_folder(folder)
    written = [folder / f"views{suffix}"]
    write_figure(views_figure(spray, title=title), written[0])
    if history is not None:
        written += [folder / f"history{suffix}", folder / "history.csv"]
        write_figure(history_figure(history, title=title), written[1])
        names = [column.name for column in fields(history)]
        rows = np.stack([getattr(history, name) for name in names], axis=1)
        table = csv_text(names, ([f"{value:.6g}" for value in row] for row in rows))
        write_text(written[2], table)
    return written + write_vtk(spray, folder)
