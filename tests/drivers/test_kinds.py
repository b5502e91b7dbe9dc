"""Every kind of instrument has a contract, a simulated driver, and a driver with an emulator."""

from __future__ import annotations

import pytest

from cldit.rig.drivers import describe_drivers
from cldit.rig.protocols import KINDS
from cldit.testing.bed import beds_of
from cldit.testing.run import HARMLESS, OF_KIND
from tests.beds import SIMULATED
from tests.emulators.beds import BEDS

DRIVERS = describe_drivers()


def of_kind(kind: str, *, simulated: bool) -> list[str]:
    return [
        name
        for name, about in DRIVERS.items()
        if about.kind == kind and (about.tested == "simulated") is simulated
    ]


def test_kinds_and_contracts_are_the_same() -> None:
    assert list(OF_KIND) == list(KINDS) and set(KINDS) >= set(HARMLESS)
    assert set(SIMULATED.values()) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_has_contract_emulator_and_simulated_driver(kind: str) -> None:
    own = [check for check in OF_KIND[kind] if check.name not in ("life", "identity")]
    assert own, f"{kind}: no check of its own in its contract"
    assert of_kind(kind, simulated=True), f"{kind}: no simulated driver"
    real = of_kind(kind, simulated=False)
    assert real, f"{kind}: no driver of an instrument"
    for name in real:
        assert BEDS.get(name) or beds_of(name), f"{name}: no emulator"
