"""Completion of a partial case: sectors by rotation, half cases by mirroring."""

from collections.abc import Iterator, Sequence
from itertools import chain, product

import numpy as np

from cldit.arrays import Floats
from cldit.cfd.case import Boundary, CfdCase, triple
from cldit.cfd.mesh.cells import CellMesh
from cldit.cfd.one_state import check_layers
from cldit.cfd.orientation import InjectorFrame, cross_matrix
from cldit.cfd.tolerances import SLACK
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray, Sector
from cldit.spray.result import Parcels

_PART_DEG = 185.0  # a mesh that spans less about its axis is a part; a box of few cells spans 270
_ANGLE_DEG = 0.5  # by which the mesh may differ from the sector that is said


Pose = tuple[Floats, Floats]
"""Origin (3,) and matrix (3, 3): a place x of the case is matrix (x - origin) in cldit's frame."""


def _pose(frame: InjectorFrame, turn: Floats, centre_m: Floats) -> Pose:
    """Pose of a copy of the case that is turned (3, 3), or mirrored, about a centre (3,)."""
    return centre_m - turn.T @ centre_m + turn.T @ frame.nozzle_m, frame.rotation @ turn


def copies(
    spec: CfdSpray, case: CfdCase, frame: InjectorFrame
) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    """Poses of the copies that make the case whole, itself first, and remarks; refuses a part."""
    if spec.sector is not None and spec.symmetry is not None:
        raise SprayError("spray.sector and spray.symmetry are both given; allowed: one of them")
    if spec.sector is not None:
        return _turns(spec.sector, case, frame)
    if spec.symmetry is not None:
        return _mirrored(spec.symmetry, case, frame)
    _refuse_part(case, frame)
    return ((frame.nozzle_m, frame.rotation),), ()


def completed_parcels(parcels: Parcels, poses: Sequence[Pose]) -> Parcels:
    """Parcels of all copies in the project's frame; each copy has the masses of the case."""
    places, velocities = [], []
    for origin, rotation in poses:
        places.append((parcels.position_m - origin) @ rotation.T)
        if parcels.velocity_m_s is not None:
            velocities.append(parcels.velocity_m_s @ rotation.T)
    scalars = parcels.diameter_m, parcels.droplets, parcels.temperature_K, parcels.density_kg_m3
    size, droplets, temperature, density = (np.tile(values, len(poses)) for values in scalars)
    velocity = np.concatenate(velocities) if velocities else None
    place = np.concatenate(places)
    return Parcels(place, size, droplets, temperature, density, velocity_m_s=velocity)


def _turns(
    sector: Sector, case: CfdCase, frame: InjectorFrame
) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    centre = frame.nozzle_m if sector.centre_m is None else np.array(sector.centre_m)
    axis = frame.axis if sector.axis is None else np.array(sector.axis)
    axis = axis / np.linalg.norm(axis)
    count = round(360.0 / sector.angle_deg)
    if count == 1:
        return ((frame.nozzle_m, frame.rotation),), ()
    span, _ = azimuth_span(case.mesh, centre, axis)
    if abs(span - sector.angle_deg) > _ANGLE_DEG:
        raise SprayError(
            f"{case.mesh.source}: spans {span:.4g} degrees about {triple(axis)} through "
            f"{triple(centre)} m, not the {sector.angle_deg:g} of spray.sector.angle_deg; set its "
            "centre_m and axis if they are not the nozzle and the injection's"
        )
    cross = cross_matrix(axis)
    poses = []
    for angle in (2 * np.pi * n / count for n in range(count)):  # Rodrigues
        turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
        poses.append(_pose(frame, turn, centre))
    summary = f"A sector of {sector.angle_deg:g} degrees, completed by {count} rotations"
    return tuple(poses), (f"{summary}: masses times {count}.",)


def _mirrored(
    normals: Sequence[str], case: CfdCase, frame: InjectorFrame
) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    if not normals:
        return ((frame.nozzle_m, frame.rotation),), ()
    low, high = case.mesh.extent_m
    names = sorted(set(normals))
    axes = ["xyz".index(name) for name in names]
    for name, at in zip(names, axes, strict=True):
        place = frame.nozzle_m[at]
        if min(place - low[at], high[at] - place) > SLACK * float((high - low).max()):
            plane = f"the plane {name} = {place:g} m through the nozzle (spray.symmetry)"
            raise SprayError(
                f"{case.mesh.source}: is on both sides of {plane}; allowed: planes that bound it"
            )
    poses = []
    for signs in product((1.0, -1.0), repeat=len(axes)):
        turn = np.eye(3)
        turn[axes, axes] = signs
        poses.append(_pose(frame, turn, frame.nozzle_m))
    remark = f"Mirrored in {' and '.join(names)} at the nozzle: masses times {len(poses)}."
    return tuple(poses), (remark,)


def _refuse_part(case: CfdCase, frame: InjectorFrame) -> None:
    """Refuses a partial case, recognised by its patches or its geometry; name what completes it."""
    for patch in case.boundaries:
        if patch.kind == "empty":
            raise SprayError(
                f"{case.source}: the patch {patch.name!r} is empty: the case is flat, not a spray "
                "in space; run it in three dimensions, or as a wedge"
            )
    for kind in ("wedge", "cyclic", "cyclicAMI"):
        pair = [patch for patch in case.boundaries if patch.kind == kind]
        angle, axis = _between(pair)
        if not pair or (kind != "wedge" and not angle):
            continue  # parallel cyclic sides bound an endless box, not a sector
        extent = f"of {angle:.4g} degrees about {triple(axis)}" if angle else "of a turn"
        raise SprayError(
            f"{case.source}: the patches {', '.join(repr(b.name) for b in pair)} are {kind}: the "
            f"mesh is a sector {extent}, not the whole spray; {_way(angle)}"
        )
    low, high = case.mesh.extent_m
    width = float((high - low).max())
    for patch in case.boundaries:
        if patch.kind not in ("symmetry", "symmetryPlane"):
            continue
        through = abs(float((frame.nozzle_m - patch.place_m) @ patch.normal)) < SLACK * width
        along = abs(float(frame.axis @ patch.normal)) < 1e-3
        if patch.normal.any() and through and along:
            raise SprayError(
                f"{case.source}: the patch {patch.name!r} is {patch.kind} and contains the axis of "
                f"the injection: the mesh is a part of the spray; {_plane_way(patch.normal)}"
            )
    span, planes = azimuth_span(case.mesh, frame.nozzle_m, frame.axis, enough_deg=_PART_DEG)
    if span < _PART_DEG and planes:
        raise SprayError(
            f"{case.mesh.source}: spans {span:.4g} of 360 degrees about the injection's axis, "
            f"{triple(frame.axis)} through {triple(frame.nozzle_m)} m, between planes through it, "
            f"so it seems to be a part of the spray; {_way(span)}, spray.symmetry: [x] (the "
            "normals of the planes) mirrors it"
        )
    check_layers(case.mesh)


def _between(pair: Sequence[Boundary]) -> tuple[float, Floats]:
    """Angle in degrees of the mesh between two plane patches, and the axis; 0 if parallel."""
    planes = [patch.normal for patch in pair if patch.normal.any()]
    if len(planes) < 2:
        return 0.0, np.zeros(3)
    cross = np.cross(planes[0], planes[1])
    size = float(np.linalg.norm(cross))
    if size < 1e-6:
        return 0.0, np.zeros(3)
    return 180.0 - float(np.degrees(np.arctan2(size, planes[0] @ planes[1]))), cross / size


def _way(angle: float) -> str:
    shown = f"{angle:.4g}" if angle else "DEGREES"
    return f"spray.sector: {{angle_deg: {shown}}} completes it (`--sector {shown}`), 360 keeps it"


def _plane_way(normal: Floats) -> str:
    name = "xyz"[int(np.argmax(np.abs(normal)))]
    if np.abs(normal).max() < 1.0 - 1e-6:
        return "its plane is oblique: export the whole, or spray.symmetry: [] keeps it as it is"
    way = f"spray.symmetry: [{name}] completes it (`--symmetry {name}`; several as [x, y])"
    return f"{way}, [] keeps it as it is (`--symmetry none`)"


_SPARSE = 61  # a prime: no common factor with the points of a row or a cell
_BINS = 36_000  # of azimuth, 0.01 degrees each; gaps narrower than one are no gaps


def azimuth_span(
    mesh: CellMesh, centre_m: Floats, axis: Floats, *, enough_deg: float = 360.0
) -> tuple[float, bool]:
    """Degrees about an axis that a mesh fills, and whether planes through the axis bound it.

    centre_m and the unit axis are (3,). The angle is 360 less the widest gap between azimuths of
    points; it is a lower bound, without a search for planes, once it exceeds enough_deg. Planes
    bound the gap if both of its sides have points at several distances from the axis.
    """
    radial = np.eye(3)[int(np.argmin(np.abs(axis)))]
    radial = radial - (radial @ axis) * axis
    radial /= np.linalg.norm(radial)
    across = np.stack([radial, np.cross(axis, radial)], axis=1)
    box = np.array(list(product(*zip(*mesh.extent_m, strict=True))))
    # azimuths of points nearer to the axis mean little
    nearest_m = SLACK * float(np.linalg.norm((box - centre_m) @ across, axis=1).max())

    def polar(stride: int = 1) -> Iterator[tuple[Floats, Floats]]:
        for points in mesh.points():
            x, y = ((points[::stride] - centre_m) @ across).T
            radius = np.hypot(x, y)
            kept = radius > nearest_m
            yield np.arctan2(y[kept], x[kept]), radius[kept]

    low, high = np.full(_BINS, np.inf), np.full(_BINS, -np.inf)
    span, ends = 360.0, (0.0, 0.0)
    for angle, _ in chain(polar(_SPARSE), polar()):  # a whole mesh is recognised by few points
        place = np.minimum((angle + np.pi) * (_BINS / (2 * np.pi)), _BINS - 1).astype(np.int64)
        np.minimum.at(low, place, angle)
        np.maximum.at(high, place, angle)
        filled = np.flatnonzero(high >= low)
        if not len(filled):
            continue
        begin, end = low[filled], high[filled]
        gaps = np.append(begin[1:], begin[0] + 2 * np.pi) - end
        widest = int(np.argmax(gaps))
        ends = float(end[widest]), float(begin[(widest + 1) % len(begin)])
        span = float(np.degrees(2 * np.pi - gaps[widest]))
        if span > enough_deg:
            return span, False
    nearest, widest_m, width_rad = np.full(2, np.inf), np.zeros(2), 2 * np.pi / _BINS
    for angle, radius in polar():
        for side, edge in enumerate(ends):
            on = radius[np.abs((angle - edge + np.pi) % (2 * np.pi) - np.pi) < width_rad]
            nearest[side] = min(nearest[side], on.min(initial=np.inf))
            widest_m[side] = max(widest_m[side], on.max(initial=0.0))
    return span, bool(np.all(widest_m > 1.5 * nearest))
