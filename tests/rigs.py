"""Rigs for the contract tests: simulated, and over sockets to the peers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import pytest

from cldit.rig.clock import SimulatedClock
from cldit.rig.load import Rig, open_rig
from tests.emulators.blackbody import FlukePeer, ModbusPeer
from tests.emulators.gige_camera import GigePeer
from tests.emulators.rig import PeerRig

Make = Callable[[dict[str, Any], ExitStack], Rig]


def simulated(data: dict[str, Any], stack: ExitStack) -> Rig:
    return open_rig(data)


def sockets(loss: float, legacy: bool = False) -> Make:
    def make(data: dict[str, Any], stack: ExitStack) -> Rig:
        for module in ("viva_genicam", "pyvisa_py", "pymodbus"):
            pytest.importorskip(module, reason=f"{module} is missing; install cldit[rig]")
        peers = stack.enter_context(PeerRig(camera=GigePeer(loss=loss, seed=11, legacy=legacy)))
        file = {**peers.rig_data(), "setup": data["setup"]}
        return open_rig(file)

    return make


def modbus(model: str, serial: bool) -> Make:
    def make(data: dict[str, Any], stack: ExitStack) -> Rig:
        pytest.importorskip("pymodbus", reason="pymodbus is missing; install cldit[rig]")
        clock = SimulatedClock()
        peer = stack.enter_context(ModbusPeer(model, clock=clock, serial=serial))
        line = {"serial": peer.serial} if serial else {"host": peer.host, "port": peer.port}
        settings = {
            "model": model,
            "temperature_unit": "celsius",
            "limits_K": [253.0, 873.0],
            **line,
        }
        data["background"] = {"driver": "modbus_blackbody", "settings": settings}
        return open_rig(data, clock=clock)

    return make


def fluke(serial: bool) -> Make:
    def make(data: dict[str, Any], stack: ExitStack) -> Rig:
        pytest.importorskip("pyvisa_py", reason="pyvisa-py is missing; install cldit[rig]")
        clock = SimulatedClock()
        peer = stack.enter_context(FlukePeer(clock=clock, serial=serial, start_K=310.0))
        line = {"serial": peer.serial} if serial else {"host": peer.host, "port": peer.port}
        data["background"] = {"driver": "fluke418x", "settings": line}
        return open_rig(data, clock=clock)

    return make


# Packets that are lost are sent again: the contract is the same with 0.5 % loss.
RIGS: dict[str, Make] = {
    "simulated": simulated,
    "sockets": sockets(0.0),
    "sockets-lossy": sockets(0.005),
}
CAMERAS: dict[str, Make] = {
    **RIGS,
    "sockets-genicam-1.0": sockets(0.0, legacy=True),
}
BACKGROUNDS: dict[str, Make] = {
    "simulated": simulated,
    "eurotherm-tcp": modbus("eurotherm-3200", False),
    "ir2100-serial": modbus("ir-2100", True),
    "fluke-tcp": fluke(False),
    "fluke-serial": fluke(True),
}
