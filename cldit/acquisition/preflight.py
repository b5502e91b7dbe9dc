"""Preflight: everything that is bound to fail is found before anything moves."""

import json
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.disk import check_room, needed_bytes
from cldit.acquisition.plan import Plan
from cldit.acquisition.plan_checks import external_trigger, impossible, together
from cldit.acquisition.storage import CONFIGURATION, PLAN
from cldit.camera.calibration import Calibration
from cldit.errors import RunFolderError
from cldit.io.plain_data import read_json
from cldit.rig.checks import ROUNDING
from cldit.rig.errors import ConfigRejected, MissingFrames, NotConnected, RigError
from cldit.rig.load import Rig
from cldit.rig.protocols import SpectralFilter, TriggerInfo, TriggerMode

_READY_S = 900.0  # a Stirling cooler takes 5 to 10 min from room temperature
_HOW_WELL = {  # of the setup, without influence on the images
    "uncertainty",
    "background_error_K",
    "camera_offset_error_counts",
    "camera_gain_error",
}


@dataclass(frozen=True)
class Ready:
    """Result of the preflight.

    configuration: the snapshot that is stored with the images, as JSON can represent it. shape:
    rows and columns of an image.
    """

    configuration: dict[str, Any]
    shape: tuple[int, int]
    integration_time_s: float
    saturation_counts: int
    minimum_period_s: float
    trigger: TriggerInfo
    picture_bytes: int  # of a whole shot
    calibrations: tuple[Calibration, ...]  # of the plan's filters; one without a filter wheel


def preflight(rig: Rig, plan: Plan, folder: Path, *, shots_left: int, inject: bool = True) -> Ready:
    """Connects and checks the rig for `plan`, and takes one test image without injecting.

    Acquisition and dry run ask the same questions here, and so refuse in the same words. `folder`
    need not exist. Without `inject` the trigger generator is never brought into a state in which a
    trigger injects, for callers that do not make the rig safe afterwards.

    Raises RigError: NotConnected (all devices that do not answer), OutOfLimits before anything has
    moved, ConfigRejected if an instrument refuses or reads back something else, MissingFrames
    without a test image; of several problems, a line each. Raises DiskFull without room for
    `shots_left` images, and RunFolderError if `folder` contains images of another rig.
    """
    problems: list[RigError] = []
    try:
        rig.connect()
    except NotConnected as error:
        problems.append(error)
    problems += impossible(rig, plan, connected=not problems)
    if problems:
        raise together(problems)
    rig.camera.wait_ready(_READY_S)
    settings = rig.camera.configure(plan.integration_time_s)
    _agree("camera: integration_time_s", plan.integration_time_s, settings.integration_time_s)
    capabilities = rig.camera.capabilities
    modes = capabilities.trigger_modes
    _check_trigger(rig, plan, inject=inject)
    picture = _test_picture(rig, modes, timeout_s=plan.frame_timeout_s)
    picture_bytes = plan.frames * picture.nbytes
    check_room(folder, needed_bytes(shots_left, picture_bytes=picture_bytes))
    configuration, calibrations = _snapshot(rig, plan, picture.shape)
    if (folder / PLAN).exists() and (folder / CONFIGURATION).exists():
        check_same_rig(read_json(folder / CONFIGURATION), configuration, folder)
    return Ready(
        configuration=configuration,
        shape=(picture.shape[0], picture.shape[1]),
        integration_time_s=float(settings.integration_time_s),
        saturation_counts=int(capabilities.saturation_counts),
        minimum_period_s=capabilities.minimum_period_s,
        trigger=external_trigger(modes, plan.frames),
        picture_bytes=picture_bytes,
        calibrations=calibrations,
    )


def _snapshot(
    rig: Rig, plan: Plan, shape: tuple[int, ...]
) -> tuple[dict[str, Any], tuple[Calibration, ...]]:
    """Configuration of the rig as JSON represents it, and the calibration with each filter."""
    devices = {
        name: {"info": asdict(device.identify()), "configuration": device.read_configuration()}
        for name, device in rig.devices.items()
    }
    try:
        devices = json.loads(json.dumps(devices, allow_nan=False))
        calibrations = tuple(map(Calibration.from_dict, calibrations_of(devices, plan)))
    except KeyError as error:
        raise ConfigRejected(f"camera: its configuration has no {error}") from error
    except (TypeError, ValueError) as error:
        raise ConfigRejected(f"a configuration cannot be stored: {error}") from error
    configuration = {
        "plan_hash": plan.hash(),
        "cldit": version("cldit"),
        "rig": rig.file.name,
        "setup": rig.file.setup.model_dump(mode="json"),
        "shape": [*shape],
        "devices": devices,
    }
    return configuration, calibrations


def calibrations_of(devices: dict[str, Any], plan: Plan) -> list[dict[str, Any]]:
    """Calibration of the camera with each of the plan's filters, or without any, from the devices
    of a configuration. Raises KeyError, TypeError or ValueError if that lacks something.
    """
    camera = devices["camera"]["configuration"]
    if not plan.filters:
        return [camera["calibration"]]
    stated = devices["filter_wheel"]["configuration"]["filters"]
    filters = {item["name"]: SpectralFilter.model_validate(item) for item in stated}
    return [filters[name].calibration(camera) for name in plan.filters]


def _agree(setting: str, written: float, read: float, *, tolerance: float = 0.0) -> None:
    if not abs(read - written) <= max(ROUNDING * abs(written), tolerance):
        raise ConfigRejected(f"{setting}: reads back {read:g} after {written:g} was written")


def _check_trigger(rig: Rig, plan: Plan, *, inject: bool) -> None:
    """Configures the generator with the plan's burst at every delay, and leaves it inhibited."""
    by_delay = {shot.delay: shot for shot in plan.steps()}
    for shot in by_delay.values():
        asked = plan.burst(shot)
        asked = replace(asked, inject=asked.inject and inject)
        try:
            got = rig.trigger.configure(asked)
        finally:
            rig.trigger.inhibit()
        if got.n != 1 or got.inject != asked.inject:
            raise ConfigRejected(f"trigger: reads back {got} after {asked} was written")
        for name in ("camera_delay_s", "injector_delay_s"):
            _agree(f"trigger: {name}", getattr(asked, name), getattr(got, name), tolerance=1e-6)


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
    complete = [frame for frame in frames if frame.complete]
    if not complete:
        raise MissingFrames(1, 0, incomplete=len(frames))
    return complete[0].data


def check_same_rig(begun: dict[str, Any], present: dict[str, Any], folder: Path) -> None:
    """Raises RunFolderError if the rig differs from the one that `folder` was begun with.

    Images of one folder are evaluated together, so they must mean the same. `begun` and `present`
    are configurations as in `configuration.json`.
    """

    def meaning(data: dict[str, Any]) -> dict[str, Any]:
        camera = data["devices"]["camera"]["configuration"]
        counting = camera.get("features", {})
        features = {name: value for name, value in counting.items() if name in counting_names}
        setup = {name: value for name, value in data["setup"].items() if name not in _HOW_WELL}
        wheel = data["devices"].get("filter_wheel", {}).get("configuration", {})
        filters = {f"filter {item['name']}": item for item in wheel.get("filters", [])}
        return {"shape": data["shape"], **setup, **features, **filters, **camera["calibration"]}

    try:
        counting_names = begun["devices"]["camera"]["configuration"].get("features", {})
        old = meaning(begun)
    except (KeyError, TypeError) as error:
        raise RunFolderError(
            f"{folder / CONFIGURATION}: is damaged ({error}); restore it"
        ) from error
    changed = [
        f"{name}: {old.get(name)} before, {value} now"
        for name, value in meaning(present).items()
        if old.get(name) != value
    ]
    if changed:
        raise RunFolderError(
            f"{folder}: was begun on a rig with other properties; choose another folder:\n"
            + "\n".join(changed)
        )
