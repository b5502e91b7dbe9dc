"""Remarks on the motion of droplets during the camera's exposure."""

from __future__ import annotations

import numpy as np

from cldit.scene import Scene
from cldit.spray.result import Spray


def motion_remarks(scene: Scene, spray: Spray) -> tuple[str, ...]:
    """Remarks on droplets that are smeared, cannot be, or move by more than a pixel."""
    camera, parcels = scene.camera, spray.parcels
    velocity = None if parcels is None else parcels.velocity_m_s
    if camera.exposure == "smear":
        if velocity is not None:
            return ("camera.exposure: droplets are smeared along their velocity, vapour is not",)
        return (
            "camera.exposure: smear has no effect, since the parcels have no velocity: the image "
            "is that of an instant",
        )
    given_s = camera.sensor.integration_time_s
    if camera.exposure != "instant" or given_s is None or velocity is None or parcels is None:
        return ()
    area = parcels.droplets * parcels.diameter_m**2
    if not area.any():
        return ()
    speed_m_s = float(np.sqrt(np.average(np.sum(velocity[:, ::2] ** 2, axis=1), weights=area)))
    moved_m = speed_m_s * given_s
    if moved_m <= camera.pixel_m:
        return ()
    return (
        f"droplets move by {1e3 * moved_m:.2g} mm (RMS in the image) during {1e6 * given_s:g} us, "
        f"{moved_m / camera.pixel_m:.2g} pixels of the sensor, but the image is of an instant; "
        "camera.exposure: smear or times shows the mean",
    )
