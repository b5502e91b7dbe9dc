"""Everything that can be known to fail is found before anything moves."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.disk import check_room, needed_bytes
from cldit.acquisition.plan import Plan
from cldit.acquisition.storage import CONFIGURATION, PLAN
from cldit.camera.calibration import Calibration
from cldit.errors import RunFolderError
from cldit.plain_data import read_json
from cldit.rig.checks import check_burst, check_exposure
from cldit.rig.clock import SimulatedClock
from cldit.rig.errors import ConfigRejected, MissingFrames, NotConnected, OutOfLimits, RigError
from cldit.rig.load import Rig
from cldit.rig.protocols import Limits, TriggerInfo, TriggerMode

_READY_S = 900.0  # a cooled detector takes some minutes
_ZERO_CELSIUS_K = 273.15
_AGREE = 0.01  # how far, relatively, an instrument may round what it is told


@dataclass(frozen=True)
class Ready:
    """What preflight found out.

    configuration: the snapshot that is stored with the pictures, as JSON can hold it.
    shape: rows and columns of a picture.
    """

    configuration: dict[str, Any]
    shape: tuple[int, int]
    integration_time_s: float
    saturation_counts: int
    minimum_period_s: float
    trigger: TriggerInfo
    picture_bytes: int  # of a whole shot
    calibration: Calibration


def preflight(rig: Rig, plan: Plan, folder: Path, *, shots_left: int, inject: bool = True) -> Ready:
    """Connects and checks the rig for `plan`, and takes one test picture without injecting.

    The acquisition and the dry run ask the same questions here, and so refuse in the same words.

    Args:
        rig, plan: what is to be run.
        folder: that of the acquisition; it need not exist.
        shots_left: pictures that are still to be taken.
        inject: False never brings the trigger generator into a state in which a trigger injects,
            for who does not make the rig safe afterwards.

    Raises:
        NotConnected: all devices that do not answer.
        OutOfLimits: set points or settings that the instruments cannot take; nothing has moved.
        ConfigRejected: an instrument refuses, or reads back something else.
        MissingFrames: the camera sends no test picture.
        DiskFull: the disk cannot hold the pictures that are left to take.
        RunFolderError: `folder` holds pictures of another rig.
        RigError: several of these; a line each.
    """
    problems: list[RigError] = []
    try:
        rig.connect()
    except NotConnected as error:
        problems.append(error)
    problems += _impossible(rig, plan, connected=not problems)
    if problems:
        raise _together(problems)
    rig.camera.wait_ready(_READY_S)
    settings = rig.camera.configure(plan.integration_time_s)
    _agree("camera: integration_time_s", plan.integration_time_s, settings.integration_time_s)
    capabilities = rig.camera.capabilities
    modes = capabilities.trigger_modes
    trigger = _external(modes, plan.frames)
    _check_trigger(rig, plan, inject=inject)
    picture = _test_picture(rig, modes, timeout_s=plan.frame_timeout_s)
    picture_bytes = plan.frames * picture.nbytes
    check_room(folder, needed_bytes(shots_left, picture_bytes=picture_bytes))
    devices = {
        name: {"info": asdict(device.identify()), "configuration": device.read_configuration()}
        for name, device in rig.devices.items()
    }
    try:
        devices = json.loads(json.dumps(devices, allow_nan=False))
        calibration = Calibration.from_dict(devices["camera"]["configuration"]["calibration"])
    except KeyError as error:
        raise ConfigRejected(f"camera: its configuration has no {error}") from error
    except (TypeError, ValueError) as error:
        raise ConfigRejected(f"a configuration cannot be stored: {error}") from error
    rows, columns = picture.shape
    configuration = {
        "plan_hash": plan.hash(),
        "cldit": version("cldit"),
        "rig": rig.file.name,
        "setup": rig.file.setup.model_dump(mode="json"),
        "shape": [rows, columns],
        "devices": devices,
    }
    if (folder / PLAN).exists() and (folder / CONFIGURATION).exists():
        check_same_rig(read_json(folder / CONFIGURATION), configuration, folder)
    return Ready(
        configuration=configuration,
        shape=(rows, columns),
        integration_time_s=settings.integration_time_s,
        saturation_counts=capabilities.saturation_counts,
        minimum_period_s=capabilities.minimum_period_s,
        trigger=trigger,
        picture_bytes=picture_bytes,
        calibration=calibration,
    )


def _impossible(rig: Rig, plan: Plan, *, connected: bool) -> list[RigError]:
    """What speaks against a plan before any setting is written."""
    found: list[RigError] = []

    def asked(check: Callable[[], object]) -> None:
        try:
            check()
        except RigError as error:
            found.append(error)

    asked(lambda: _check_backgrounds(rig.background.limits, plan))
    asked(lambda: _check_times(plan))
    if connected:
        can = rig.camera.capabilities
        asked(lambda: _check_clock(rig))
        asked(lambda: check_exposure(can, plan.integration_time_s))
        asked(lambda: _external(can.trigger_modes, plan.frames))
        if plan.frames > 1 and plan.frame_timeout_s < can.minimum_period_s:
            found.append(_too_short("the camera's period", can.minimum_period_s, plan))
    return found


def _together(problems: list[RigError]) -> RigError:
    """One error for several; of their class, where they have one."""
    if len(problems) == 1:
        return problems[0]
    kinds = {type(problem) for problem in problems}
    kind = kinds.pop() if len(kinds) == 1 else RigError
    return kind("\n".join(map(str, problems)))


def _check_clock(rig: Rig) -> None:
    real = [name for name, device in rig.devices.items() if not device.identify().simulated]
    if real and isinstance(rig.clock, SimulatedClock):
        raise ConfigRejected(
            f"clock.model: simulated, but {', '.join(real)} is real; use `clock: {{model: system}}`"
        )


def _check_backgrounds(limits: Limits, plan: Plan) -> None:
    outside = [
        f"backgrounds_K: {temperature:g} is outside {limits.low_K:g}..{limits.high_K:g}"
        + _celsius(temperature, limits)
        for temperature in plan.backgrounds_K
        if not limits.low_K <= temperature <= limits.high_K
    ]
    if outside:
        raise OutOfLimits("the background cannot take the plan:\n" + "\n".join(outside))


def _celsius(temperature: float, limits: Limits) -> str:
    """A hint where a temperature below the limits would do as one in degrees Celsius."""
    kelvin = temperature + _ZERO_CELSIUS_K
    meant = temperature < limits.low_K and limits.low_K <= kelvin <= limits.high_K
    return f" K; {temperature:g} °C are {kelvin:g} K" if meant else ""


def _check_times(plan: Plan) -> None:
    """The burst as the plan has it, and whether a shot is over before it counts as missing."""
    burst = plan.burst(plan.steps()[-1])
    check_burst(burst)
    delays = (burst.camera_delay_s, burst.injector_delay_s)
    last_s = max(delay + width for delay, width in zip(delays, burst.widths_s, strict=True))
    shot_s = max(last_s, burst.camera_delay_s + plan.integration_time_s)
    if plan.frame_timeout_s < shot_s:
        raise _too_short("a shot", shot_s, plan)


def _too_short(what: str, needed_s: float, plan: Plan) -> OutOfLimits:
    return OutOfLimits(
        f"frame_timeout_s: {plan.frame_timeout_s:g} is shorter than {what}, {needed_s:g}; every "
        "picture would count as missing"
    )


def _agree(what: str, wanted: float, got: float, *, least: float = 0.0) -> None:
    if not abs(got - wanted) <= max(_AGREE * abs(wanted), least):
        raise ConfigRejected(f"{what}: reads back {got:g} after {wanted:g} was written")


def _external(modes: frozenset[TriggerMode], frames: int) -> TriggerInfo:
    for mode in (TriggerMode.EXTERNAL_EDGE, TriggerMode.EXTERNAL_LEVEL):
        if mode in modes:
            return TriggerInfo(mode, n_frames=frames, frames_per_trigger=frames)
    raise ConfigRejected("camera: has no external trigger, which every shot needs")


def _check_trigger(rig: Rig, plan: Plan, *, inject: bool) -> None:
    """What the generator makes of the plan's burst; it is left inhibited."""
    asked = plan.burst(plan.steps()[-1])
    asked = replace(asked, inject=asked.inject and inject)
    try:
        got = rig.trigger.configure(asked)
    finally:
        rig.trigger.inhibit()
    if got.n != 1 or got.inject != asked.inject:
        raise ConfigRejected(f"trigger: reads back {got} after {asked} was written")
    for name in ("camera_delay_s", "injector_delay_s"):
        _agree(f"trigger: {name}", getattr(asked, name), getattr(got, name), least=1e-6)


def _test_picture(
    rig: Rig, modes: frozenset[TriggerMode], *, timeout_s: float
) -> NDArray[np.uint16]:
    mode = TriggerMode.SOFTWARE if TriggerMode.SOFTWARE in modes else TriggerMode.INTERNAL
    camera = rig.camera
    camera.prepare(TriggerInfo(mode, n_frames=1))
    camera.flush()
    camera.arm()
    try:
        if mode is TriggerMode.SOFTWARE:
            camera.software_trigger()
        frames = list(camera.read_frames(1, timeout_s))
    finally:
        camera.disarm()
    whole = [frame for frame in frames if frame.complete]
    if not whole:
        raise MissingFrames(1, 0, incomplete=len(frames))
    return whole[0].data


def check_same_rig(before: dict[str, Any], now: dict[str, Any], folder: Path) -> None:
    """Pictures of one folder are evaluated together, so they must mean the same.

    Args:
        before, now: configurations, as `configuration.json` holds them.
        folder: named by the error.

    Raises:
        RunFolderError: the configuration stored in `folder` says that they do not.
    """

    def meaning(data: dict[str, Any]) -> dict[str, Any]:
        calibration = data["devices"]["camera"]["configuration"]["calibration"]
        return {"shape": data["shape"], **data["setup"], **calibration}

    try:
        old = meaning(before)
    except (KeyError, TypeError) as error:
        raise RunFolderError(
            f"{folder / CONFIGURATION}: is damaged ({error}); restore it"
        ) from error
    changed = [
        f"{name}: {old.get(name)} before, {value} now"
        for name, value in meaning(now).items()
        if old.get(name) != value
    ]
    if changed:
        raise RunFolderError(
            f"{folder}: was begun on a rig with other properties; choose another folder:\n"
            + "\n".join(changed)
        )
