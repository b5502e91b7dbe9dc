"""Where the spray comes from: a model and its conditions, a grid, or a CFD result."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator

from cldit.scene.checks import Section, Within
from cldit.scene.sizes import Droplets, NukiyamaTanasawa
from cldit.scene.values import Angle, CaseTime, Direction, Fraction, Length, Point


class Ambient(Section):
    """The gas of the vessel before injection."""

    pressure_Pa: Annotated[float, Within(1e3, 2e7)] = 0.6e6
    """Of the gas."""
    temperature_K: Annotated[float, Within(200.0, 2000.0)] = 570.0
    """Of the gas."""


class Plume(Section):
    """One hole of the injector: where its plume points."""

    inclination_deg: Annotated[float, Within(0.0, 89.0)]
    """From the injector's axis, -z."""
    azimuth_deg: Angle
    """About the axis, from +x towards +y."""
    cone_angle_deg: Annotated[float, Within(0.5, 120.0)] = 22.0
    """Full angle of the plume."""
    mass_fraction: Annotated[float, Within(1e-6, 1e6)] = 1.0
    """Share of the fuel, relative to the other plumes."""


def _some(plumes: tuple[Plume, ...]) -> tuple[Plume, ...]:
    if not 1 <= len(plumes) <= 64:
        raise ValueError(f"{len(plumes)} plumes, allowed is 1..64")
    return plumes


Plumes = Annotated[tuple[Plume, ...], AfterValidator(_some)]


EIGHT_PLUMES = tuple(
    Plume(inclination_deg=33.0, azimuth_deg=22.5 + 45.0 * hole) for hole in range(8)
)


Deposit = Literal["kernel", "points"]


class ConeSpray(Section):
    """Analytic plumes: mixing-limited evaporation in quasi-steady jets."""

    model: Literal["cone"] = "cone"
    """Analytic plumes."""
    time_s: Annotated[float, Within(1e-5, 0.1)] = 0.95e-3
    """After the start of injection."""
    injected_mass_kg: Annotated[float, Within(0.0, 1e-2)] = 10e-6
    """Of the whole injection."""
    injection_duration_s: Annotated[float, Within(1e-5, 1.0)] = 1.5e-3
    """From the first fuel to the last."""
    injection_pressure_Pa: Annotated[float, Within(1e5, 5e8)] = 20e6
    """In the injector."""
    hole_diameter_m: Annotated[float, Within(1e-6, 1e-2)] = 165e-6
    """Of each hole."""
    fuel: Literal["n-heptane", "methane"] = "n-heptane"
    """The liquid and its vapour."""
    fuel_temperature_K: Annotated[float, Within(180.0, 535.0)] = 370.0
    """As it leaves the hole."""
    ambient: Ambient = Ambient()
    """The gas of the vessel."""
    droplets: Droplets | None = NukiyamaTanasawa()
    """Sizes at the hole; null: vapour alone."""
    evaporation: bool = True
    """Whether droplets evaporate."""
    size_classes: Annotated[int, Within(1, 64)] | None = None
    """Classes of equal mass that stand for the sizes of a cell's droplets; left out: 4, or as many
    as `transport.accuracy_K` needs."""
    spacing_m: Annotated[float, Within(1e-5, 1e-2)] | None = None
    """Edge of the cells, which droplets and vapour fill evenly; left out: 0.5 mm, or as small as
    `transport.accuracy_K` needs."""
    parcels_per_cell: Annotated[int, Within(1, 1000)] | None = None
    """Without effect, accepted in scenes of older versions: see `size_classes`."""
    seed: Annotated[int, Within(0, 2**31 - 1)] | None = None
    """Without effect, accepted in scenes of older versions: nothing is drawn at random."""
    plumes: Plumes = EIGHT_PLUMES
    """One for each hole, 1 to 64."""

    @property
    def classes(self) -> int:
        """`size_classes`; where it is left out and nobody chooses, 4."""
        return 4 if self.size_classes is None else self.size_classes

    @property
    def lattice_m(self) -> float:
        """`spacing_m`; where it is left out and nobody chooses, 0.5 mm."""
        return 0.5e-3 if self.spacing_m is None else self.spacing_m


class InjectionRate(Section):
    """How the fuel flow rises and falls: a trapezoid, or a table of time and relative flow."""

    ramp_s: Annotated[float, Within(0.0, 1.0)] = 5e-5
    """Rise and fall each, within the injection's duration."""
    table: tuple[tuple[float, float], ...] | None = None
    """Pairs of time (s) and relative flow; then neither ramp nor duration count."""

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
    """Edge of the cells of gas."""
    width_m: Length | None = None
    """In x and y; left out: so that the spray fits in."""
    depth_m: Length | None = None
    """Below the injector; left out: so that the spray fits in."""
    above_m: Annotated[float, Within(0.0, 1.0)] = 5e-3
    """Gas above the injector's tip."""


class LagrangianSpray(Section):
    """Parcels of droplets in a computed flow of gas, with exchange both ways."""

    model: Literal["lagrangian"] = "lagrangian"
    """A computed spray."""
    time_s: Annotated[float, Within(1e-5, 0.1)] = 0.95e-3
    """After the start of injection."""
    injected_mass_kg: Annotated[float, Within(0.0, 1e-2)] = 10e-6
    """Of the whole injection."""
    injection_duration_s: Annotated[float, Within(1e-5, 1.0)] = 1.5e-3
    """From the first fuel to the last."""
    rate: InjectionRate = InjectionRate()
    """How the flow rises and falls."""
    injection_pressure_Pa: Annotated[float, Within(1e5, 5e8)] = 20e6
    """In the injector."""
    hole_diameter_m: Annotated[float, Within(1e-6, 1e-2)] = 165e-6
    """Of each hole."""
    fuel: Annotated[str, Field(min_length=1, max_length=60)] = "n-heptane"
    """iso-octane, or a fluid of CoolProp made of C, H and O that has transport properties."""
    fuel_temperature_K: Annotated[float, Within(180.0, 800.0)] = 370.0
    """As it leaves the hole."""
    gas: Annotated[str, Field(min_length=1, max_length=60)] = "nitrogen"
    """Gas of the vessel, a fluid of CoolProp."""
    ambient: Ambient = Ambient()
    """Its state before injection."""
    droplets: Droplets = NukiyamaTanasawa()
    """Sizes at the hole; breakup is not computed."""
    droplets_per_parcel: Annotated[float, Within(1.0, 1e9)] = 1e4
    """Droplets of mean mass that a parcel stands for; all parcels start with the same mass."""
    evaporation: Literal[
        "abramzon-sirignano", "spalding", "dukowicz", "dukowicz-log", "frolov-type", "none"
    ] = "abramzon-sirignano"
    """Model of single droplets (docs/spray.md)."""
    box: FlowBox = FlowBox()
    """The gas that is computed."""
    deposit: Deposit = "kernel"
    """Droplets as clouds as wide as parcels are apart, or each parcel in one cell."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Of sizes, directions and eddies."""
    plumes: Plumes = EIGHT_PLUMES
    """One for each hole, 1 to 64."""


class GridSpray(Section):
    """Optical coefficients on a regular grid, from an .npz file."""

    model: Literal["grid"] = "grid"
    """Coefficients of your own."""
    file: Path
    """.npz of `origin_m`, `spacing_m` and coefficients in 1/m, relative to the scene."""


class Sector(Section):
    """A part of a turn: what turns of `angle_deg` make whole."""

    angle_deg: Annotated[float, Within(0.5, 360.0)]
    """Of the mesh; a whole number of them makes 360 degrees."""
    centre_m: Point | None = None
    """A point of the axis of turns, in the case's coordinates; left out: the nozzle."""
    axis: Direction | None = None
    """Of the turns; left out: that of the injection."""

    @field_validator("angle_deg")
    @classmethod
    def _whole(cls, angle_deg: float) -> float:
        copies = 360.0 / angle_deg
        if abs(copies - round(copies)) > 1e-3 * copies:
            raise ValueError(f"{angle_deg:g} degrees do not divide 360")
        return angle_deg


class CfdSpray(Section):
    """The result of a CFD code, in any of the formats that are read."""

    model: Literal["cfd"] = "cfd"
    """The result of a CFD code."""
    file: Path
    """Case folder or file, relative to the scene (docs/importing.md)."""
    format: (
        Literal["openfoam", "vtk", "ensight", "converge", "fluent", "cgns", "tables", "cldit"]
        | None
    ) = None
    """Of the case; left out: told by the file's name and content."""
    mapping: Path | None = None
    """YAML file of names and units of fields that are not the format's own."""
    time_s: CaseTime | None = None
    """Which of the case's times, in its own unit (s, or crank angle); `latest`; `nearest 0.001`."""
    region: str | None = None
    """Which mesh region of an OpenFOAM case, where there are several."""
    fuel_field: str = "C7H16"
    """Cell field of the fuel's mass fraction."""
    fuel_molar_mass_kg_mol: Annotated[float, Within(1e-3, 1.0)] = 0.100204
    """Of the fuel; n-heptane's where left out."""
    cloud: str | None = None
    """Which cloud of parcels, where there are several; `none`: gas alone, by choice."""
    parcels_left_out: Fraction = 0.01
    """Largest share of the parcels that may be left out as impossible."""
    sector: Sector | None = None
    """The mesh is this part of a turn about the axis, and is completed; 360: it is whole."""
    symmetry: tuple[Literal["x", "y", "z"], ...] | None = None
    """Normals of the planes through the nozzle at which the case is mirrored; []: it is whole."""
    nozzle_m: Point | None = None
    """In the case's coordinates, becomes the origin; left out: inferred."""
    axis: Direction | None = None
    """Direction of the injection, `-y` or three numbers, becomes -z; left out: inferred."""
    deposit: Deposit | None = None
    """Droplets as clouds as wide as parcels are apart, or each parcel in one cell; left out:
    kernel, or points with `spread_m`."""
    spread_m: Annotated[float, Within(1e-7, 0.1)] | None = None
    """Radius of the ball over which a parcel's droplets are shared among points; left out: one
    point."""
    spread_points: Annotated[int, Within(2, 1000)] = 16
    """Points in that ball."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Of these points."""


class EmptySpray(Section):
    """Nothing at all between camera and background."""

    model: Literal["none"] = "none"
    """Nothing."""


Spray = Annotated[
    ConeSpray | LagrangianSpray | GridSpray | CfdSpray | EmptySpray, Field(discriminator="model")
]
