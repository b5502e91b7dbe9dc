"""What a plan would take, and what speaks against it, with nothing moved and nothing fired."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cldit.acquisition.disk import needed_bytes
from cldit.acquisition.plan import Plan
from cldit.acquisition.storage import survey
from cldit.rig.checks import read_temperature
from cldit.rig.errors import RigError
from cldit.rig.load import Rig
from cldit.rig.protocols import TriggerMode

SECONDS_PER_KELVIN = 3.0  # of a black body on its way, where nobody says better


@dataclass(frozen=True)
class DryRun:
    """time_s: of which `background_s` goes into waiting for backgrounds. problems: one line each;
    with none of them, the acquisition can begin."""

    shots: int
    backgrounds_K: tuple[float, ...]
    time_s: float
    background_s: float
    disk_bytes: int
    free_bytes: int
    problems: tuple[str, ...]


def dry_run(
    rig: Rig, plan: Plan, folder: Path, *, seconds_per_kelvin: float = SECONDS_PER_KELVIN
) -> DryRun:
    """Connects, reads, and calculates; no set point is written and no burst configured.

    Args:
        rig, plan: what would be run.
        folder: that of the acquisition; it need not exist.
        seconds_per_kelvin: of the black body, on average.

    Raises:
        RunFolderError: `folder` belongs to another plan.
    """
    done = survey(folder, plan).done if folder.exists() else set()
    left = [shot for shot in plan.steps() if shot.id not in done]
    problems: list[str] = []
    present_K, pixels, period_s = plan.backgrounds_K[0], 0, 0.0
    try:
        rig.connect()
        present_K = read_temperature(rig.background)
        can = rig.camera.capabilities
        pixels, period_s = int(np.prod(can.sensor_pixels)), can.minimum_period_s
        low_s, high_s = can.integration_time_limits_s
        if not low_s <= plan.integration_time_s <= high_s:
            problems.append(
                f"integration_time_s: {plan.integration_time_s:g} is outside {low_s:g}..{high_s:g}"
            )
        if not can.trigger_modes & {TriggerMode.EXTERNAL_EDGE, TriggerMode.EXTERNAL_LEVEL}:
            problems.append("camera: has no external trigger, which every shot needs")
    except RigError as error:
        problems += str(error).splitlines()
    limits = rig.background.limits
    problems += [
        f"backgrounds_K: {temperature:g} is outside {limits.low_K:g}..{limits.high_K:g}"
        for temperature in plan.backgrounds_K
        if not limits.low_K <= temperature <= limits.high_K
    ]
    order = plan.background_order({shot.background for shot in left}, present_K=present_K)
    stops = [present_K, *(plan.backgrounds_K[index] for index in order)]
    way_K = float(np.sum(np.abs(np.diff(stops))))
    stable = plan.stability
    background_s = way_K * seconds_per_kelvin + len(order) * (stable.hold_s + stable.settle_s)
    trigger = plan.trigger
    shot_s = plan.pause_s + max(
        plan.frames * period_s,
        plan.integration_time_s + trigger.camera_delay_s,
        trigger.injector_delay_s + trigger.injector_width_s,
    )
    disk_bytes = needed_bytes(len(left), picture_bytes=2 * pixels * plan.frames)
    place = next(parent for parent in (folder, *folder.resolve().parents) if parent.exists())
    free_bytes = shutil.disk_usage(place).free
    if free_bytes < disk_bytes:
        problems.append(
            f"{folder}: the plan needs {disk_bytes / 1e6:.0f} MB, the disk has "
            f"{free_bytes / 1e6:.0f} MB free"
        )
    return DryRun(
        shots=len(left),
        backgrounds_K=tuple(stops[1:]),
        time_s=background_s + len(left) * shot_s,
        background_s=background_s,
        disk_bytes=disk_bytes,
        free_bytes=free_bytes,
        problems=tuple(problems),
    )
