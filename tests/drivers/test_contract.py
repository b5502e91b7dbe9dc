"""Contract of every camera, background and trigger generator: `cldit.testing`; that of filter
wheels is in `test_filter_wheels.py`.

A driver joins by a rig in `RIGS` (cameras with a trigger line, trigger generators), `CAMERAS` or
`BACKGROUNDS` of `tests/rigs.py`. Those of real instruments talk over loopback sockets and
pseudo-terminals to the peers in `tests/emulators`, whose time is real but for the black bodies',
which share the rig's simulated clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from cldit.rig.load import Rig
from cldit.rig.protocols import Background, Camera, Device, TriggerGenerator
from cldit.testing.backgrounds import BACKGROUND
from cldit.testing.cameras import CAMERA
from cldit.testing.devices import IDENTITY, LIFE
from cldit.testing.expect import EVERYTHING, Check
from cldit.testing.triggers import TRIGGER
from tests.rigs import BACKGROUNDS, CAMERAS, RIGS, Make
from tests.together import TOGETHER


def opened(make: Make, data: dict[str, Any]) -> Iterator[Rig]:
    with ExitStack() as stack:
        rig = make(data, stack)
        yield rig
        rig.close()


def over_sockets(rigs: dict[str, Make]) -> list[Any]:
    return [
        name if name == "simulated" else pytest.param(name, marks=pytest.mark.gige) for name in rigs
    ]


@pytest.fixture(params=over_sockets(RIGS))
def rig(request: pytest.FixtureRequest, tiny_rig: dict[str, Any]) -> Iterator[Rig]:
    """A rig that is not connected yet."""
    yield from opened(RIGS[request.param], tiny_rig)


@pytest.fixture(params=BACKGROUNDS)
def background_rig(request: pytest.FixtureRequest, tiny_rig: dict[str, Any]) -> Iterator[Rig]:
    yield from opened(BACKGROUNDS[request.param], tiny_rig)


@pytest.fixture(params=["camera", "background", "trigger"])
def device(request: pytest.FixtureRequest, rig: Rig) -> Device:
    return rig.devices[request.param]


@pytest.fixture(params=over_sockets(CAMERAS))
def camera(request: pytest.FixtureRequest, tiny_rig: dict[str, Any]) -> Iterator[Camera]:
    for rig in opened(CAMERAS[request.param], tiny_rig):
        rig.camera.connect()
        yield rig.camera


@pytest.fixture
def background(background_rig: Rig) -> Background:
    background_rig.background.connect()
    return background_rig.background


@pytest.fixture
def trigger(rig: Rig) -> TriggerGenerator:
    rig.connect()
    return rig.trigger


def each(checks: list[Check]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("check", checks, ids=lambda check: check.name)


@each([LIFE, IDENTITY])
def test_device(device: Device, check: Check) -> None:
    check.run(device, EVERYTHING)


@each(CAMERA)
def test_camera(camera: Camera, check: Check) -> None:
    check.run(camera, EVERYTHING)


@each(BACKGROUND)
def test_background(background: Background, check: Check) -> None:
    check.run(background, EVERYTHING)


@each(TRIGGER)
def test_trigger(trigger: TriggerGenerator, check: Check) -> None:
    check.run(trigger, EVERYTHING)


@each(TOGETHER)
def test_together(rig: Rig, check: Check) -> None:
    rig.connect()
    check.run(rig, EVERYTHING)
