"""What a scene is: frozen data with a range, a unit and a default for every key.

The defaults are the paper's numbers where it gives them (Section "Ray Tracing"); the sensor's are
typical of a cooled 640 x 512 InSb camera and are assumptions.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from cldit.errors import SceneError
from cldit.scene.checks import Section, Within
from cldit.scene.curves import LONGEST_UM, SHORTEST_UM, Curve, check_curve, read_curve

Length = Annotated[float, Within(1e-6, 100.0)]
Coordinate = Annotated[float, Within(-100.0, 100.0)]
Temperature = Annotated[float, Within(0.0, 5000.0)]
Pixels = Annotated[int, Within(1, 16384)]
Fraction = Annotated[float, Within(0.0, 1.0)]
Angle = Annotated[float, Within(-360.0, 360.0)]
Point = tuple[Coordinate, Coordinate, Coordinate]


def _direction(value: object) -> object:
    """`-y` as three numbers; other text is refused."""
    if not isinstance(value, str):
        return value
    if len(value) != 2 or value[0] not in "+-" or value[1] not in "xyz":
        raise ValueError(f"{value!r} is no direction; allowed is -x, +x .. +z, or three numbers")
    sign = 1.0 if value[0] == "+" else -1.0
    return tuple(sign if name == value[1] else 0.0 for name in "xyz")


def _not_zero(value: Point) -> Point:
    if math.hypot(*value) < 1e-9:
        raise ValueError(f"{value} has no length; allowed is -x, +x .. +z, or three numbers")
    return value


Direction = Annotated[Point, BeforeValidator(_direction), AfterValidator(_not_zero)]


Wavelength = Annotated[float, Within(SHORTEST_UM, LONGEST_UM)]
_CURVE_FORMS = "a list of [wavelength_um, value], or a text file of both"


def _in_folder(file: str | Path, info: ValidationInfo) -> Path:
    """Relative paths start in the folder of the file that holds them."""
    folder = (info.context or {}).get("folder")
    return Path(file) if folder is None else (Path(folder) / file).resolve()


def _curve(value: object, info: ValidationInfo) -> object:
    """Reads a curve from its file, and checks one given as pairs; numbers are left alone."""
    try:
        if isinstance(value, (str, Path)):
            return read_curve(_in_folder(value, info))
        if isinstance(value, (list, tuple)) and value and isinstance(value[0], (list, tuple)):
            return check_curve(value, what="curve")
    except SceneError as error:
        raise ValueError(str(error)) from error
    return value


def _curve_or_numbers(value: object) -> str:
    pairs = isinstance(value, tuple) and bool(value) and isinstance(value[0], tuple)
    return "[curve]" if pairs else "[numbers]"


Filter = Annotated[
    Annotated[Curve, Tag("[curve]")] | Annotated[tuple[Wavelength, Wavelength], Tag("[numbers]")],
    Discriminator(_curve_or_numbers),
    BeforeValidator(_curve),
]
QuantumEfficiency = Annotated[
    Annotated[Curve, Tag("[curve]")] | Annotated[float, Within(1e-3, 1.0), Tag("[numbers]")],
    Discriminator(_curve_or_numbers),
    BeforeValidator(_curve),
]


def _material(value: object, info: ValidationInfo) -> object:
    """The name of a substance, or the full path of a table."""
    if isinstance(value, str) and Path(value).suffix:
        return str(_in_folder(value, info))
    return value


Material = Annotated[str, Field(min_length=1), BeforeValidator(_material)]


class Domain(Section):
    """The cube that is traced, and how finely the octree may divide it."""

    edge_m: Length = 0.20
    centre_m: Point = (0.0, 0.0, 0.0)
    leaf_edge_m: Annotated[float, Within(1e-6, 100.0)] = 0.5e-3
    optical_depth_split: Annotated[float, Within(0.0, 1.0)] = 1e-5

    @model_validator(mode="after")
    def _depth(self) -> Domain:
        if self.edge_m / self.leaf_edge_m > 4096:
            raise ValueError(
                f"leaf_edge_m: {self.leaf_edge_m:g} is finer than edge_m / 4096 = "
                f"{self.edge_m / 4096:g}"
            )
        return self


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


class NukiyamaTanasawa(Section):
    """f(D) ~ D^p exp(-(D/m)^n), paper Eq. (5)."""

    m_um: Annotated[float, Within(1e-3, 1e3)] = 1.5
    n: Annotated[float, Within(0.05, 20.0)] = 1.0
    p: Annotated[float, Within(-0.9, 50.0)] = 3.0


class Monodisperse(Section):
    """Every droplet leaves the nozzle with this diameter."""

    diameter_um: Annotated[float, Within(1e-2, 1e3)]


class LogNormal(Section):
    """ln D is normal: numbers of droplets by their median, `sigma` the geometric deviation."""

    median_um: Annotated[float, Within(1e-3, 1e3)]
    sigma: Annotated[float, Within(1.001, 10.0)]


class RosinRammler(Section):
    """The mass in droplets above D is exp(-(D/d)^q)."""

    d_um: Annotated[float, Within(1e-3, 1e3)]
    q: Annotated[float, Within(1.01, 20.0)]  # at 1 and below, D32 is 0


class Histogram(Section):
    """Numbers of droplets between edges, even within each; of any scale."""

    edges_um: tuple[Annotated[float, Within(0.0, 1e4)], ...]
    number: tuple[Annotated[float, Within(0.0, 1e30)], ...]

    @model_validator(mode="after")
    def _fits(self) -> Histogram:
        if len(self.edges_um) != len(self.number) + 1 or not 1 <= len(self.number) <= 1000:
            raise ValueError(
                f"number: {len(self.number)} values for {len(self.edges_um)} edges; allowed are "
                "1..1000, one less than edges_um"
            )
        if any(low >= high for low, high in pairwise(self.edges_um)):
            raise ValueError("edges_um: must rise")
        if not any(self.number):
            raise ValueError("number: holds no droplets")
        return self


_KINDS: dict[str, type[Section]] = {  # by a key that only one of them has
    "diameter_um": Monodisperse,
    "median_um": LogNormal,
    "d_um": RosinRammler,
    "edges_um": Histogram,
}


def _distribution(value: object) -> str | None:
    """Which kind of sizes a scene means, by the keys that it gives."""
    for key, kind in _KINDS.items():
        if isinstance(value, kind) or (isinstance(value, dict) and key in value):
            return kind.__name__
    return "NukiyamaTanasawa" if isinstance(value, (dict, NukiyamaTanasawa)) else None


Droplets = Annotated[
    Annotated[NukiyamaTanasawa, Tag("NukiyamaTanasawa")]
    | Annotated[Monodisperse, Tag("Monodisperse")]
    | Annotated[LogNormal, Tag("LogNormal")]
    | Annotated[RosinRammler, Tag("RosinRammler")]
    | Annotated[Histogram, Tag("Histogram")],
    Discriminator(
        _distribution,
        custom_error_type="not_allowed",
        custom_error_message=(
            "is no size distribution; allowed: {m_um, n, p}, {diameter_um}, {median_um, sigma}, "
            "{d_um, q}, {edges_um, number} or null"
        ),
    ),
]


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


class Sensor(Section):
    """The infrared camera's chip. Pitch, f-number, well, read noise: typical, not measured."""

    pixels: tuple[Pixels, Pixels] = (640, 512)
    pitch_m: Annotated[float, Within(1e-6, 1e-3)] = 15e-6
    f_number: Annotated[float, Within(0.5, 64.0)] = 2.5
    quantum_efficiency: QuantumEfficiency = 0.8  # a number, or a curve
    # None: 25 us (paper, Fig. 6), or less where the scene's brightest pixel would saturate
    integration_time_s: Annotated[float, Within(320e-9, 1.0)] | None = None
    well_electrons: Annotated[float, Within(1e2, 1e9)] = 7e6
    electrons_per_count: Annotated[float, Within(1e-3, 1e6)] = 40.0
    offset_counts: Annotated[float, Within(0.0, 65535.0)] = 200.0
    read_noise_electrons: Annotated[float, Within(0.0, 1e6)] = 200.0
    bits: Annotated[int, Within(8, 16)] = 14
    bad_pixels: Annotated[int, Within(0, 100_000)] = 20


class Camera(Section):
    """Stands on -y of its target and looks along +y; image right is +x, image up is +z."""

    model: Literal["pinhole", "orthographic"] = "pinhole"
    distance_m: Annotated[float, Within(1e-3, 1e3)] = 1.0
    field_m: tuple[Length, Length] = (0.16, 0.16)  # width, height in the plane of the target
    pixels: tuple[Pixels, Pixels] = (1000, 1000)  # columns, rows: one ray each
    target_m: Point | None = None  # the middle of the picture; the domain's centre where left out
    surroundings_K: Temperature = 295.0  # what a front window reflects into the camera
    sensor: Sensor = Sensor()

    @field_validator("pixels", mode="before")
    @classmethod
    def _square(cls, value: object) -> object:
        return (value, value) if isinstance(value, int) else value


class Background(Section):
    """What is before the camera behind the spray: a disc that faces it, or all of the enclosure."""

    shape: Literal["disc", "enclosure"] = "disc"
    radius_m: Length = 0.05
    centre_m: Point | None = None  # the middle of the domain's face on +y where left out
    temperatures_K: tuple[Temperature, ...] = (400.0, 440.0, 480.0, 520.0, 560.0)
    emissivity: Annotated[float, Within(1e-3, 1.0)] = 1.0
    surroundings_K: Temperature | None = None  # what it reflects; the walls where left out

    @field_validator("temperatures_K")
    @classmethod
    def _two(cls, temperatures: tuple[float, ...]) -> tuple[float, ...]:
        if not 1 <= len(temperatures) <= 1000:
            raise ValueError(f"{len(temperatures)} temperatures, allowed is 1..1000")
        return temperatures


class Walls(Section):
    """The rest of the enclosure, a black body at one temperature."""

    temperature_K: Temperature = 300.0


class Window(Section):
    """An uncoated plane window that fills what the camera sees (front) or the background (rear)."""

    side: Literal["front", "rear"]
    material: Literal["CaF2", "sapphire"]
    thickness_m: Annotated[float, Within(1e-5, 0.2)] = 0.01
    temperature_K: Temperature = 300.0


def one_window_a_side(windows: tuple[Window, ...]) -> tuple[Window, ...]:
    """Raises ValueError where a side has two windows."""
    sides = [window.side for window in windows]
    if len(set(sides)) < len(sides):
        raise ValueError(f"sides {', '.join(sides)}; allowed are one front and one rear window")
    return windows


Windows = Annotated[tuple[Window, ...], AfterValidator(one_window_a_side)]


class Optics(Section):
    """What light the camera counts, and what the spray's optical properties are taken to be.

    `paper`: one wavelength, one refractive index, one vapour cross section, as in the paper's
    Section 2. `spectral`: of the liquid and the vapour over the filter, with as many wavelengths
    as `wavelengths` says or `spectral_error_K` (RMS, in T_app) needs.
    """

    preset: Literal["paper", "spectral"] = "paper"
    filter_um: Filter = (3.3, 3.5)  # two edges of a rectangle, or a curve
    wavelength_um: Wavelength = 3.4  # paper
    n: Annotated[float, Within(0.1, 10.0)] = 1.338  # paper
    k: Annotated[float, Within(0.0, 10.0)] = 0.0341  # paper
    vapour_m2_mol: Annotated[float, Within(0.0, 1e6)] = 50.0  # paper
    liquid: Material | None = None  # spectral: name or table; the spray's fuel where left out
    vapour: Material | None = None  # spectral: name or table; the spray's fuel where left out
    vapour_area_km_mol: Annotated[float, Within(1e-3, 1e5)] | None = None  # None: the default's
    wavelengths: Annotated[int, Within(1, 64)] | None = None  # None: chosen from the next
    spectral_error_K: Annotated[float, Within(1e-3, 100.0)] = 0.1
    compare_paper: bool = True  # spectral: trace the paper's properties too, and report by how much

    @model_validator(mode="after")
    def _ordered(self) -> Optics:
        if isinstance(self.filter_um[0], float) and self.filter_um[0] >= self.filter_um[1]:
            raise ValueError(
                f"filter_um: {self.filter_um[0]:g} to {self.filter_um[1]:g} is empty; "
                "allowed is a lower and a higher wavelength"
            )
        return self


def _parametric(value: object) -> str | None:
    return "HenyeyGreenstein" if isinstance(value, (dict, HenyeyGreenstein)) else None


class HenyeyGreenstein(Section):
    """A phase function by its mean cosine."""

    henyey_greenstein: Annotated[float, Within(-0.999, 0.999)]


Phase = Annotated[
    Annotated[Literal["isotropic", "mie"], Tag("name")]
    | Annotated[HenyeyGreenstein, Tag("HenyeyGreenstein")],
    Discriminator(
        lambda value: "name" if value in ("isotropic", "mie") else _parametric(value),
        custom_error_type="not_allowed",
        custom_error_message=(
            "is no phase function; allowed: isotropic, mie, {henyey_greenstein: g}"
        ),
    ),
]


class Transport(Section):
    """How the equation of transfer is solved."""

    method: Literal["source", "path", "branching"] = "source"
    order: Annotated[int, Within(0, 1000)] | None = None  # None: all; beyond it the wall is seen
    accuracy_K: Annotated[float, Within(1e-4, 100.0)] = 0.1
    max_samples: Annotated[int, Within(128, 10_000_000)] = 4096  # of `path`, a pixel
    phase: Phase = "isotropic"
    gather: bool = False  # `source`: gather the picture's scattered light by flights, not cells
    cutoff: Annotated[float, Within(0.0, 0.5)] = 1e-4
    directions: Annotated[int, Within(4, 4096)] | None = None  # None: chosen from accuracy_K
    precision: Literal["auto", "float32", "float64"] = "auto"
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1


class Rig(Section):
    """How the simulated rig behaves."""

    background_time_constant_s: Annotated[float, Within(0.0, 1e5)] = 120.0
    background_start_K: Temperature = 295.0
    shot_scatter: Annotated[float, Within(0.0, 1.0)] = 0.03  # relative, of the optical depth
    shot_scatter_length_m: Annotated[float, Within(1e-5, 1.0)] = 4e-3
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1


class PlanSize(Section):
    """How often the rig records at each background."""

    shots: Annotated[int, Within(1, 100_000)] = 5
    references: Annotated[int, Within(1, 100_000)] = 5


class Scene(Section):
    """Everything a run needs; `cldit.load_scene` reads it from YAML."""

    name: Annotated[str, Field(min_length=1, max_length=100)]
    description: str = ""
    domain: Domain = Domain()
    spray: Spray
    camera: Camera = Camera()
    background: Background = Background()
    walls: Walls = Walls()
    windows: Windows = ()
    optics: Optics = Optics()
    transport: Transport = Transport()
    rig: Rig = Rig()
    plan: PlanSize = PlanSize()

    @property
    def target_m(self) -> Point:
        """The point in the middle of the picture."""
        return self.domain.centre_m if self.camera.target_m is None else self.camera.target_m

    @property
    def background_centre_m(self) -> Point:
        """The middle of the background disc."""
        if self.background.centre_m is not None:
            return self.background.centre_m
        x, y, z = self.domain.centre_m
        return (x, y + self.domain.edge_m / 2, z)
