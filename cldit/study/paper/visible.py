"""Fig. 5: droplets from below, over pressure and temperature of the gas."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm

from cldit.show.figures.sheet import figure_of
from cldit.show.report.html import Picture
from cldit.show.report.spray_report import Projection, liquid_mass
from cldit.spray.result import Spray
from cldit.study.lab import Lab
from cldit.study.page import Page, Row
from cldit.study.pictures import small_png
from cldit.study.verdict import Verdict

# MPa, K: pressure alone, temperature alone, and the corners
_CONDITIONS = ((0.15, 300.0), (0.6, 300.0), (0.3, 500.0), (0.6, 570.0), (0.9, 620.0))
_WITHIN = 0.97  # of the liquid's mass
_DECADES = 3.0
_HALF_MM = 55.0


def projected_m(spray: Spray) -> float:
    """Radius, seen from below, within which 97 % of the liquid's mass lies."""
    if spray.parcels is None or not len(spray.parcels.diameter_m):
        return float("nan")
    parcels = spray.parcels
    mass = parcels.droplets * parcels.density_kg_m3 * parcels.diameter_m**3
    radius = np.hypot(parcels.position_m[:, 0], parcels.position_m[:, 1])
    order = np.argsort(radius)
    share = np.cumsum(mass[order]) / mass.sum()
    return float(radius[order][np.searchsorted(share, _WITHIN)])


def study(lab: Lab) -> Page:
    """Sprays alone, 1.5 ms after the start: nothing is traced."""
    sprays: dict[tuple[float, float], Spray] = {}
    rows: list[Row] = []
    for pressure_MPa, gas_K in _CONDITIONS:
        scene = lab.gdi(
            f"visible-{pressure_MPa:g}MPa-{gas_K:g}K",
            {
                "spray.time_s": 1.5e-3,
                "spray.ambient": {"pressure_Pa": pressure_MPa * 1e6, "temperature_K": gas_K},
            },
        )
        spray = lab.spray(scene)
        sprays[pressure_MPa, gas_K] = spray
        rows.append(
            {
                "gas": f"{pressure_MPa:g} MPa, {gas_K:g} K",
                "projected penetration / mm": projected_m(spray) * 1e3,
                "penetration / mm": spray.notes["liquid_penetration_m"] * 1e3,
                "vapour penetration / mm": spray.notes["vapour_penetration_m"] * 1e3,
                "liquid / mg": spray.notes["liquid_mass_kg"] * 1e6,
                "vapour / mg": spray.notes["vapour_mass_kg"] * 1e6,
            }
        )
    reach = {key: projected_m(spray) * 1e3 for key, spray in sprays.items()}
    return Page(
        name="visible",
        title="Visible light from below",
        figure="Fig. 5",
        text=_text(rows),
        pictures={
            "below": Picture(
                _picture(sprays),
                "Liquid mass of a column, seen from below, 1.5 ms after start of injection, fuel "
                "370 K and 20 MPa. The eight plumes differ in inclination.",
            )
        },
        table=rows,
        verdicts=(
            Verdict(
                claim="Penetration falls with pressure (0.6 MPa minus 0.15 MPa, both 300 K)",
                value=reach[0.6, 300.0] - reach[0.15, 300.0],
                unit="mm",
                high=0.0,
            ),
            Verdict(
                claim="and with temperature (570 K minus 300 K, both 0.6 MPa)",
                value=reach[0.6, 570.0] - reach[0.6, 300.0],
                unit="mm",
                high=0.0,
            ),
            Verdict(
                claim="Hot and dense gas stops it first of all (0.9 MPa 620 K over 0.15 MPa 300 K)",
                value=reach[0.9, 620.0] / reach[0.15, 300.0],
                high=0.8,
            ),
        ),
    )


def _picture(sprays: dict[tuple[float, float], Spray]) -> bytes:
    seen: list[Projection] = [
        liquid_mass(spray, "below", pixel_m=5e-4) for spray in sprays.values()
    ]
    top = max(float(each.image.max(initial=0.0)) for each in seen) or 1.0
    norm = LogNorm(top * 10**-_DECADES, top)
    figure = figure_of(11.4, 7.2)
    grid = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    for axes, each, (pressure_MPa, gas_K) in zip(grid, seen, sprays, strict=False):
        axes.imshow(
            np.ma.masked_less_equal(each.image, top * 10**-_DECADES),
            extent=[1e3 * edge for edge in each.edges_m],
            origin="lower",
            cmap="viridis",
            norm=norm,
            interpolation="nearest",
        )
        axes.set_title(f"{pressure_MPa:g} MPa, {gas_K:g} K", fontsize=9)
        axes.plot(0.0, 0.0, "+", color="black")
        axes.set_xlabel("x / mm")
        axes.set_ylabel("y / mm")
        axes.set_xlim(-_HALF_MM, _HALF_MM)
        axes.set_ylim(-_HALF_MM, _HALF_MM)
        axes.set_aspect("equal")
        axes.label_outer()
    for axes in grid[len(sprays) - 3 : len(sprays)]:  # with nothing below
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("x / mm")
    for axes in grid[len(sprays) :]:
        axes.set_axis_off()
    figure.colorbar(
        ScalarMappable(norm, "viridis"), ax=list(grid), label="liquid mass / kg m$^{-2}$"
    )
    return small_png(figure)


def _text(rows: list[Row]) -> str:
    at = {str(row["gas"]): row for row in rows}

    def told(gas: str) -> str:
        row = at[gas]
        liquid, vapour = float(row["liquid / mg"]), float(row["vapour / mg"])
        return (
            f"{float(row['projected penetration / mm']):.1f} mm at {gas}, with "
            f"{100 * liquid / (liquid + vapour):.0f} % of the fuel still liquid"
        )

    return (
        "Droplets of the computed spray from below, each column's mass added up, as a lamp from "
        f"the side would show them. {100 * _WITHIN:.0f} % of the liquid lie within "
        f"{told('0.15 MPa, 300 K')}; {told('0.6 MPa, 300 K')}; {told('0.6 MPa, 570 K')}; and "
        f"{told('0.9 MPa, 620 K')}. Denser gas takes the plumes' momentum on a shorter way, and "
        "hot gas ends the liquid where the plume has drawn in the heat that its evaporation needs."
    )
