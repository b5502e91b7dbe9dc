"""What encloses the spray: the cube that is traced, background, walls, patches and windows."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from cldit.scene.checks import Section, Within
from cldit.scene.values import Direction, Length, Point, Temperature, WindowCurve

FINEST = 4096  # cells along an edge, at most
PAPER_LEAF_M = 0.5e-3  # paper, Section "Ray Tracing"


class Domain(Section):
    """The cube that is traced, and how finely the octree may divide it."""

    edge_m: Length = 0.20
    """Of the cube."""
    centre_m: Point = (0.0, 0.0, 0.0)
    """Of the cube; the injector's tip is at the origin."""
    rule: Literal["need", "paper"] = "need"
    """Cells as the medium needs them, or the paper's: of 0.5 mm wherever droplets are."""
    leaf_edge_m: Annotated[float, Within(1e-6, 100.0)] | None = None
    """Finest cells, at the most 4096 along an edge; left out: by the rule, and
    `transport.accuracy_K`."""
    optical_depth_split: Annotated[float, Within(0.0, 1.0)] = 1e-5
    """A cell of more optical depth than this is divided."""

    @property
    def leaf_m(self) -> float:
        """`leaf_edge_m`, or where that is left out the paper's 0.5 mm."""
        if self.leaf_edge_m is not None:
            return self.leaf_edge_m
        return PAPER_LEAF_M if self.rule == "paper" else max(PAPER_LEAF_M, self.edge_m / FINEST)

    @model_validator(mode="after")
    def _depth(self) -> Domain:
        if self.leaf_edge_m is None and self.rule == "need":
            return self  # what is chosen is never finer
        if self.edge_m / self.leaf_m > FINEST:
            given = "" if self.leaf_edge_m is not None else " (rule: paper)"
            raise ValueError(
                f"leaf_edge_m: {self.leaf_m:g}{given} is finer than edge_m / {FINEST} = "
                f"{self.edge_m / FINEST:g}"
            )
        return self


class Background(Section):
    """What is before the camera behind the spray: a disc that faces it, or all of the enclosure."""

    shape: Literal["disc", "enclosure"] = "disc"
    """A disc that faces the camera, or all of the enclosure."""
    radius_m: Length = 0.05
    """Of the disc."""
    centre_m: Point | None = None
    """Of the disc; the middle of the domain's face on +y where left out."""
    temperatures_K: tuple[Temperature, ...] = (400.0, 440.0, 480.0, 520.0, 560.0)
    """One set of shots before each, 1 to 1000."""
    emissivity: Annotated[float, Within(1e-3, 1.0)] = 1.0
    """What is left reflects its surroundings."""
    surroundings_K: Temperature | None = None
    """What it reflects; the walls' temperature where left out."""

    @field_validator("temperatures_K")
    @classmethod
    def _two(cls, temperatures: tuple[float, ...]) -> tuple[float, ...]:
        if not 1 <= len(temperatures) <= 1000:
            raise ValueError(f"{len(temperatures)} temperatures, allowed is 1..1000")
        return temperatures


class Walls(Section):
    """The rest of the enclosure, a black body at one temperature."""

    temperature_K: Temperature = 300.0
    """Of the black walls."""


class Patch(Section):
    """A plane piece of the enclosure with a temperature and a weight of its own, by its name.

    A window through which the laboratory is seen, a heated flange. `facing` is where its front
    looks; from behind it is not seen. Of patches and background disc, a line sees the nearest; of
    those in one plane the background first, then the patch that is named first.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
    """Of its weight, weights/NAME.tif."""
    shape: Literal["disc", "rectangle"] = "disc"
    """Of the piece."""
    centre_m: Point
    """Its middle."""
    facing: Direction
    """Where its front looks, `-y` or three numbers."""
    radius_m: Length | None = None
    """Of a disc."""
    size_m: tuple[Length, Length] | None = None
    """Of a rectangle: width, and height along z."""
    temperature_K: Temperature
    """Of its surface."""
    emissivity: Annotated[float, Within(1e-3, 1.0)] = 1.0
    """What is left reflects the walls."""

    @model_validator(mode="after")
    def _fits(self) -> Patch:
        wanted, other = ("radius_m", "size_m")[:: 1 if self.shape == "disc" else -1]
        if getattr(self, wanted) is None or getattr(self, other) is not None:
            raise ValueError(f"shape: {self.shape} takes {wanted}, and no {other}")
        return self


_TAKEN = ("background", "wall", "vapour", "liquid")


def _names_differ(patches: tuple[Patch, ...]) -> tuple[Patch, ...]:
    for name, count in Counter([*_TAKEN, *(patch.name for patch in patches)]).items():
        if count > 1:
            raise ValueError(
                f"the name {name} is there more than once; allowed are names that differ, and none "
                f"of {', '.join(_TAKEN)}"
            )
    if len(patches) > 16:
        raise ValueError(f"{len(patches)} patches, allowed is 0..16")
    return patches


Patches = Annotated[tuple[Patch, ...], AfterValidator(_names_differ)]


class Window(Section):
    """A plane window that fills what the camera sees (front) or the background (rear).

    Uncoated of a known material, or as its table says.
    """

    side: Literal["front", "rear"]
    """Before the camera, or before the background."""
    material: Literal["CaF2", "sapphire"] | None = None
    """Says transmission and emission over the wavelength; or give both curves."""
    transmission: WindowCurve | None = None
    """Measured, of the whole plate, coatings included: pairs of um and share, or a file of both."""
    reflection: WindowCurve | None = None
    """The same of what the plate reflects; the rest it absorbs and emits."""
    thickness_m: Annotated[float, Within(1e-5, 0.2)] = 0.01
    """Of the plate."""
    temperature_K: Temperature = 300.0
    """Of the plate."""

    @model_validator(mode="after")
    def _material_or_table(self) -> Self:
        curves = [one for one in (self.transmission, self.reflection) if one is not None]
        if len(curves) != (0 if self.material else 2):
            raise ValueError(
                f"{self.side} window: material or curves; allowed is a material, or both "
                "transmission and reflection"
            )
        if curves:
            wavelengths = sorted({um for curve in curves for um, _ in curve})
            both = np.zeros(len(wavelengths))
            for curve in curves:
                known_um, share = np.array(curve, float).T
                both += np.interp(np.array(wavelengths), known_um, share, left=0.0, right=0.0)
            if np.max(both) > 1.0 + 1e-6:
                raise ValueError(
                    f"{self.side} window: transmission and reflection add up to "
                    f"{np.max(both):.3f}; allowed is 1 at most"
                )
        return self


def one_window_a_side(windows: tuple[Window, ...]) -> tuple[Window, ...]:
    """Raises ValueError where a side has two windows."""
    sides = [window.side for window in windows]
    if len(set(sides)) < len(sides):
        raise ValueError(f"sides {', '.join(sides)}; allowed are one front and one rear window")
    return windows


Windows = Annotated[tuple[Window, ...], AfterValidator(one_window_a_side)]
