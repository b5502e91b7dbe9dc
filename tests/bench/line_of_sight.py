"""Figure of docs/reading.md: temperatures along a line of sight and across an image, and T_app.

    python -m tests.bench line_of_sight gdi --pixels 100 --out docs

The medium is that of the run: what absorbs and what is scattered in each leaf of its octree.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import cldit
from cldit.gpu.device import Device, open_device
from cldit.io.caches import default_cache
from cldit.optics.planck import band_radiance
from cldit.run import Run
from cldit.run.octree_export import CellFields
from cldit.run.rebuilt import rebuilt
from cldit.show.figures.colours import TEMPERATURE
from cldit.show.figures.maps import frame_of, spray_window
from cldit.show.figures.style import WIDTH_IN, figure_of, styled, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cldit.arrays import Floats, Ints

_BLUE, _RED, _GREY, _BLACK = "#1f5fa8", "#c0392b", "#8a8a8a", "#222222"
_BELOW: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.22), "frameon": False, "ncols": 2}


@dataclass(frozen=True)
class Medium:
    """Leaves of a run's octree in a grid of finest cells (z, y, x), by which lines are followed."""

    leaf: Ints
    fields: CellFields
    lower_m: Floats
    cell_m: float
    camera_m: Floats

    @classmethod
    def of(cls, run: Run, device: Device) -> Medium:
        """Medium of the wavelength with most of the light."""
        medium = rebuilt(run, device, default_cache())
        fields, frame = CellFields.of(medium, run.quadrature, device), medium.tree.frame
        leaf = np.full((frame.cells,) * 3, -1, np.int32)
        leaves = fields.leaves
        for number, (corner, edge) in enumerate(zip(leaves.corner, leaves.edge, strict=True)):
            x, y, z = corner
            leaf[z : z + edge, y : y + edge, x : x + edge] = number
        camera_m = np.array(run.scene.target_m) - (0.0, run.scene.camera.distance_m, 0.0)
        return cls(leaf, fields, np.asarray(frame.lower_m), frame.cell_m, camera_m)

    def line(self, x_m: float, z_m: float) -> Line:
        """Line of sight of a point of the target plane, in steps of a quarter of a cell."""
        step_m = self.cell_m / 4
        y_m = self.lower_m[1] + step_m * (np.arange(4 * len(self.leaf)) + 0.5)
        share = (y_m - self.camera_m[1]) / -self.camera_m[1]
        points_m = self.camera_m + share[:, None] * (np.array([x_m, 0.0, z_m]) - self.camera_m)
        cell = np.floor((points_m - self.lower_m) / self.cell_m).astype(int)
        inside = np.all((cell >= 0) & (cell < len(self.leaf)), axis=1)
        leaf = self.leaf[tuple(cell[inside].T[::-1])]
        values = {name: field[leaf] for name, field in self.fields.values.items()}
        slant = np.linalg.norm(points_m[-1] - points_m[0]) / (y_m[-1] - y_m[0])
        return Line(y_m[inside], step_m * slant, values)


@dataclass(frozen=True)
class Line:
    """Medium along a line of sight, from the camera on: y and fields (N,) of its steps."""

    y_m: Floats
    step_m: float
    fields: dict[str, np.ndarray]

    @property
    def depth(self) -> Floats:
        """Optical depth between the camera and the middle of each step."""
        each = self.fields["extinction_per_m"].astype(float) * self.step_m
        return np.cumsum(each) - 0.5 * each

    @property
    def light(self) -> Floats:
        """Share of the medium's light, as the camera sees it, by step."""
        extinction = self.fields["extinction_per_m"].astype(float)
        source = self.fields["source_function_photons_per_s_m2_sr"]
        light = np.exp(-self.depth) * extinction * source
        return light / light.sum() if light.sum() else light

    @property
    def half_light_m(self) -> float:
        """y before which half of the light comes from."""
        return float(np.interp(0.5, np.cumsum(self.light), self.y_m))

    def temperature_K(self, phase: str) -> Floats:
        """Temperature of the vapour or the droplets; NaN where there is none."""
        return self.fields[f"{phase}_temperature_K"].astype(float)

    @property
    def visibility(self) -> Floats:
        """Absorption, and so emission, that the camera sees: e^-depth times absorption, by step."""
        return np.exp(-self.depth) * self.absorption_per_m

    @property
    def absorption_per_m(self) -> Floats:
        """Absorption of both phases, by step."""
        return self._absorption_per_m("vapour") + self._absorption_per_m("droplet")

    @property
    def coldest_K(self) -> float:
        """Lowest temperature of what absorbs more than a hundredth of the most."""
        absorption = self.absorption_per_m
        thick = absorption > 0.01 * absorption.max()
        both = np.fmin(self.temperature_K("vapour"), self.temperature_K("droplet"))
        return float(np.nanmin(both[thick]))

    def mean_K(self, weight: Floats) -> float:
        """Mean over `weight` (N,) of the temperature, that of both phases by their absorption."""
        heat = sum(
            self._absorption_per_m(phase) * np.nan_to_num(self.temperature_K(phase))
            for phase in ("vapour", "droplet")
        )
        absorption = self.absorption_per_m
        known = absorption > 0
        return float(
            np.average((heat / np.where(known, absorption, 1.0))[known], weights=weight[known])
        )

    def _absorption_per_m(self, phase: str) -> Floats:
        return self.fields[f"{phase}_absorption_per_m"].astype(float)


@styled
def reading_figure(run: Run, medium: Medium, column: int, row: int) -> Figure:
    """Map with the line and the pixel, temperatures along that pixel's line, and across the row."""
    figure = figure_of(WIDTH_IN, 2.9)
    image, along, across = figure.subplots(1, 3)
    maps, frame = run.maps, frame_of(run.scene)
    left, right, bottom, top = frame.extent_mm(maps.reason.shape)
    rows, columns = maps.reason.shape
    x_mm = left + (np.arange(columns) + 0.5) * (right - left) / columns
    z_mm = top - (np.arange(rows) + 0.5) * (top - bottom) / rows
    temperature_K = maps.apparent_temperature_K
    shown = image.imshow(temperature_K, extent=(left, right, bottom, top), cmap=TEMPERATURE)
    figure.colorbar(shown, ax=image, location="bottom", label="T_app / K")
    image.axhline(z_mm[row], color=_GREY, linewidth=0.8)
    image.plot(x_mm[column], z_mm[row], "o", mfc="none", mec=_BLACK, markersize=5)
    window = spray_window(maps, frame)
    image.set(xlim=window[:2], ylim=window[2:], xlabel="x / mm", ylabel="z / mm", title="(a) image")
    _along(along, medium.line(x_mm[column] / 1e3, z_mm[row] / 1e3), temperature_K[row, column])
    _across(across, run, medium, row, x_mm, z_mm[row])
    return figure


def _along(axes: Axes, line: Line, apparent_K: float) -> None:
    y_mm = 1e3 * line.y_m
    light = axes.twinx()
    light.fill_between(y_mm, line.light / (1e3 * line.step_m), color=_GREY, alpha=0.3, linewidth=0)
    light.set(ylabel="share of the light / (1/mm)", ylim=(0, None))
    axes.plot(y_mm, line.temperature_K("vapour"), color=_RED, label="vapour and gas")
    axes.plot(y_mm, line.temperature_K("droplet"), color=_BLUE, label="droplets")
    axes.axhline(apparent_K, color=_BLACK, linestyle="--", label="T_app")
    seen = line.fields["extinction_per_m"] > 0
    ends = y_mm[seen][[0, -1]] if seen.any() else y_mm[[0, -1]]
    axes.set(xlim=tuple(ends), xlabel="y / mm (camera at the left)", ylabel="temperature / K")
    axes.set_title("(b) along the line of the circle")
    axes.legend(**_BELOW)


def _across(axes: Axes, run: Run, medium: Medium, row: int, x_mm: Floats, z_mm: float) -> None:
    apparent_K = run.maps.apparent_temperature_K[row]
    visible = np.isfinite(apparent_K)
    x_mm, apparent_K = x_mm[visible], apparent_K[visible]
    lines = [medium.line(x / 1e3, z_mm / 1e3) for x in x_mm]
    by_absorption = np.array([line.mean_K(line.absorption_per_m) for line in lines])
    by_visibility = np.array([line.mean_K(line.visibility) for line in lines])
    coldest = [line.coldest_K for line in lines]
    for values, colour, style, name in (
        (coldest, _BLUE, "-", "coldest"),
        (by_absorption, _RED, "-", "mean by absorption"),
        (by_visibility, _GREY, "-", "mean by visibility"),
        (apparent_K, _BLACK, "--", "T_app"),
    ):
        axes.plot(x_mm, values, style, color=colour, label=name)
    axes.set(xlabel="x / mm", ylabel="temperature / K", title=f"(c) along z = {z_mm:.0f} mm")
    axes.legend(**_BELOW)
    for name, mean_K in (("visibility", by_visibility), ("absorption", by_absorption)):
        apart_K = mean_K - apparent_K
        rms_K = np.sqrt((apart_K**2).mean())
        print(f"mean by {name} - T_app: {apart_K.mean():+.1f} K, RMS {rms_K:.1f} K")


def light_shares(run: Run, column: int, row: int) -> dict[str, float]:
    """Shares of what reaches a pixel from the spray: emitted by each phase, scattered from walls.

    The background's light that droplets scatter is in `background`, as its light behind them is.
    """
    filter_um = run.quadrature.filter_um
    radiance = {name: 1.0 for name in ("vapour", "liquid")}
    radiance["wall"] = float(band_radiance(run.scene.walls.temperature_K, filter_um=filter_um))
    light = {
        name: float(run.weights.images[name][row, column]) * factor
        for name, factor in radiance.items()
    }
    return {name: part / sum(light.values()) for name, part in light.items()}


def main() -> None:
    """Traces a scene, and draws the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="gdi")
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--field", type=float, default=60.0, help="width and height, mm")
    parser.add_argument("--x", type=float, default=-8.0, help="of the pixel, mm")
    parser.add_argument("--z", type=float, default=-25.0, help="of the row, mm")
    parser.add_argument("--run", type=Path, help="folder to keep the run in, or to read it from")
    parser.add_argument("--out", type=Path, default=Path("docs"))
    options = parser.parse_args()
    device = open_device()
    field_m = options.field / 1e3
    scene = cldit.load_scene(options.scene).with_(
        **{"camera.field_m": [field_m] * 2, "camera.target_m": [0.0, 0.0, -0.4 * field_m]}
    )
    run = cldit.simulate(
        scene, options.run, quick=True, pixels=options.pixels, device=device, progress=print
    )
    frame, shape = frame_of(run.scene), run.maps.reason.shape
    left, right, bottom, top = frame.extent_mm(shape)
    column = int((options.x - left) / (right - left) * shape[1])
    row = int((top - options.z) / (top - bottom) * shape[0])
    medium = Medium.of(run, device)
    line = medium.line(options.x / 1e3, options.z / 1e3)
    print(f"T_app {run.maps.apparent_temperature_K[row, column]:.1f} K")
    print(f"emissivity {run.maps.emissivity[row, column]:.3f}, depth {line.depth[-1]:.2f}")
    for phase in ("vapour", "droplet"):
        kelvin = line.temperature_K(phase)
        if np.isfinite(kelvin).any():
            print(f"{phase}: {np.nanmin(kelvin):.1f} to {np.nanmax(kelvin):.1f} K")
    shares = light_shares(run, column, row)
    print(", ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items()))
    print(f"half of the light from in front of y = {1e3 * line.half_light_m:.1f} mm")
    figure = reading_figure(run, medium, column, row)
    print(write_figure(figure, options.out / "reading.png"))


if __name__ == "__main__":
    main()
