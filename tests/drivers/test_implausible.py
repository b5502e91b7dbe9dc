"""A broken sensor leaves nothing on: `cldit.testing.implausible`, for every installed driver before
its emulator."""

from __future__ import annotations

import pytest

from cldit.testing.implausible import check_implausible
from tests.beds import cases, make_of

FIRST = {"modbus_blackbody-eurotherm-tcp", "fluke418x-tcp", "dg645-tcp"}


@pytest.mark.parametrize(
    ("driver", "variant"),
    [
        pytest.param(
            *case.values,
            id=case.id,
            marks=[*case.marks, *([] if case.id in FIRST else [pytest.mark.slow])],
        )
        for case in cases(simulated=False)
    ],
)
def test_implausible_readings(driver: str, variant: str) -> None:
    assert check_implausible(make_of(driver, variant, {})) >= 3
