"""The traced cube and the boundary: background, walls, patches and windows."""

from collections import Counter
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from cldit.scene.checks import Section, Within, length
from cldit.scene.values import Backgrounds, Direction, Length, Point, Temperature, WindowCurve

FINEST = 4096  # cells along an edge, at most
PAPER_LEAF_M = 0.5e-3  # paper, Section "Ray Tracing"


class Domain(Section):
    """The traced cube and the resolution of its octree."""

    edge_m: Length = 0.20
    """Edge of the cube."""
    centre_m: Point = (0.0, 0.0, 0.0)
    """Centre of the cube; the injector tip is at the origin."""
    rule: Literal["need", "paper"] = "need"
    """Cell size: `need`, as the medium requires; `paper`, 0.5 mm wherever there are droplets."""
    leaf_edge_m: Annotated[float, Within(1e-6, 100.0)] | None = None
    """Largest edge of the finest cells, from `edge_m` / 4096. Default: by `rule` and accuracy."""
    optical_depth_split: Annotated[float, Within(0.0, 1.0)] = 1e-5
    """Optical depth of vapour above which a cell is divided."""

    @property
    def leaf_m(self) -> float:
        """`leaf_edge_m`, or the paper's 0.5 mm if it is not given."""
        if self.leaf_edge_m is not None:
            return self.leaf_edge_m
        return PAPER_LEAF_M if self.rule == "paper" else max(PAPER_LEAF_M, self.edge_m / FINEST)

    @model_validator(mode="after")
    def _depth(self) -> "Domain":
        if self.leaf_edge_m is None and self.rule == "need":
            return self  # what is chosen is never finer
        if self.edge_m / self.leaf_m > FINEST:
            note = "" if self.leaf_edge_m is not None else " (rule: paper)"
            raise ValueError(
                f"leaf_edge_m: {self.leaf_m:g}{note} is finer than edge_m / {FINEST} = "
                f"{self.edge_m / FINEST:g}"
            )
        return self


class Background(Section):
    """The black body behind the spray: a disc that faces the camera, or the whole enclosure."""

    shape: Literal["disc", "enclosure"] = "disc"
    """`disc`: a disc that faces the camera; `enclosure`: everything around the domain."""
    radius_m: Length = 0.05
    """Radius of the disc."""
    centre_m: Point | None = None
    """Centre of the disc. Default: centre of the domain's +y face."""
    temperatures_K: Backgrounds = (400.0, 440.0, 480.0, 520.0, 560.0)
    """Temperatures of the black body, 1 to 1000."""
    emissivity: Annotated[float, Within(1e-3, 1.0)] = 1.0
    """Emissivity of the black body; it reflects the rest from its surroundings."""
    surroundings_K: Temperature | None = None
    """Temperature of the surroundings that it reflects. Default: that of the walls."""


class Walls(Section):
    """The rest of the enclosure, a black body at one temperature."""

    temperature_K: Temperature = 300.0
    """Temperature of the walls."""


class Patch(Section):
    """A plane part of the enclosure with its own temperature and weight, such as a heated flange.

    It is visible from its front only. A line of sight sees the nearest; in one plane the disc is
    first, then patches in the order given.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
    """Name of the patch and of its weight, weights/NAME.tif."""
    centre_m: Point
    """Centre of the patch."""
    facing: Direction
    """Normal of its front side: `-y` or three numbers."""
    radius_m: Length | None = None
    """Radius of a disc; or `size_m`."""
    size_m: tuple[Length, Length] | None = None
    """Width, and height along z, of a rectangle."""
    temperature_K: Temperature
    """Temperature of its surface."""
    emissivity: Annotated[float, Within(1e-3, 1.0)] = 1.0
    """Emissivity of its surface; the rest of its radiance is reflected from the walls."""

    @model_validator(mode="before")
    @classmethod
    def _without_shape(cls, data: Any) -> Any:
        """Takes the key `shape` of older versions, which the size implies."""
        sizes = {"disc": "radius_m", "rectangle": "size_m"}
        if isinstance(data, dict) and sizes.get(str(data.get("shape"))) in data:
            return {key: value for key, value in data.items() if key != "shape"}
        return data

    @model_validator(mode="after")
    def _fits(self) -> "Patch":
        if (self.radius_m is None) == (self.size_m is None):
            number = "neither" if self.radius_m is None else "both"
            raise ValueError(f"{number} of radius_m and size_m; allowed: one of them")
        return self

    @property
    def shape(self) -> Literal["disc", "rectangle"]:
        """`disc` with a radius, else `rectangle`."""
        return "rectangle" if self.radius_m is None else "disc"


_TAKEN = ("background", "wall", "vapour", "liquid")


def _names_differ(patches: tuple[Patch, ...]) -> tuple[Patch, ...]:
    for name, count in Counter([*_TAKEN, *(patch.name for patch in patches)]).items():
        if count > 1:
            raise ValueError(
                f"the name {name} is used more than once; allowed: names that differ, and none of "
                f"{', '.join(_TAKEN)}"
            )
    return patches


Patches = Annotated[tuple[Patch, ...], AfterValidator(_names_differ), length(0, 16, "patches")]


class Window(Section):
    """A plane window across the whole field of view (front) or the whole background (rear).

    It is an uncoated plate of a known material, or described by two measured curves.
    """

    side: Literal["front", "rear"]
    """`front`: between camera and spray; `rear`: between spray and background."""
    material: Literal["CaF2", "sapphire"] | None = None
    """Material of an uncoated plate; alternatively give `transmission` and `reflection`."""
    transmission: WindowCurve | None = None
    """Measured transmission of the whole plate: pairs of wavelength (um) and value, or a file."""
    reflection: WindowCurve | None = None
    """Measured reflection, likewise; the plate absorbs and emits the remainder."""
    thickness_m: Annotated[float, Within(1e-5, 0.2)] = 0.01
    """Thickness of the plate."""
    temperature_K: Temperature = 300.0
    """Temperature of the plate."""

    @model_validator(mode="after")
    def _material_or_table(self) -> Self:
        curves = [curve for curve in (self.transmission, self.reflection) if curve is not None]
        if len(curves) != (0 if self.material else 2):
            raise ValueError(
                f"{self.side} window: material or curves; allowed: a material, or both "
                "transmission and reflection"
            )
        if curves:
            wavelengths = sorted({um for curve in curves for um, _ in curve})
            total = np.zeros(len(wavelengths))
            for curve in curves:
                node_um, share = np.array(curve, float).T
                total += np.interp(np.array(wavelengths), node_um, share, left=0.0, right=0.0)
            if np.max(total) > 1.0 + 1e-6:
                raise ValueError(
                    f"{self.side} window: transmission and reflection add up to "
                    f"{np.max(total):.3f}; allowed: 1 at most"
                )
        return self


def one_window_a_side(windows: tuple[Window, ...]) -> tuple[Window, ...]:
    """Returns the windows; raises ValueError if a side has two."""
    sides = [window.side for window in windows]
    if len(set(sides)) < len(sides):
        raise ValueError(f"sides {', '.join(sides)}; allowed: one front and one rear window")
    return windows


Windows = Annotated[tuple[Window, ...], AfterValidator(one_window_a_side)]
