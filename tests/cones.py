"""Cone sprays on the device of the tests."""

from __future__ import annotations

import os

from cldit.gpu.device import open_device
from cldit.scene.spray import ConeSpray
from cldit.spray.cone.spray import make_cone
from cldit.spray.result import Spray


def cone_spray(spec: ConeSpray) -> Spray:
    return make_cone(spec, open_device(os.environ.get("CLDIT_TEST_DEVICE")))
