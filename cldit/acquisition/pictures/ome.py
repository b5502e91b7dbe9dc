"""OME-XML in a TIFF: time and exposure of each plane."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

from cldit.acquisition.pictures.source import SECONDS_OF_UNIT, Told, moment_s

_AXES = ("TheT", "TheZ", "TheC")


def told_by_ome(xml: str, count: int) -> tuple[Told, ...]:
    """Time and exposure of each image, if the file's one OME image has a plane for each along one
    axis.

    `AcquisitionDate`, `DeltaT` and `ExposureTime` are those of the OME data model (2016-06), whose
    default unit is the second. Empty if planes and the `count` of images do not match.
    """
    try:
        images = ElementTree.fromstring(xml).findall("{*}Image")
    except ElementTree.ParseError:
        return ()
    if len(images) != 1:
        return ()
    planes = images[0].findall("{*}Pixels/{*}Plane")
    varying = [axis for axis in _AXES if len({plane.get(axis) for plane in planes}) > 1]
    if len(planes) != count or len(varying) > 1:
        return ()
    try:
        if varying:
            planes.sort(key=lambda plane: int(plane.get(varying[0]) or 0))
        date = images[0].findtext("{*}AcquisitionDate")
        start_s = moment_s(date) if date else None
        return tuple(_of(plane, start_s) for plane in planes)
    except ValueError:
        return ()


def _of(plane: Any, start_s: float | None) -> Told:
    later_s, exposed_s = (_seconds(plane, name) for name in ("DeltaT", "ExposureTime"))
    taken_s = None if start_s is None or later_s is None else start_s + later_s
    return Told(taken_s, exposed_s)


def _seconds(plane: Any, name: str) -> float | None:
    value, unit = plane.get(name), plane.get(f"{name}Unit", "s")
    if value is None or unit not in SECONDS_OF_UNIT:
        return None
    return float(value) * SECONDS_OF_UNIT[unit]
