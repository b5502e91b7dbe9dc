"""Contract of devices of all kinds."""

import json

from cldit.io.plain_data import parse_json
from cldit.rig.errors import NotConnected
from cldit.rig.protocols import KINDS, Device
from cldit.testing.expect import Allowed, Check, expect, refuses


def life(device: Device, allowed: Allowed) -> None:
    """Checks that connect, make_safe and close may be repeated, and the error before connect."""
    device.make_safe()
    device.close()
    refuses(device.read_configuration, NotConnected, "before connect()", "connect")
    device.connect()
    device.connect()
    stored = parse_json(json.dumps(device.read_configuration(), allow_nan=False))
    expect(stored, "read_configuration() is empty")
    device.make_safe()
    device.make_safe()
    device.close()
    device.close()
    refuses(device.read_configuration, NotConnected, "after close()")
    device.connect()
    expect(device.read_configuration(), "read_configuration() is empty when connected again")


def identity(device: Device, allowed: Allowed) -> None:
    """Checks that kind, maker and model are given."""
    info = device.identify()
    expect(info.kind in KINDS, f"kind: {info.kind!r}")
    expect(info.maker and info.model, f"{info} lacks maker or model")
    expect(isinstance(info.simulated, bool), f"simulated: {info.simulated!r}")


LIFE = Check("life", "connects, makes safe and closes, several times", life)
IDENTITY = Check("identity", "reads its identity", identity)
