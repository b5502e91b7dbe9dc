"""The spray: a model with its conditions, a grid of coefficients, or a CFD result."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, field_validator

from cldit.constants import HEPTANE_MOLAR_MASS_kg_mol
from cldit.scene.checks import Former, Section, Within, length
from cldit.scene.sizes import Droplets, NukiyamaTanasawa
from cldit.scene.values import Angle, CaseTime, Direction, Fraction, Length, Point


class Ambient(Section):
    """The gas of the vessel before injection."""

    pressure_Pa: Annotated[float, Within(1e3, 2e7)] = 0.6e6
    """Pressure."""
    temperature_K: Annotated[float, Within(200.0, 2000.0)] = 570.0
    """Temperature."""


class Plume(Section):
    """Direction and share of the plume from one hole of the injector."""

    inclination_deg: Annotated[float, Within(0.0, 89.0)]
    """Angle between the plume and the injector axis, -z."""
    azimuth_deg: Angle
    """Angle about the injector axis, from +x towards +y."""
    cone_angle_deg: Annotated[float, Within(0.5, 120.0)] = 22.0
    """Full angle of the plume."""
    mass_fraction: Annotated[float, Within(1e-6, 1e6)] = 1.0
    """Share of the fuel mass, relative to the other plumes."""


Plumes = Annotated[tuple[Plume, ...], length(1, 64, "plumes")]
EIGHT_PLUMES = tuple(
    Plume(inclination_deg=33.0, azimuth_deg=22.5 + 45.0 * hole) for hole in range(8)
)
Deposit = Literal["kernel", "points"]


class Scatter(Section):
    """Differences between injections, as standard deviations, and the number of injections.

    Models other than cone and lagrangian take `optical_depth` and `length_m` alone.
    """

    optical_depth: Annotated[float, Within(0.0, 1.0)] = 0.03
    """Relative scatter of the optical depth that the simulated rig adds to every injection."""
    length_m: Annotated[float, Within(1e-5, 1.0)] = 4e-3
    """Correlation length of that scatter in the image."""
    members: Annotated[int, Within(1, 1000)] = 1
    """Number of simulated injections; the image is their mean. 1: the nominal one."""
    start_s: Annotated[float, Within(0.0, 0.01)] = 0.0
    """Start of injection."""
    duration_s: Annotated[float, Within(0.0, 0.1)] = 0.0
    """Duration of injection; the mass stays."""
    mass: Annotated[float, Within(0.0, 0.5)] = 0.0
    """Injected mass, relative."""
    direction_deg: Annotated[float, Within(0.0, 20.0)] = 0.0
    """Direction of each plume, in either of two planes."""
    cone_angle_deg: Annotated[float, Within(0.0, 20.0)] = 0.0
    """Cone angle of each plume."""
    fuel_temperature_K: Annotated[float, Within(0.0, 100.0)] = 0.0
    """Fuel temperature."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Random seed of the injections."""

    @property
    def traced(self) -> dict[str, float]:
        """The deviations that make other sprays, without those that are 0."""
        names = [name for name in type(self).model_fields if name not in _UNTRACED]
        return {name: value for name in names if (value := getattr(self, name)) > 0.0}


_UNTRACED = ("optical_depth", "length_m", "members", "seed")


def _optical(scatter: Scatter) -> Scatter:
    """Refuses deviations of sprays that are not computed."""
    for name in ("members",) * (scatter.members > 1) + tuple(scatter.traced):
        raise ValueError(
            f"{name}: {getattr(scatter, name):g}, but this spray is not computed; allowed: "
            "optical_depth and length_m, or spray.model cone or lagrangian"
        )
    return scatter


OpticalScatter = Annotated[Scatter, AfterValidator(_optical)]


class ConeSpray(Section):
    """Analytic plumes: mixing-limited evaporation in quasi-steady jets."""

    model: Literal["cone"] = "cone"
    """Name of the model."""
    time_s: Annotated[float, Within(1e-5, 0.1)] = 0.95e-3
    """Time after the start of injection."""
    injected_mass_kg: Annotated[float, Within(0.0, 1e-2)] = 10e-6
    """Fuel mass of the whole injection."""
    injection_duration_s: Annotated[float, Within(1e-5, 1.0)] = 1.5e-3
    """Time from the first fuel to the last."""
    injection_pressure_Pa: Annotated[float, Within(1e5, 5e8)] = 20e6
    """Fuel pressure in the injector."""
    hole_diameter_m: Annotated[float, Within(1e-6, 1e-2)] = 165e-6
    """Diameter of each hole."""
    fuel: Literal["n-heptane"] = "n-heptane"
    """Fuel of liquid and vapour."""
    fuel_temperature_K: Annotated[float, Within(180.0, 535.0)] = 370.0
    """Fuel temperature at the hole."""
    ambient: Ambient = Ambient()
    """The gas of the vessel."""
    droplets: Droplets = NukiyamaTanasawa()
    """Droplet size distribution at the hole."""
    evaporation: bool = True
    """Evaporation of the droplets."""
    size_classes: Annotated[int, Within(1, 64)] | None = None
    """Number of droplet size classes of equal mass in a cell. Default: chosen by the run, or 4."""
    spacing_m: Annotated[float, Within(1e-5, 1e-2)] | None = None
    """Edge of the cells, which are uniform. Default: chosen by the run, or 0.5 mm."""
    parcels_per_cell: Annotated[int, Within(1, 1000)] | None = None
    """No effect (scenes of 0.1.0)."""
    seed: Annotated[int, Within(0, 2**31 - 1)] | None = None
    """No effect (scenes of 0.1.0)."""
    plumes: Plumes = EIGHT_PLUMES
    """Plumes, one per hole, 1 to 64."""
    scatter: Scatter = Scatter()
    """Differences between injections."""

    @property
    def classes(self) -> int:
        """`size_classes`, or 4 if it is neither given nor chosen."""
        return 4 if self.size_classes is None else self.size_classes

    @property
    def lattice_m(self) -> float:
        """`spacing_m`, or 0.5 mm if it is neither given nor chosen."""
        return 0.5e-3 if self.spacing_m is None else self.spacing_m


Rate = tuple[tuple[float, float], ...]
RAMP_S = 5e-5  # of a needle, rise time and fall time


def _table(value: object) -> object:
    """The pairs of a rate; older versions had a section with `table` or `ramp_s`."""
    if not isinstance(value, dict):
        return value
    if value.get("table") is None and value.get("ramp_s", RAMP_S) != RAMP_S:
        raise ValueError("ramp_s: no key of this version; give pairs of time and flow")
    return value.get("table")


def _rising(table: Rate | None) -> Rate | None:
    times, flows = zip(*(table or ((0.0, 1.0), (1.0, 1.0))), strict=True)
    if len(times) < 2 or times[0] < 0 or any(b <= a for a, b in pairwise(times)):
        raise ValueError("times must rise from 0 or later; allowed: two rows or more")
    if min(flows) < 0 or max(flows) <= 0:
        raise ValueError("flows must not be negative, and one must be above 0")
    return table


class FlowBox(Section):
    """Closed space of rays from the injector tip, in which the gas flow is computed."""

    _former: ClassVar[Former] = {
        "above_m": (5e-3, "the tip is a wall"),
        "width_m": (None, "use depth_m, half of it or more"),
    }

    spacing_m: Annotated[float, Within(1e-4, 1e-2)] | None = None
    """Edge of the gas cells 25 mm from the tip. Default: chosen by the run, or 1 mm."""
    depth_m: Length | None = None
    """Radius of the space. Default: deep enough for the spray."""

    @property
    def cell_m(self) -> float:
        """The spacing, or that without a choice."""
        return 1e-3 if self.spacing_m is None else self.spacing_m


class LagrangianSpray(Section):
    """Droplet parcels in a computed gas flow, with two-way coupling."""

    model: Literal["lagrangian"] = "lagrangian"
    """Name of the model."""
    time_s: Annotated[float, Within(1e-5, 0.1)] = 0.95e-3
    """Time after the start of injection."""
    injected_mass_kg: Annotated[float, Within(0.0, 1e-2)] = 10e-6
    """Fuel mass of the whole injection."""
    injection_duration_s: Annotated[float, Within(1e-5, 1.0)] = 1.5e-3
    """Time from the first fuel to the last."""
    rate: Annotated[Rate | None, BeforeValidator(_table), AfterValidator(_rising)] = None
    """Pairs of time (s) and relative flow. Default: a trapezoid with ramps of 50 us."""
    injection_pressure_Pa: Annotated[float, Within(1e5, 5e8)] = 20e6
    """Fuel pressure in the injector."""
    hole_diameter_m: Annotated[float, Within(1e-6, 1e-2)] = 165e-6
    """Diameter of each hole."""
    fuel: Annotated[str, Field(min_length=1, max_length=60)] = "n-heptane"
    """iso-octane, or a CoolProp fluid of C, H and O with transport properties."""
    fuel_temperature_K: Annotated[float, Within(180.0, 800.0)] = 370.0
    """Fuel temperature at the hole."""
    gas: Annotated[str, Field(min_length=1, max_length=60)] = "nitrogen"
    """Gas of the vessel, a CoolProp fluid."""
    ambient: Ambient = Ambient()
    """State of the gas before injection."""
    droplets: Droplets | None = NukiyamaTanasawa()
    """Droplet size distribution at the hole; breakup is not computed. null: the fuel is a gas."""
    droplets_per_parcel: Annotated[float, Within(1.0, 1e9)] = 1e4
    """Mean number of droplets per parcel; all parcels start with the same mass."""
    evaporation: Literal[
        "abramzon-sirignano", "spalding", "dukowicz", "dukowicz-log", "frolov-type", "none"
    ] = "abramzon-sirignano"
    """Evaporation model of single droplets (docs/spray.md)."""
    mixing_length: Annotated[float, Within(1e-3, 0.1)] = 0.018
    """Turbulence: mixing length of the eddies over the distance from the injector."""
    box: FlowBox = FlowBox()
    """The space in which the gas flow is computed, and its cells."""
    deposit: Deposit = "kernel"
    """`kernel`: droplets spread over the distance between parcels; `points`: each in one cell."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Random seed of sizes, directions and eddies."""
    plumes: Plumes = EIGHT_PLUMES
    """Plumes, one per hole, 1 to 64."""
    scatter: Scatter = Scatter()
    """Differences between injections."""

    def on_gas(self, spacing_m: float) -> "LagrangianSpray":
        """The spray on other cells of gas."""
        box = self.box.model_copy(update={"spacing_m": spacing_m})
        return self.model_copy(update={"box": box})


def gas_jet_of_0_1(spray: Mapping[str, Any]) -> dict[str, Any]:
    """A cone of methane, which versions before 0.2 had, as a computed jet of gas."""
    only = ("evaporation", "size_classes", "spacing_m", "parcels_per_cell", "seed")
    kept = {key: value for key, value in spray.items() if key not in only}
    end_s = kept.get("injection_duration_s", 1.5e-3)
    even = [[0.0, 1.0], [end_s, 1.0]]
    return {"rate": even, **kept, "model": "lagrangian", "droplets": None}


class GridSpray(Section):
    """Optical coefficients on a regular grid, from an .npz file."""

    model: Literal["grid"] = "grid"
    """Name of the model."""
    file: Path
    """.npz file of `origin_m`, `spacing_m` and coefficients in 1/m (docs/importing.md)."""
    scatter: OpticalScatter = Scatter()
    """Differences between injections."""


class Sector(Section):
    """Sector of a mesh, completed by rotation about an axis."""

    angle_deg: Annotated[float, Within(0.5, 360.0)]
    """Angle of the sector; 360 degrees divided by a whole number."""
    centre_m: Point | None = None
    """Point on the axis of rotation, in the case's coordinates. Default: the nozzle."""
    axis: Direction | None = None
    """Direction of the axis of rotation. Default: direction of injection."""

    @field_validator("angle_deg")
    @classmethod
    def _divides_circle(cls, angle_deg: float) -> float:
        copies = 360.0 / angle_deg
        if abs(copies - round(copies)) > 1e-3 * copies:
            raise ValueError(f"{angle_deg:g} degrees do not divide 360")
        return angle_deg


Check = Literal["times", "copies", "tracks", "summary", "cells", "liquids"]


class CfdSpray(Section):
    """Result of a CFD code."""

    _former: ClassVar[Former] = {
        key: (stored, "deposit: kernel spreads parcels over the distance between them")
        for key, stored in {"spread_m": None, "spread_points": 16, "seed": 1}.items()
    }

    model: Literal["cfd"] = "cfd"
    """Name of the model."""
    file: Path
    """Folder or file of the case, relative to the scene (docs/importing.md)."""
    format: (
        Literal[
            "openfoam", "vtk", "ensight", "converge", "fluent", "cgns", "amrex", "tables", "cldit"
        ]
        | None
    ) = None
    """Format of the case. Default: inferred from names and content of the files."""
    mapping: Path | None = None
    """YAML file with the names and units of fields (docs/importing.md)."""
    time_s: CaseTime | None = None
    """Time of the case in its own unit (s, or crank angle), `latest`, or `nearest 0.001`."""
    region: str | None = None
    """Mesh region, for OpenFOAM cases with several."""
    fuel_field: str = "C7H16"
    """Cell field of the fuel's mass fraction."""
    fuel_molar_mass_kg_mol: Annotated[float, Within(1e-3, 1.0)] = HEPTANE_MOLAR_MASS_kg_mol
    """Molar mass of the fuel. Default: by the formula in `fuel_field`."""
    cloud: str | None = None
    """Name of the parcel cloud, for cases with several; `none`: gas only."""
    parcels_left_out: Fraction = 0.01
    """Largest fraction of parcels that may be rejected as unphysical."""
    accept: tuple[Check, ...] = ()
    """Checks of the state whose findings become remarks (docs/importing.md)."""
    sector: Sector | None = None
    """Sector that the mesh covers, to be completed by rotation; 360: the mesh is complete."""
    symmetry: tuple[Literal["x", "y", "z"], ...] | None = None
    """Normals of the planes through the nozzle at which the case is mirrored; []: none."""
    nozzle_m: Point | None = None
    """Position of the nozzle in the case's coordinates, the new origin. Default: inferred."""
    axis: Direction | None = None
    """Direction of injection in the case, `-y` or three numbers, the new -z. Default: inferred."""
    deposit: Deposit | None = None
    """As in a computed spray. Default: `kernel`."""
    scatter: OpticalScatter = Scatter()
    """Differences between injections."""


class EmptySpray(Section):
    """No spray between camera and background."""

    model: Literal["none"] = "none"
    """Name of the model."""
    scatter: OpticalScatter = Scatter()
    """Differences between injections."""


Spray = Annotated[
    ConeSpray | LagrangianSpray | GridSpray | CfdSpray | EmptySpray, Field(discriminator="model")
]
