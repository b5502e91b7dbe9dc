"""Dry run of a plan: its time, its disk space and its problems; nothing moves and nothing fires."""

import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cldit.acquisition.disk import free_bytes, needed_bytes
from cldit.acquisition.plan import Plan
from cldit.acquisition.preflight import preflight
from cldit.acquisition.storage import check_folder, survey
from cldit.errors import DiskFull
from cldit.rig.checks import read_temperature
from cldit.rig.errors import RigError
from cldit.rig.load import Rig

SECONDS_PER_KELVIN = 3.0  # of a black body on its way, where nobody says better


@dataclass(frozen=True)
class DryRun:
    """Result of a dry run. `background_s` of `time_s` is waiting for backgrounds. With no
    `problems`, one line each, the acquisition can begin. `unstated`: settings of the camera that
    change counts, with their values, which the rig file does not state.
    """

    shots: int
    backgrounds_K: tuple[float, ...]
    time_s: float
    background_s: float
    disk_bytes: int
    free_bytes: int
    problems: tuple[str, ...]
    unstated: tuple[str, ...] = ()


def dry_run(rig: Rig, plan: Plan, folder: Path) -> DryRun:
    """Runs the acquisition's own preflight and computes time and disk space.

    The preflight sets the camera, takes a test image, and writes a burst without injection, after
    which the trigger is inhibited. No set point is written. `folder` need not exist; raises
    RunFolderError if it belongs to another plan, is in use, or is damaged, and FileError if it
    cannot be made or written.
    """
    check_folder(folder)
    done = survey(folder, plan).done if folder.exists() else set()
    missing = [shot for shot in plan.steps() if shot.id not in done]
    problems: list[str] = []
    unstated: list[str] = []
    present_K, picture_bytes, period_s = plan.backgrounds_K[0], 0, 0.0
    try:
        if missing:
            ready = preflight(rig, plan, folder, shots_left=len(missing), inject=False)
            picture_bytes, period_s = ready.picture_bytes, ready.minimum_period_s
            present_K = read_temperature(rig.background)
            camera = ready.configuration["devices"]["camera"]["configuration"]
            unstated = camera.get("unstated", [])
    except (RigError, DiskFull) as error:
        problems += str(error).splitlines()
        with suppress(RigError):  # an estimate all the same, from what the camera says of itself
            can = rig.camera.capabilities
            picture_bytes = 2 * plan.frames * math.prod(can.sensor_pixels)
            period_s = can.minimum_period_s
    order = plan.background_order({shot.background for shot in missing}, present_K=present_K)
    stops_K = [present_K, *(plan.backgrounds_K[index] for index in order)]
    way_K = float(np.sum(np.abs(np.diff(stops_K))))
    stable = plan.stability
    background_s = way_K * SECONDS_PER_KELVIN + len(order) * (stable.hold_s + stable.settle_s)
    wheel = rig.filter_wheel  # at the first background all filters, then one is there already
    moves = 0 if wheel is None else len(order) * max(len(plan.filters) - 1, 0) + 1
    moving_s = 0.0 if wheel is None else moves * wheel.moving_s
    injected_s = plan.trigger.injector_delay_s + plan.trigger.injector_width_s
    shots_s = sum(
        plan.pause_s
        + max(plan.frames * period_s, plan.integration_time_s + plan.delays[shot.delay], injected_s)
        for shot in missing
    )
    return DryRun(
        shots=len(missing),
        backgrounds_K=tuple(stops_K[1:]),
        time_s=background_s + moving_s + shots_s,
        background_s=background_s,
        disk_bytes=needed_bytes(len(missing), picture_bytes=picture_bytes),
        free_bytes=free_bytes(folder),
        problems=tuple(problems),
        unstated=tuple(unstated),
    )
