"""Where the spray comes from: a model and its conditions, a grid, or a CFD result."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator

from cldit.scene.checks import Section, Within
from cldit.scene.sizes import Droplets, NukiyamaTanasawa
from cldit.scene.values import Angle, Direction, Length, Point


class Ambient(Section):
    """The gas of the vessel before injection."""

    pressure_Pa: Annotated[float, Within(1e3, 2e7)] = 0.6e6
    temperature_K: Annotated[float, Within(200.0, 2000.0)] = 570.0


class Plume(Section):
    """One hole of the injector: where its plume points."""

    inclination_deg: Annotated[float, Within(0.0, 89.0)]  # from the injector axis, -z
    azimuth_deg: Angle  # from +x towards +y
    cone_angle_deg: Annotated[float, Within(0.5, 120.0)] = 22.0  # full angle
    mass_fraction: Annotated[float, Within(1e-6, 1e6)] = 1.0  # relative to the other plumes


def _some(plumes: tuple[Plume, ...]) -> tuple[Plume, ...]:
    if not 1 <= len(plumes) <= 64:
        raise ValueError(f"{len(plumes)} plumes, allowed is 1..64")
    return plumes


Plumes = Annotated[tuple[Plume, ...], AfterValidator(_some)]


EIGHT_PLUMES = tuple(
    Plume(inclination_deg=33.0, azimuth_deg=22.5 + 45.0 * hole) for hole in range(8)
)


class ConeSpray(Section):
    """Analytic plumes: mixing-limited evaporation in quasi-steady jets."""

    model: Literal["cone"] = "cone"
    time_s: Annotated[float, Within(1e-5, 0.1)] = 0.95e-3
    injected_mass_kg: Annotated[float, Within(0.0, 1e-2)] = 10e-6
    injection_duration_s: Annotated[float, Within(1e-5, 1.0)] = 1.5e-3
    injection_pressure_Pa: Annotated[float, Within(1e5, 5e8)] = 20e6
    hole_diameter_m: Annotated[float, Within(1e-6, 1e-2)] = 165e-6
    fuel: Literal["n-heptane", "methane"] = "n-heptane"
    fuel_temperature_K: Annotated[float, Within(180.0, 535.0)] = 370.0
    ambient: Ambient = Ambient()
    droplets: Droplets | None = NukiyamaTanasawa()
    evaporation: bool = True
    parcels_per_cell: Annotated[int, Within(1, 1000)] = 4
    spacing_m: Annotated[float, Within(1e-5, 1e-2)] = 0.5e-3
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    plumes: Plumes = EIGHT_PLUMES


class InjectionRate(Section):
    """How the fuel flow rises and falls: a trapezoid, or a table of time and relative flow."""

    ramp_s: Annotated[float, Within(0.0, 1.0)] = 5e-5  # each, within the injection's duration
    table: tuple[tuple[float, float], ...] | None = None  # then neither ramp nor duration count

    @field_validator("table")
    @classmethod
    def _rising(
        cls, table: tuple[tuple[float, float], ...] | None
    ) -> tuple[tuple[float, float], ...] | None:
        if table is None:
            return None
        times, flows = [row[0] for row in table], [row[1] for row in table]
        if len(table) < 2 or times[0] < 0 or any(b <= a for a, b in pairwise(times)):
            raise ValueError("times must rise from 0 or later, and there must be two at least")
        if min(flows) < 0 or max(flows) <= 0:
            raise ValueError("no flow may be negative, and one must be above 0")
        return table


class FlowBox(Section):
    """Box of gas that is computed; closed, the injector hangs in it from above."""

    spacing_m: Annotated[float, Within(1e-4, 1e-2)] = 1e-3
    width_m: Length | None = None  # None: so that the spray fits in
    depth_m: Length | None = None  # below the injector; None: so that the spray fits in
    above_m: Annotated[float, Within(0.0, 1.0)] = 5e-3  # gas above the injector's tip


class LagrangianSpray(Section):
    """Parcels of droplets in a computed flow of gas, with exchange both ways."""

    model: Literal["lagrangian"] = "lagrangian"
    time_s: Annotated[float, Within(1e-5, 0.1)] = 0.95e-3
    injected_mass_kg: Annotated[float, Within(0.0, 1e-2)] = 10e-6
    injection_duration_s: Annotated[float, Within(1e-5, 1.0)] = 1.5e-3
    rate: InjectionRate = InjectionRate()
    injection_pressure_Pa: Annotated[float, Within(1e5, 5e8)] = 20e6
    hole_diameter_m: Annotated[float, Within(1e-6, 1e-2)] = 165e-6
    fuel: Annotated[str, Field(min_length=1, max_length=60)] = "n-heptane"
    fuel_temperature_K: Annotated[float, Within(180.0, 800.0)] = 370.0
    gas: Annotated[str, Field(min_length=1, max_length=60)] = "nitrogen"
    ambient: Ambient = Ambient()
    droplets: Droplets = NukiyamaTanasawa()
    droplets_per_parcel: Annotated[float, Within(1.0, 1e9)] = 1e4
    evaporation: Literal[
        "abramzon-sirignano", "spalding", "dukowicz", "dukowicz-log", "frolov-type", "none"
    ] = "abramzon-sirignano"
    box: FlowBox = FlowBox()
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    plumes: Plumes = EIGHT_PLUMES


class GridSpray(Section):
    """Optical coefficients on a regular grid, from an .npz file."""

    model: Literal["grid"] = "grid"
    file: Path


class CfdSpray(Section):
    """The result of a CFD code, in any of the formats that are read."""

    model: Literal["cfd"] = "cfd"
    file: Path
    # None: told by the file's name and content
    format: Literal["openfoam", "vtk", "ensight", "converge", "tables", "cldit"] | None = None
    mapping: Path | None = None  # names and units of fields, where they are not the format's own
    time_s: Annotated[float, Within(0.0, 1e3)] | None = None
    fuel_field: str = "C7H16"
    fuel_molar_mass_kg_mol: Annotated[float, Within(1e-3, 1.0)] = 0.100204
    cloud: str | None = None
    nozzle_m: Point | None = None  # in the case's coordinates; becomes the origin. None: inferred
    axis: Direction | None = None  # of the injection, "-y" or three numbers; becomes -z
    # radius of the ball over which a parcel's droplets are shared among points. None: one point
    spread_m: Annotated[float, Within(1e-7, 0.1)] | None = None
    spread_points: Annotated[int, Within(2, 1000)] = 16
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1


class EmptySpray(Section):
    """Nothing at all between camera and background."""

    model: Literal["none"] = "none"


Spray = Annotated[
    ConeSpray | LagrangianSpray | GridSpray | CfdSpray | EmptySpray, Field(discriminator="model")
]
