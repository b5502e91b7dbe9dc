"""A broken sensor leaves nothing on: `cldit.testing.implausible`, for every installed driver before
its emulator."""

from __future__ import annotations

import pytest

from cldit.rig.errors import ConfigRejected
from cldit.testing.bed import opened
from cldit.testing.implausible import check_implausible
from tests.beds import CAMERAS, in_tiers, make_of


@pytest.mark.parametrize(("driver", "variant"), in_tiers(harmless=False))
def test_implausible_readings(driver: str, variant: str) -> None:
    at_once = 1 if driver in CAMERAS else 4  # of several cameras the newest is found
    assert check_implausible(make_of(driver, variant, {}), at_once=at_once) >= 14


@pytest.mark.parametrize(("busy", "works"), [(3, True), (6, False)])
def test_a_busy_controller_is_asked_again_within_a_bound(busy: int, works: bool) -> None:
    from pymodbus.pdu import ExceptionResponse

    with opened(make_of("modbus_blackbody", "eurotherm-tcp", {})) as bed:
        bed.device.connect()
        client = bed.device._client
        plain, refused = client.read_holding_registers, [ExceptionResponse(3, 6)] * busy
        client.read_holding_registers = lambda *args, **named: (
            refused.pop() if refused else plain(*args, **named)
        )
        if works:
            assert bed.device.read_temperature() > 0.0
        else:
            with pytest.raises(ConfigRejected):
                bed.device.read_temperature()
        assert not refused
