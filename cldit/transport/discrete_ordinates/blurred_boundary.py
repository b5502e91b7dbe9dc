"""Boundary blurred by the forward peak of the phase function (stage 3 of `trace_source`).

In the final sweeps the share f of scattered light counts as unscattered (delta-M, see
moment_source.py): light of the boundary continues along its ray. But the forward peak has a width.
With the Legendre moments p_l of the phase function and f = p_3, the remainder beside the three
moments of the source is f G, where G has the moments 1 for l up to 3, and p_l / f beyond. So light
of the boundary B, which is attenuated by exp(-t), and by exp(-t*) with delta-M, is taken as

    B exp(-t) + (G B) (exp(-t*) - exp(-t)):

the unscattered light, and the light scattered forward once or more, blurred by the peak. It is
scattered somewhere on its ray; G B is evaluated at the mean place.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.transport.boundary import boundary_seen, shifted
from cldit.transport.cells import SweptBox
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.phase import ScatteringTable
from cldit.transport.view import View

SIDE = 8  # places along a side of a map
_ANGLES, _TURNS = 24, 8  # of the peak: bins of the sine of half the angle, and azimuths


@dataclass(frozen=True)
class ForwardPeak:
    """Quadrature of the forward peak G, see above.

    cosine, weight: (K,) cosines to the ray, and weights, which sum to 1. Some may be negative,
        since G is the remainder of a phase function beside a sum of three moments.
    """

    cosine: Floats
    weight: Floats

    @classmethod
    def of(cls, phase: ScatteringTable) -> "ForwardPeak | None":
        """Peak of a phase function; None if its third moment is not above 0."""
        moments = phase.moments(4)
        forward = float(moments[-1])
        if forward <= 0:
            return None
        cosine = 1 - 2 * np.linspace(0.0, 1.0, _ANGLES + 1) ** 2
        scattered = np.interp(-cosine, -phase.cosine, phase.cumulative)
        g, h = (moments[1:3] - forward) / (1 - forward)
        smooth = (cosine + 1.5 * g * cosine**2 + 2.5 * h * (cosine**3 - cosine)) / 2
        weight = (np.diff(scattered) + (1 - forward) * np.diff(smooth)) / forward
        return cls((cosine[:-1] + cosine[1:]) / 2, weight)

    def about(self, ray: Floats) -> tuple[Floats, Floats]:
        """Directions (K T, 3) of the peak about the unit vector `ray` (3,), and weights (K T,)."""
        axis_u, axis_v = _across(ray)
        number = np.arange(len(self.cosine))
        turn = 2 * np.pi * (np.arange(_TURNS) + number[:, None] / 2) / _TURNS
        sine = np.sqrt(1 - self.cosine**2)[:, None, None]
        round_ = np.cos(turn)[..., None] * axis_u + np.sin(turn)[..., None] * axis_v
        unit = self.cosine[:, None, None] * ray + sine * round_
        return unit.reshape(-1, 3), np.repeat(self.weight / _TURNS, _TURNS)


def _across(ray: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (3,) perpendicular to `ray` (3,) and to each other."""
    axis_u = np.cross(np.eye(3)[int(np.argmin(np.abs(ray)))], ray)
    axis_u /= np.linalg.norm(axis_u)
    return axis_u, np.cross(ray, axis_u)


def upload_blurred(
    device: Device, maps: Floats, frames: Floats, real: type[np.floating]
) -> dict[str, Any]:
    """Kernel arguments of the sweep for BLURRED_BOUNDARY, except the optical depth.

    The arguments are those of `blurred_maps`.
    """
    arrays = {"blurred_maps": maps, "blurred_frames": frames}
    return {
        name: upload(device, "blurred boundary", array.astype(real))
        for name, array in arrays.items()
    }


def blurred_maps(
    view: View, box: SweptBox, directions: Ordinates, peak: ForwardPeak
) -> tuple[Floats, Floats]:
    """Maps (N, B - 1, SIDE, SIDE) of the blurred boundary over the rays of each ordinate.

    They have all components except the wall. The second result are the frames (N, 2, 4): rows x, y,
    z and offset, which give a ray's column and row in a map.
    """
    size = np.asarray(box.shape, float)
    centre, radius = view.disc[:3] - box.low, float(view.disc[3]) ** 0.5
    if view.is_enclosed:
        centre = np.array([0.0, 1e12, 0.0])  # behind every patch
    patches = shifted(view.patches, -np.asarray(box.low, float))
    maps = np.zeros((len(directions), 1 + len(patches), SIDE, SIDE))
    frames = np.zeros((len(directions), 2, 4))
    place = np.linspace(-1.0, 1.0, SIDE)
    for unit, map_, frame in zip(directions.unit, maps, frames, strict=True):
        axes = np.stack(_across(unit))
        reach = np.abs(axes) @ size / 2
        chord = np.prod(size) / (np.abs(unit) @ (np.prod(size) / size))  # the mean of all rays
        # Of two random places on a chord, the one nearer to the end is a third of the chord from it
        # in the mean: a sixth beyond the middle.
        middle = size / 2 + 1 / 6 * chord * unit
        at = (
            middle
            + place[None, :, None] * reach[0] * axes[0]
            + place[:, None, None] * reach[1] * axes[1]
        ).reshape(-1, 3)
        toward, weight = peak.about(unit)
        seen = boundary_seen(
            np.repeat(at, len(toward), axis=0),
            np.tile(toward, (len(at), 1)),
            centre=centre,
            radius=radius,
            patches=patches,
        ).reshape(SIDE, SIDE, -1)
        if view.is_enclosed:
            seen[seen == 1] = 0  # the background is everywhere except on patches
        for number, component in enumerate((0, *range(2, 2 + len(patches)))):
            map_[number] = (seen == component) @ weight
        steps = (SIDE - 1) / 2 / reach
        frame[:, :3] = steps[:, None] * axes
        frame[:, 3] = (SIDE - 1) / 2 - frame[:, :3] @ (size / 2)
    return maps, frames
