"""Parts of a spray: seen by patches and by geometry, said, and made whole with their masses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cldit.cfd.mesh.elements import BoxMesh
from cldit.cfd.sectors import azimuth_span
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import notes_of, read, refused

HEIGHT_M = 8e-3
SET: dict[str, Any] = {"nozzle_m": (0.0, 0.0, HEIGHT_M), "axis": "-z"}


def sides(block: Any) -> dict[str, tuple[int, int]]:
    """Sorts the boundary faces by their side; first face and number of each."""
    inner = len(block.neighbour)
    lower = np.array([edge[0] for edge in block.edges])
    upper = np.array([edge[-1] for edge in block.edges])

    def side(face: tuple[int, ...]) -> str:
        corners = block.points[list(face)]
        for axis, name in enumerate("xyz"):
            for end, sign in ((lower, "-"), (upper, "+")):
                if np.allclose(corners[:, axis], end[axis]):
                    return f"{sign}{name}"
        raise AssertionError("a boundary face on no side")

    outer = list(zip(block.faces[inner:], block.owner[inner:], strict=True))
    outer.sort(key=lambda each: side(each[0]))
    block.faces[inner:] = [face for face, _ in outer]
    block.owner[inner:] = [owner for _, owner in outer]
    names = [side(face) for face, _ in outer]
    return {name: (inner + names.index(name), names.count(name)) for name in sorted(set(names))}


def boundary(case: Path, found: dict[str, tuple[int, int]], kinds: dict[str, str]) -> None:
    """The list of patches, each side one, of the types in `kinds`."""
    rows = "".join(
        f"s{name.replace('-', 'm').replace('+', 'p')} {{ type {kinds.get(name, 'wall')}; "
        f"nFaces {count}; startFace {start}; }}\n"
        for name, (start, count) in found.items()
    )
    file = case / "constant" / "polyMesh" / "boundary"
    head = "FoamFile { version 2.0; format ascii; class polyBoundaryMesh; object boundary; }\n"
    file.write_text(f"{head}{len(found)}\n(\n{rows})\n")


def wedge(folder: Path, angle_deg: float, kind: str = "wedge") -> tuple[Path, Any, Any]:
    """A sector about the z axis of cells in r, azimuth and z, and parcels in it."""
    angle = np.radians(angle_deg)
    block = foam.block(
        (np.linspace(0.0, 6e-3, 4), np.linspace(-0.5, 0.5, 2), np.linspace(0.0, HEIGHT_M, 4))
    )
    found = sides(block)
    radius, turn, height = block.points.T.copy()
    x, y = radius * np.cos(turn * angle), radius * np.sin(turn * angle)
    block.points = np.stack([x, y, height], axis=1)
    random = np.random.default_rng(5)
    gas = {
        "T": random.uniform(500.0, 800.0, block.cells),
        "rho": random.uniform(15.0, 30.0, block.cells),
        "C7H16": random.uniform(0.0, 0.3, block.cells),
    }
    _, _, cloud = foam.sample()
    place = random.uniform((1e-3, -0.4, 1e-3), (4e-3, 0.4, HEIGHT_M), (17, 3))
    cloud["position"] = np.stack(
        [
            place[:, 0] * np.cos(place[:, 1] * angle),
            place[:, 0] * np.sin(place[:, 1] * angle),
            place[:, 2],
        ],
        axis=1,
    )
    case = foam.write(folder, block, gas=gas, cloud=cloud)
    boundary(case, found, {"-y": kind, "+y": kind})
    return case, gas, cloud


def mass_of(cloud: Any) -> float:
    return float(np.sum(cloud["nParticle"] * cloud["rho"] * np.pi / 6 * cloud["d"] ** 3))


@pytest.mark.parametrize("kind", ["wedge", "cyclic", "cyclicAMI", "patch"])
@pytest.mark.parametrize("angle_deg", [5.0, 45.0, 90.0])
def test_sectors(tmp_path: Path, angle_deg: float, kind: str) -> None:
    case, gas, cloud = wedge(tmp_path, angle_deg, kind)
    said = {"patch": f"spans {angle_deg:g} of 360 degrees"}.get(
        kind, f"are {kind}: the mesh is a sector of {angle_deg:g} degrees"
    )
    refused(case, rf"{said}.*angle_deg: {angle_deg:g}\}} completes it", **SET)
    many = round(360 / angle_deg)
    part = notes_of(case, sector={"angle_deg": 360}, **SET)
    spray = read(case, sector={"angle_deg": angle_deg}, **SET)
    assert spray.notes["liquid_mass_kg"] == pytest.approx(many * mass_of(cloud), rel=1e-12)
    assert spray.notes["vapour_mass_kg"] == pytest.approx(many * part["vapour_mass_kg"], rel=1e-9)
    assert spray.notes["copies"] == many
    # a prism of n chords for a cylinder: its area by hand
    area = many * 0.5 * (6e-3) ** 2 * np.sin(np.radians(angle_deg))
    fuel = (gas["rho"] * gas["C7H16"]).reshape(3, 3)
    rings = np.diff((np.linspace(0.0, 6e-3, 4) / 6e-3) ** 2)
    mass = np.sum(fuel * rings) * area * HEIGHT_M / 3
    assert spray.notes["vapour_mass_kg"] == pytest.approx(mass, rel=1e-9)
    # the centre of mass comes to lie on the axis
    assert spray.parcels is not None
    assert spray.vapour is not None
    weight = spray.parcels.droplets * spray.parcels.diameter_m**3
    middle = weight @ spray.parcels.position_m / weight.sum()
    assert middle[:2] == pytest.approx([0.0, 0.0], abs=1e-15)
    # about another centre than the nozzle it comes to lie there
    beside = SET | {"nozzle_m": (1e-3, 0.0, HEIGHT_M)}
    centre_m = {"centre_m": (0.0, 0.0, 0.0), "axis": "-z"}
    other = read(case, sector={"angle_deg": angle_deg} | centre_m, **beside).parcels
    assert other is not None
    assert (weight @ other.position_m / weight.sum())[:2] == pytest.approx([-1e-3, 0.0], abs=1e-15)
    # and so does the momentum, with the speeds of the case
    velocity = spray.parcels.velocity_m_s
    assert velocity is not None
    assert (weight @ velocity)[:2] == pytest.approx([0.0, 0.0], abs=1e-10 * weight.sum())
    speeds = np.tile(np.linalg.norm(cloud["U"], axis=1), many)
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), speeds, rtol=1e-9)
    boxes = spray.vapour.cells
    molecules = spray.vapour.number_density_m3 * boxes.volume_m3
    centre = molecules @ (boxes.lower_m + boxes.upper_m) / 2 / molecules.sum()
    assert centre[:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert any(f"completed by {many} rotations" in text for text in spray.remarks)
    refused(
        case,
        rf"spans {angle_deg:g} degrees .* not the 30 of spray",
        sector={"angle_deg": 30},
        **SET,
    )


@pytest.mark.parametrize("kind", ["symmetry", "symmetryPlane", "patch"])
@pytest.mark.parametrize("planes", ["x", "y", "xy"])
def test_planes_of_symmetry(tmp_path: Path, planes: str, kind: str) -> None:
    edges = [np.linspace(-6e-3, 6e-3, 5), np.linspace(-6e-3, 6e-3, 5), np.linspace(0, HEIGHT_M, 4)]
    for name in planes:
        edges["xy".index(name)] = np.linspace(0.0, 6e-3, 3)
    block = foam.block((edges[0], edges[1], edges[2]))
    found = sides(block)
    random = np.random.default_rng(6)
    gas = {"T": random.uniform(500, 800, block.cells), "rho": np.full(block.cells, 20.0)}
    gas["C7H16"] = random.uniform(0.0, 0.3, block.cells)
    _, _, cloud = foam.sample()
    low = [edge[0] for edge in edges]
    cloud["position"] = random.uniform(low, (5e-3, 5e-3, 7e-3), (17, 3))
    case = foam.write(tmp_path, block, gas=gas, cloud=cloud)
    boundary(case, found, {f"-{name}": kind for name in planes})
    said = f"is {kind} and contains the axis" if kind != "patch" else "spans .* of 360 degrees"
    refused(case, rf"{said}.*spray\.symmetry: \[x|{said}.*symmetry: \[y", **SET)
    spray = read(case, symmetry=list(planes), **SET)
    many = 2 ** len(planes)
    fuel = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    assert spray.notes["vapour_mass_kg"] == pytest.approx(many * fuel, rel=1e-9)
    assert spray.notes["liquid_mass_kg"] == pytest.approx(many * mass_of(cloud), rel=1e-12)
    assert spray.parcels is not None
    weight = spray.parcels.droplets * spray.parcels.diameter_m**3
    middle = weight @ spray.parcels.position_m / weight.sum()
    assert spray.parcels.velocity_m_s is not None
    flow = weight @ spray.parcels.velocity_m_s / weight.sum()
    for name in planes:
        assert middle["xy".index(name)] == pytest.approx(0.0, abs=1e-15)
        assert flow["xy".index(name)] == pytest.approx(0.0, abs=1e-12)
    assert "parcels" in notes_of(case, symmetry=[], **SET)
    refused(
        case,
        "is on both sides of the plane z",
        symmetry=["z"],
        nozzle_m=(0, 0, HEIGHT_M / 2),
        axis="-z",
    )


def test_what_is_whole_is_left_alone(tmp_path: Path) -> None:
    """Symmetry far from the axis, and cyclic sides that are parallel, cut no spray."""
    edges = (np.linspace(-6e-3, 6e-3, 3), np.linspace(-6e-3, 6e-3, 3), np.linspace(0, HEIGHT_M, 4))
    block = foam.block(edges)
    found = sides(block)
    gas = {
        name: np.full(block.cells, v) for name, v in (("T", 500.0), ("rho", 20.0), ("C7H16", 0.1))
    }
    case = foam.write(tmp_path, block, gas=gas)
    boundary(case, found, {"-x": "symmetryPlane", "-y": "cyclic", "+y": "cyclic"})
    assert "copies" not in notes_of(case, **SET)
    boundary(case, found, {"-x": "empty", "+x": "empty"})
    refused(case, r"'s[mp]x' is empty: the case is flat", **SET)
    (case / "constant" / "polyMesh" / "boundary").write_text("FoamFile { class x; }\n1 ( a { ")
    refused(case, "boundary: brackets do not match", **SET)


def test_span_about_an_axis() -> None:
    """A box beside the axis spans little, but no plane through the axis bounds it."""
    x, y = np.meshgrid(np.linspace(1.0, 2.0, 4), np.linspace(0.5, 2.0, 4))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    axis = np.array([0.0, 0.0, 1.0])
    box = BoxMesh(points - 1e-9, points + 1e-9, "box")
    span, planes = azimuth_span(box, np.zeros(3), axis)
    assert span == pytest.approx(np.degrees(np.arctan(2.0) - np.arctan(0.25)), rel=1e-7)
    assert not planes
    assert azimuth_span(box, np.array([1.5, 1.25, 0.0]), axis)[0] > 270.0


def test_sections_that_are_not_allowed() -> None:
    for wrong in (7.0, 400.0, 0.1):
        with pytest.raises(ValidationError):
            CfdSpray(file=Path("x"), sector={"angle_deg": wrong})
    with pytest.raises(ValidationError):
        CfdSpray(file=Path("x"), symmetry=["w"])
