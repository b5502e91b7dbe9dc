"""The beds of every installed driver, those of simulated devices included, which are here."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest

from cldit.errors import SceneError
from cldit.rig.drivers import DriverAbout, describe_drivers
from cldit.rig.load import open_rig
from cldit.testing.backgrounds import background_steps
from cldit.testing.bed import Bed, Make, beds_of
from cldit.testing.cameras import camera_steps
from cldit.testing.triggers import trigger_steps
from cldit.testing.wheels import wheel_steps
from tests.emulators.beds import BEDS

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.simulated_scene import Pulse
else:
    from cldit.drivers.simulated_scene import Pulse

CAMERAS = ("gige_camera",)  # a session takes a second, and has many replies
FIRST = {  # of the first tier
    "modbus_blackbody-eurotherm-tcp",
    "fluke418x-tcp",
    "dg645-tcp",
    "fw102c-serial",
}
SIMULATED = {
    "simulated_camera": "camera",
    "simulated_filter_wheel": "filter_wheel",
    "simulated_blackbody": "background",
    "simulated_injector": "trigger",
}


def simulated(driver: str, rig: dict[str, Any]) -> Make:
    """Bed of a simulated device, which has no replies, and is unplugged by a setting."""
    part = SIMULATED[driver]

    def make(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
        if part == "filter_wheel":
            run = rig["bench"]["settings"]["run"]
            rig["bench"]["settings"]["filters"] = {"first": [run], "second": [run]}
        choice = rig.setdefault(part, {"driver": driver, "settings": {}})
        choice["settings"] |= settings
        opened = open_rig(rig)
        device: Any = opened.devices[part]
        steps = {
            "camera": lambda: camera_steps(device, lambda: device.hear(Pulse(0.0, False, 1))),
            "filter_wheel": lambda: wheel_steps(device),
            "background": lambda: background_steps(device),
            "trigger": lambda: trigger_steps(device),
        }[part]()
        if part == "background":
            opened.camera.connect()
        told = {
            "camera": ("simulated camera", "armed"),
            "filter_wheel": (),
            "background": ("simulated black body", "set point 420.0 K"),
            "trigger": ("simulated injector", "a trigger injects"),
        }[part]
        return Bed(device, steps, lambda: "", told)

    return make


def make_of(driver: str, variant: str, rig: dict[str, Any]) -> Make:
    """Skips the test where what the driver needs is not installed; fails it for a driver that has
    no emulator."""
    if driver in SIMULATED:
        return simulated(driver, rig)
    about: DriverAbout | None = describe_drivers().get(driver)
    if about is not None and (missing := about.missing()):
        pytest.skip(f"{', '.join(missing)} is missing; {about.install}")
    if driver in BEDS:
        return BEDS[driver][variant]
    try:  # of another package
        return beds_of(driver)[variant]
    except SceneError as error:
        pytest.fail(str(error))


def cases(*, simulated: bool = True) -> list[Any]:
    """Every bed of every installed driver; a driver without one fails."""
    return [
        pytest.param(
            name,
            variant,
            id=f"{name}-{variant}",
            marks=[pytest.mark.gige] if name in CAMERAS else [],
        )
        for name, about in describe_drivers().items()
        if about.kind != "bench" and (simulated or about.tested != "simulated")
        for variant in _variants(name)
    ]


def in_tiers() -> list[Any]:
    """Beds of all drivers of instruments; those beside `FIRST` are for the second tier."""
    return [
        case
        if case.id in FIRST
        else pytest.param(*case.values, id=case.id, marks=[*case.marks, pytest.mark.slow])
        for case in cases(simulated=False)
    ]


def _variants(driver: str) -> list[str]:
    try:
        return ["simulated"] if driver in SIMULATED else list(BEDS.get(driver) or beds_of(driver))
    except SceneError:
        return ["no bed"]
