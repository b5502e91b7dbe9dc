"""Test benches of the drivers here, each with its emulator (see `cldit.testing.bed`)."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cldit.rig.clock import Clock, SimulatedClock
from cldit.rig.drivers import RigContext, check_settings, load_driver
from cldit.testing.backgrounds import BackgroundSide, background_steps, hot_K
from cldit.testing.bed import Bed, Make
from cldit.testing.cameras import camera_steps
from cldit.testing.triggers import trigger_steps
from cldit.testing.wheels import WheelSide, wheel_steps
from tests.emulators.blackbody import FlukePeer, ModbusPeer
from tests.emulators.dg645 import Dg645Peer
from tests.emulators.filter_wheel import FilterWheelPeer
from tests.emulators.gige_camera import GigePeer
from tests.emulators.line_blackbody import LinePeer
from tests.emulators.pulse_generator import PulseGeneratorPeer
from tests.emulators.rig import CALIBRATION

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.line_blackbody import LineSettings
    from drivers.modbus_registers import MAPS, RegisterMap
    from drivers.pulse_generator import SERIES
else:
    from cldit.drivers.line_blackbody import LineSettings
    from cldit.drivers.modbus_registers import MAPS, RegisterMap
    from cldit.drivers.pulse_generator import SERIES

_WARM_K = 1.0  # above the safe set point
_ADDRESS = {"host", "port", "serial", "address", "interface"}  # settings that the emulator gives
_STABLE_K = 0.2
_IDLE_s = 2.0  # longer than a camera's heartbeat here


def make_device(
    driver: str,
    clock: Clock,
    usual: Mapping[str, Any],
    settings: Mapping[str, Any],
    answer_s: float | None,
    line: Mapping[str, Any],
) -> Any:
    """The driver with the user's settings, or the usual ones, connected to a peer at `line`."""
    asked = {name: value for name, value in settings.items() if name not in _ADDRESS}
    waits = {} if answer_s is None else {"answer_s": answer_s}
    context = RigContext(clock, None, Path(), 1)
    return load_driver(driver)({**usual, **asked, **waits, **line}, context)


def line_to(peer: Any) -> dict[str, Any]:
    """Address of a peer as settings of a driver."""
    if peer.serial is not None:
        return {"serial": peer.serial}
    return {"host": peer.host, "port": peer.port}


def where_is(peer: Any) -> str:
    """Address of a peer in words."""
    return peer.serial or f"{peer.host}:{peer.port}"


def hot(peer: Any, device: Any) -> str:
    """State of a hot black body in words; empty if it is cold."""
    # Controllers that can switch their heater off are cold without it.
    on = getattr(peer, "heating", True)
    warm = peer.setpoint_K > device.safe_setpoint_K + _WARM_K
    text = f"set point {peer.setpoint_K:.1f} K"
    return text if on and warm else f"{text}, heater on" if on and hasattr(peer, "heating") else ""


# An invented controller, with all formats of numbers that the presets do not use.
_OTHER = {
    "maker": "nobody",
    "model": "other registers",
    "unit": "kelvin",
    "temperature": {
        "address": 10, "format": "int32", "decimals": 2, "low_word_first": True, "table": "input",
    },
    "setpoint": {"address": 40, "format": "uint16", "decimals": 1},
    "extra": {"alarm": 7},
}  # fmt: skip


def _modbus(usual_map: Mapping[str, Any], serial: bool) -> Make:
    """Bench with the registers of the rig file, if it has any."""

    def make(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
        clock = SimulatedClock()
        given = {name: settings[name] for name in ("model", "registers") if name in settings}
        asked = given or usual_map
        registers = (
            RegisterMap.model_validate(asked["registers"])
            if asked.get("registers")
            else MAPS[asked["model"]]
        )
        peer = stack.enter_context(ModbusPeer(registers=registers, clock=clock, serial=serial))
        model = registers.model
        usual = {**asked, "limits_K": [253.0, 873.0]}

        def afresh() -> Any:
            line = line_to(peer)
            return make_device("modbus_blackbody", clock, usual, settings, answer_s, line)

        device = afresh()
        told = (f"{model} at {where_is(peer)}", f"set point {hot_K(device):.1f} K", "front panel")
        side = BackgroundSide(lambda: peer.setpoint_K, peer.heater.now_K)
        return Bed(
            device, background_steps(device, side), lambda: hot(peer, device), told, peer.replies,
            afresh=afresh, sensor=peer.break_sensor, hang_up=peer.hang_up,
        )  # fmt: skip

    return make


_BARE = {  # numbers alone: an answer does not show its question
    "unit": "fahrenheit",
    "temperature": {"send": "T?", "answer": "{value}"},
    "setpoint": {"send": "SP?", "answer": "{value}"},
    "set": {"send": "SP {value:.2f}"},
}
_TALKS = {
    "unit": "kelvin",
    "unit_check": {"send": "UNIT", "answer": "IN KELVIN"},
    "identity": {"send": "ID", "answer": "BLACK BODY {any}"},
    "temperature": {"send": "READ T", "answer": "T = {value} K"},
    "setpoint": {"send": "READ S", "answer": "S = {value} K"},
    "set": {"send": "SET {value:.3f}", "answer": "SET {value} DONE"},
    "stable": {"send": "READ STABLE", "answer": "STABLE {value}"},
    "heater_on": {"send": "HEAT", "answer": "HEATS"},
    "heater_off": {"send": "COOL", "answer": "COOLS"},
    "heater": {"send": "READ HEATER", "answer": "HEATER {value}"},
}


def _line(usual: Mapping[str, Any], serial: bool) -> Make:
    """Bench with the templates of the rig file, if it has any."""

    def make(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
        clock = SimulatedClock()
        asked = {"limits_K": [283.0, 873.0], **(settings if "set" in settings else usual)}
        own = {name: value for name, value in asked.items() if name not in _ADDRESS}
        known = check_settings(LineSettings, {**own, "host": "emulator"})
        peer = stack.enter_context(LinePeer(known, clock=clock, serial=serial))

        def afresh() -> Any:
            return make_device("line_blackbody", clock, {}, own, answer_s, line_to(peer))

        device = afresh()
        told = (f"at {where_is(peer)}", f"set point {hot_K(device):.1f} K", "front panel")
        flag = (lambda: peer.stable) if known.stable is not None else (lambda: None)
        side = BackgroundSide(lambda: peer.setpoint_K, peer.heater.now_K, flag)

        def left_on() -> str:
            warm = peer.setpoint_K > device.safe_setpoint_K + _WARM_K
            return f"set point {peer.setpoint_K:.1f} K" if peer.heating and warm else ""

        return Bed(
            device, background_steps(device, side), left_on, told, peer.replies,
            afresh=afresh, sensor=peer.break_sensor, hang_up=peer.unplug,
        )  # fmt: skip

    return make


def _fluke(serial: bool) -> Make:
    def make(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
        clock = SimulatedClock()
        peer = stack.enter_context(FlukePeer(clock=clock, serial=serial, start_K=310.0))

        def afresh() -> Any:
            return make_device("fluke418x", clock, {}, settings, answer_s, line_to(peer))

        device = afresh()
        told = (f"418x at {where_is(peer)}", "heater on", "front panel")

        def stable() -> bool:
            return peer.heating and abs(peer.heater.now_K() - peer.setpoint_K) < _STABLE_K

        side = BackgroundSide(
            lambda: peer.setpoint_K, peer.heater.now_K, stable, lambda: {"heating": peer.heating}
        )
        return Bed(
            device, background_steps(device, side), lambda: hot(peer, device), told, peer.replies,
            afresh=afresh, sensor=peer.break_sensor, hang_up=peer.unplug,
        )  # fmt: skip

    return make


def _dg645(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
    peer = stack.enter_context(Dg645Peer())

    def afresh() -> Any:
        line = {"host": peer.host, "port": peer.port}
        return make_device("dg645", Clock(), {}, settings, answer_s, line)

    device = afresh()
    camera, injector = settings.get("camera", "AB"), settings.get("injector", "CD")
    level = f"LAMP {('AB', 'CD', 'EF', 'GH').index(injector) + 1}"

    def armed() -> str:
        at_V = peer.values[level]
        pulse = ["a trigger injects"] if peer.injects(injector) else []
        return ", ".join([*pulse, *([f"{injector} at {at_V} V"] if at_V > 0.5 else [])])

    def left_on() -> str:
        values = peer.values
        modes = [
            text
            for text, bad in (
                ("burst mode", values["BURM"] != 0),
                ("triggers by itself", values["TSRC"] != 5),
            )
            if bad
        ]
        return ", ".join([*([armed()] if peer.triggers > 0 and armed() else []), *modes])

    def agrees(stored: Mapping[str, Any]) -> bool:
        delays = stored["delays"].items()
        return (
            all(
                tuple(round(got, 11) for got in value)
                == tuple(round(right, 11) for right in peer.delays[int(name.split()[1])])
                for name, value in delays
            )
            and stored["levels_V"][1] == peer.values[level]
            and stored["trigger_source"] == peer.values["TSRC"]
        )

    def pulses(output: str) -> list[float]:
        return [edge.time_s for edge in peer.pulses(camera if output == "camera" else injector)]

    volts = settings.get("injector_V", 5.0)
    told = (f"DG645 at {peer.host}:{peer.port}", f"{injector} {volts:g} V", f"output {injector}")
    return Bed(
        device, trigger_steps(device, agrees), left_on, told, peer.replies, pulses, armed,
        afresh=afresh, hang_up=peer.unplug,
    )  # fmt: skip


def _pulse_generator(series: str, identity: str, serial: bool) -> Make:
    def make(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
        own = SERIES[series]
        peer = stack.enter_context(
            PulseGeneratorPeer(
                identity=identity, system=own.system, trigger=own.trigger, outputs=8, serial=serial
            )
        )
        asked = {**settings, "series": series}

        def afresh() -> Any:
            line = line_to(peer)
            return make_device("pulse_generator", Clock(), {}, asked, answer_s, line)

        device = afresh()
        camera, injector = settings.get("camera", "A"), settings.get("injector", "B")
        known = {
            name: f"PULSE{'ABCDEFGH'.index(output) + 1}:"
            for name, output in (("camera", camera), ("injector", injector))
        }

        def armed() -> str:
            return f"output {injector} would inject" if peer.injects(injector) else ""

        def left_on() -> str:
            return armed() or ("running" if peer.running else "")

        def agrees(stored: Mapping[str, Any]) -> bool:
            return stored["running"] == peer.running and all(
                stored["outputs"][name]["on"] == bool(peer.values[f"{channel}STAT"])
                and abs(stored["outputs"][name]["delay_s"] - peer.values[f"{channel}DEL"]) < 1e-11
                and abs(stored["outputs"][name]["width_s"] - peer.values[f"{channel}WIDT"]) < 1e-11
                for name, channel in known.items()
            )

        def pulses(output: str) -> list[float]:
            return [edge.time_s for edge in peer.pulses(camera if output == "camera" else injector)]

        told = (f"{series} at {where_is(peer)}", f"{injector} on", f"output {injector}")
        return Bed(
            device, trigger_steps(device, agrees), left_on, told, peer.replies, pulses, armed,
            afresh=afresh, hang_up=peer.unplug,
        )  # fmt: skip

    return make


def _gige(legacy: bool) -> Make:
    def make(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
        peer = stack.enter_context(GigePeer((64, 48), legacy=legacy))
        usual = {"calibration": CALIBRATION}
        # Short, because make_safe() tries for as long as the heartbeat.
        line = {"address": peer.host, "interface": "127.0.0.1", "heartbeat_s": 1.5}

        def afresh() -> Any:
            return make_device("gige_camera", Clock(), usual, settings, None, line)

        device = afresh()
        told = (f"camera at {peer.host}", "armed for 2 frames", "trigger cable")
        steps = camera_steps(device, peer.line, lambda: peer.image(peer.taken))
        return Bed(
            device, steps, lambda: "armed" if peer.armed else "", told, peer.replies,
            afresh=afresh, hang_up=lambda: time.sleep(_IDLE_s),
        )  # fmt: skip

    return make


FILTERS = [
    {"position": 1, "name": "fuel", "filter_um": [3.3, 3.5], **(_MEASURED := {
        "integration_time_s": 25e-6, "counts_per_radiance": 1e-18,
    })},
    {"position": 2, "name": "droplets", "filter_um": [[3.8, 0.0], [3.9, 0.8], [4.0, 0.0]],
     **_MEASURED, "offset_counts": 900.0},
]  # fmt: skip


def _fw102c(serial: bool, *, echo: bool = True) -> Make:
    def make(stack: ExitStack, settings: Mapping[str, Any], answer_s: float | None) -> Bed:
        clock = SimulatedClock()  # the driver waits on it for a move
        peer = stack.enter_context(FilterWheelPeer(clock=clock, serial=serial, echo=echo))
        usual = {"filters": FILTERS, "moving_s": 0.5}

        def afresh() -> Any:
            return make_device("fw102c", clock, usual, settings, answer_s, line_to(peer))

        device = afresh()
        names = {item.position: item.name for item in device.filters}

        def stick() -> None:
            peer.stuck = True

        side = WheelSide(lambda: names.get(peer.position), peer.turn, stick)
        return Bed(
            device, wheel_steps(device, side), lambda: "", (), peer.replies,
            afresh=afresh, hang_up=peer.unplug, wheel=side,
        )  # fmt: skip

    return make


_CELSIUS = {"temperature_unit": "celsius"}

BEDS: dict[str, dict[str, Make]] = {
    "dg645": {"tcp": _dg645},
    "fw102c": {
        "tcp": _fw102c(False),
        "serial": _fw102c(True),
        "no-echo": _fw102c(True, echo=False),
    },
    "fluke418x": {"tcp": _fluke(False), "serial": _fluke(True)},
    "modbus_blackbody": {
        "eurotherm-tcp": _modbus({"model": "eurotherm-3200", **_CELSIUS}, False),
        "ir2100-serial": _modbus({"model": "ir-2100", **_CELSIUS}, True),
        "registers-tcp": _modbus({"registers": _OTHER}, False),
    },
    "pulse_generator": {
        "bnc575-tcp": _pulse_generator("bnc-575", "BNC,575-8,31309,2.4.1-1.2.2", False),
        "qc9510-serial": _pulse_generator("qc-9510", "QC,9518+,02345,1.32", True),
    },
    "line_blackbody": {"bare-tcp": _line(_BARE, False), "talks-serial": _line(_TALKS, True)},
    "gige_camera": {
        "gige": _gige(False),
        "genicam-1.0": _gige(True),
    },
}
"""Test benches by driver and variant."""
