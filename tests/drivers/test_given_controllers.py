"""Black bodies that the rig file describes: registers, and templates of a line protocol."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cldit.errors import SceneError
from cldit.io.plain_data import parse_yaml
from cldit.rig.clock import Clock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import ConfigRejected, DeviceTimeout, NotConnected, NotSafe
from cldit.testing.bed import opened
from cldit.testing.replies import Fault, Replies
from tests.emulators.beds import BEDS
from tests.emulators.blackbody import ModbusPeer, of_another
from tests.emulators.lines import LineServer

for _module in ("pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.controller import Unit, to_kelvin
    from drivers.line_templates import pattern
    from drivers.modbus_registers import MAPS, Register, RegisterMap
else:
    from cldit.drivers.controller import Unit, to_kelvin
    from cldit.drivers.line_templates import pattern
    from cldit.drivers.modbus_registers import MAPS, Register, RegisterMap

CONTEXT = RigContext(Clock(), None, Path(), 1)


@pytest.mark.parametrize(
    ("register", "words"),
    [  # written out by hand: two's complement, IEEE 754, high word first unless said
        ({"format": "int16", "decimals": 1}, [0xFFF6]),
        ({"format": "int32", "decimals": 2}, [0xFFFF, 0xFF9C]),
        ({"format": "int32", "decimals": 2, "low_word_first": True}, [0xFF9C, 0xFFFF]),
        ({"format": "float32"}, [0xBF80, 0x0000]),
        ({"format": "float32", "low_word_first": True}, [0x0000, 0xBF80]),
    ],
)
def test_how_registers_hold_minus_one(register: dict[str, Any], words: list[int]) -> None:
    made = Register(address=1, **register)
    assert made.encode(-1.0) == words and made.decode(words) == -1.0


def test_numbers_that_do_not_fit() -> None:
    for format in ("uint16", "uint32"):
        with pytest.raises(ConfigRejected, match=f"does not fit register 3, {format}"):
            Register(address=3, format=format).encode(-1.0)
    with pytest.raises(ConfigRejected, match="does not fit"):
        Register(address=3, format="int16", decimals=2).encode(400.0)
    with pytest.raises(NotConnected, match="finite"):
        Register(address=3, format="float32").decode([0x7FC0, 0])


def test_templates() -> None:
    assert pattern("T = {value} K").fullmatch(" t =  +4.2e2   K ")
    for padded in ("MV=   22.00", "MV=22.00 ", "MV= - 22.00"):
        assert pattern("MV={value}").fullmatch(padded)
    assert not pattern("T = {value} K").fullmatch("S = 420 K")
    assert not pattern("T.{value}").fullmatch("Tx420")  # no regular expression
    assert pattern("{any}BODY {any}").fullmatch("BLACK BODY 12")


BARE = {
    "host": "x",
    "limits_K": [283.0, 573.0],
    "unit": "celsius",
    "temperature": {"send": "T?", "answer": "{value}"},
    "setpoint": {"send": "SP?", "answer": "{value}"},
    "set": {"send": "SP {value:.2f}"},
}


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"set": {"send": "SP"}}, "allowed: one {value}"),
        ({"set": {"send": "SP {kelvin}"}}, "allowed: {value}"),
        ({"temperature": {"send": "T?", "answer": "{value} of {value}"}}, "one {value}"),
        ({"temperature": {"send": "T?", "answer": "{value:.2f}"}}, "has no format"),
        ({"temperature": {"send": "T?", "answer": "{number}"}}, "{value} and {any}"),
        ({"temperature": {"send": "T?"}}, "answer"),
        ({"unit": "rankine"}, "unit"),
        ({"unit": None}, "unit"),
    ],
)
def test_templates_that_say_nothing(change: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_driver("line_blackbody")({**BARE, **change}, CONTEXT)
    assert text in str(caught.value)


def test_registers_that_say_nothing() -> None:
    both = {"model": "ir-2100", "registers": {"temperature": {}, "setpoint": {}}}
    good = {"address": 1, "format": "int16"}
    line = {"host": "x", "limits_K": [283, 500], "temperature_unit": "celsius"}
    for settings, text in (
        ({}, "model, registers: allowed: one of the two"),
        (both, "registers.temperature.address"),
        ({"registers": {"temperature": good, "setpoint": {**good, "table": "input"}}}, "holding"),
    ):
        with pytest.raises(SceneError) as caught:
            load_driver("modbus_blackbody")({**line, **settings}, CONTEXT)
        assert text in str(caught.value)


SIM = """
spec: "1.1"
devices:
  oven:
    eom:
      ASRL INSTR: {q: "\\r\\n", r: "\\n"}
    error: ERROR
    dialogues:
      - {q: "T?", r: "21.70"}
    properties:
      setpoint:
        default: 21.85
        getter: {q: "SP?", r: "{:.2f}"}
        setter: {q: "SP {:.2f}"}
        specs: {min: 0, max: 400, type: float}
resources:
  ASRL1::INSTR: {device: oven}
"""


def test_templates_before_pyvisa_sim(tmp_path: Path) -> None:
    """Another project's simulator has the instrument; here is only the socket to it."""
    pytest.importorskip("pyvisa_sim", reason="pyvisa-sim is missing")
    import pyvisa

    path = tmp_path / "oven.yaml"
    path.write_text(SIM, encoding="utf-8")
    manager = pyvisa.ResourceManager(f"{path}@sim")
    oven: Any = manager.open_resource(
        "ASRL1::INSTR", read_termination="\n", write_termination="\r\n"
    )

    def answer(line: bytes) -> bytes:
        text = line.decode().strip()
        oven.write(text)
        return f"{oven.read()}\r\n".encode() if text.endswith("?") else b""

    server = LineServer("127.0.0.1", 0, answer, Replies())
    try:
        settings = {**BARE, "host": "127.0.0.1", "port": server.port}
        device = load_driver("line_blackbody")(settings, CONTEXT)
        device.connect()
        assert device.read_temperature() == pytest.approx(294.85)
        assert device.set_setpoint(420.0) == pytest.approx(420.0, abs=0.01)
        assert oven.query("SP?").strip() == "146.85"
        assert device.make_safe().did.startswith("set point 295.0 K, temperature 294.")
        assert oven.query("SP?").strip() == "21.85"
        device.close()
    finally:
        server.close()
        oven.close()
        manager.close()


def test_the_rig_files_of_the_docs() -> None:
    """Each block of docs/rig.md that names a driver here is one that this driver takes."""
    page = (Path(__file__).parents[2] / "docs" / "rig.md").read_text(encoding="utf-8")
    seen = []
    for block in re.findall(r"^```yaml\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
        data = parse_yaml(block, source="docs/rig.md")
        for part in ("filter_wheel", "background", "trigger"):
            choice = data.get(part, {})
            if choice.get("driver", "").startswith(
                ("modbus", "fluke", "fw", "line", "dg", "pulse")
            ):
                load_driver(choice["driver"])(choice["settings"], CONTEXT)
                seen.append(choice["driver"])
    assert {"modbus_blackbody", "line_blackbody", "dg645", "pulse_generator", "fw102c"} <= set(seen)


def test_a_heater_switch_without_an_answer_does_not_keep_the_set_point(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The rig file expects an answer that never comes: the set point is lowered all the same."""
    with opened(BEDS["line_blackbody"]["talks-serial"], answer_s=0.2) as bed:
        bed.device.connect()
        bed.device.set_setpoint(440.0)
        tell, off = bed.device._tell, bed.device._settings.heater_off

        def silent(command: Any, value: float = 0.0) -> Any:
            with bed.device._asking():
                if command is off:
                    raise DeviceTimeout("no answer")
            return tell(command, value)

        monkeypatch.setattr(bed.device, "_tell", silent)
        with pytest.raises(NotSafe, match=r"set point .*295\.0 K"):
            bed.device.make_safe()
        assert bed.left_on() == ""


def test_a_heater_that_does_not_switch_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(BEDS["line_blackbody"]["talks-serial"], answer_s=0.2) as bed:
        bed.device.connect()
        tell, on = bed.device._tell, bed.device._settings.heater_on

        def deaf(command: Any, value: float = 0.0) -> Any:
            return None if command is on else tell(command, value)

        monkeypatch.setattr(bed.device, "_tell", deaf)
        with pytest.raises(ConfigRejected, match="the heater does not switch on"):
            bed.device.set_setpoint(440.0)


CELSIUS = {"temperature_unit": "celsius"}


def eurotherm(peer: ModbusPeer, **settings: Any) -> Any:
    line = {"serial": peer.serial} if peer.serial else {"host": peer.host, "port": peer.port}
    known = {
        **({} if "registers" in settings else {"model": "eurotherm-3200", **CELSIUS}),
        "limits_K": [283.0, 573.0],
        "answer_s": 0.3,
    }
    return load_driver("modbus_blackbody")({**known, **settings, **line}, CONTEXT)


@pytest.mark.parametrize(
    "ahead",
    [of_another, lambda answer: b"\x00\xff", lambda answer: answer[:4]],
    ids=["another unit's answer", "noise", "a part of an answer"],
)
def test_bytes_ahead_of_an_answer_are_waited_out(ahead: Callable[[bytes], bytes]) -> None:
    with ModbusPeer("eurotherm-3200", serial=True) as peer:
        peer.noise = ahead
        body = eurotherm(peer)
        body.connect()
        assert body.set_setpoint(440.0) == pytest.approx(440.0, abs=0.01)
        assert "found again" not in body.make_safe().did
        body.close()


def test_an_echo_is_named() -> None:
    """An adapter of RS-485 that echoes is no trouble where the controller answers as well."""
    with ModbusPeer("eurotherm-3200", serial=True) as peer:
        peer.noise = lambda answer: peer.request
        body = eurotherm(peer)
        body.connect()
        peer.replies.spoil(Fault.DROP, peer.replies.sent + 1, last=10**9)
        with pytest.raises(NotConnected, match="the request itself came back"):
            body.read_temperature()
        peer.replies.spoil(Fault.FOREIGN, peer.replies.sent + 1, last=10**9)
        with pytest.raises(NotConnected, match=r"no whole answer of unit 1: 01 03"):
            body.connect()
        body.close()


@pytest.mark.parametrize("unit", ["celsius", "fahrenheit", "kelvin"])
def test_the_unit_is_read_from_the_controller(unit: Unit) -> None:
    own = {name: getattr(MAPS["eurotherm-3200"], name) for name in ("temperature", "setpoint")}
    known = RegisterMap(**own, unit_register=100)
    with ModbusPeer(registers=known) as peer:
        peer.temperature_unit = unit
        registers = {"registers": known.model_dump()}
        body = eurotherm(peer, **registers)
        body.connect()
        assert body.set_setpoint(440.0) == pytest.approx(440.0, abs=0.01)
        assert peer.setpoint_K == pytest.approx(440.0, abs=0.01)
        assert body.read_configuration()["temperature_unit"] == unit
        body.close()
        after_a_crash = eurotherm(peer, **registers)  # has written before it knows the unit
        after_a_crash.take_over()
        after_a_crash.make_safe()
        assert peer.setpoint_K == pytest.approx(295.0, abs=0.01)
        stated = eurotherm(peer, **registers, **CELSIUS)
        if unit != "celsius":
            with pytest.raises(ConfigRejected, match=rf"unit is {unit} .*allowed: celsius"):
                stated.connect()
            stated.close()
        after_a_crash.close()


def test_a_rejected_blind_set_point_does_not_leave_it_hot() -> None:
    """In a controller in kelvin, 21.85 is below its lower limit: it rejects what another process,
    after a crash, writes as degrees Celsius before it has read the unit."""
    own = {name: getattr(MAPS["eurotherm-3200"], name) for name in ("temperature", "setpoint")}
    known = RegisterMap(**own, unit_register=100)
    with ModbusPeer(registers=known, start_K=440.0) as peer:
        peer.temperature_unit, peer.least_K = "kelvin", 273.0
        after_a_crash = eurotherm(peer, registers=known.model_dump())
        after_a_crash.take_over()
        assert after_a_crash.make_safe().connected
        assert peer.setpoint_K == pytest.approx(295.0, abs=0.01)
        after_a_crash.close()


@pytest.mark.parametrize("model", ["ir-2100", "eurotherm-3200"])
def test_a_unit_that_no_register_gives_is_stated(model: str) -> None:
    with pytest.raises(SceneError, match="temperature_unit: required"):
        load_driver("modbus_blackbody")(
            {"host": "x", "model": model, "limits_K": [283, 500]}, CONTEXT
        )


@pytest.mark.parametrize(
    ("stated", "true", "reads", "in_stated"),
    [
        ("fahrenheit", "celsius", 21.9, 268),
        ("celsius", "kelvin", 295.0, 568),
        ("kelvin", "celsius", 165.0, 165),
    ],
)
def test_a_stated_unit_must_fit_the_reading(
    stated: Unit, true: Unit, reads: float, in_stated: int
) -> None:
    """A body at the temperature of a room, or a warm one; it is made safe all the same."""
    with ModbusPeer("eurotherm-3200", start_K=to_kelvin(reads, true)) as peer:
        peer.temperature_unit = true
        body = eurotherm(peer, temperature_unit=stated, limits_K=[283.0, 500.0])
        with pytest.raises(
            ConfigRejected,
            match=rf"temperature_unit: {stated}: in it the reading {reads} is {in_stated} K, "
            rf".*allowed: the unit at its front panel, which the reading fits \(.*{true}: ",
        ):
            body.connect()
        body.take_over()
        assert body.make_safe().connected
        body.close()


def test_a_body_beyond_its_limits_is_not_one_of_another_unit() -> None:
    """4 % over the upper limit, where the same number in degrees F would be within the limits."""
    with ModbusPeer("eurotherm-3200", start_K=520.0) as peer:
        body = eurotherm(peer, limits_K=[300.0, 500.0])
        body.connect()
        body.close()


def test_a_stated_unit_is_checked() -> None:
    """A query of the rig file, with the answer that its unit has."""
    settings = {"unit_check": {"send": "UNIT?", "answer": "C"}, **BARE, "answer_s": 0.3}
    answers = {b"UNIT?": b"F\r\n", b"T?": b"71.3\r\n"}
    server = LineServer("127.0.0.1", 0, lambda line: answers[line.strip()], Replies())
    try:
        body = load_driver("line_blackbody")(
            {**settings, "host": "127.0.0.1", "port": server.port}, CONTEXT
        )
        with pytest.raises(NotConnected, match=r"answered 'F' to UNIT.*expected C"):
            body.connect(1.0)
        answers[b"UNIT?"] = b"C\r\n"
        body.connect()
        body.close()
    finally:
        server.close()
