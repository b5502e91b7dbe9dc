"""Emulators of black bodies on a loopback socket or a pseudo-terminal, for tests of the drivers.

The Modbus side is the server of pymodbus, an independent peer; a `Heater` gives the temperature.
"""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cldit.rig.clock import Clock
from cldit.testing.replies import BINARY_NAN, INTEGER_NONE, Fault, Replies
from tests.emulators.lines import AtOneLine, Terminals
from tests.patience import HANG_s

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from pymodbus.constants import ExcCodes

    from drivers.controller import UNITS, Unit, from_kelvin, to_kelvin
    from drivers.heater import Heater
    from drivers.modbus_registers import MAPS, RegisterMap
else:
    from cldit.drivers.controller import UNITS, Unit, from_kelvin, to_kelvin
    from cldit.drivers.heater import Heater
    from cldit.drivers.modbus_registers import MAPS, RegisterMap


def _summed(frame: bytes) -> bytes:
    """A frame of a serial line with its check sum."""
    from pymodbus.framer.rtu import FramerRTU

    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


def of_another(frame: bytes) -> bytes:
    """The same answer by the next unit on a serial line."""
    return _summed(bytes((frame[0] + 1,)) + frame[1:-2])


class Peer:
    """A cavity and its address, `host`:`port`, or `serial` for a pseudo-terminal; `replies` is the
    channel of its answers."""

    def __init__(
        self,
        *,
        clock: Clock | None = None,
        time_constant_s: float = 120.0,
        start_K: float = 295.0,
        serial: bool = False,
        port: int = 0,
    ) -> None:
        self.heater = Heater(clock or Clock(), start_K, time_constant_s)
        self.host, self.port = "127.0.0.1", port
        self.serial: str | None = None
        self.replies = Replies()
        self.writes = 0  # of the set point
        self.reads_K: float | None = None  # reading of a broken sensor
        self._wants_serial = serial

    @property
    def setpoint_K(self) -> float:
        return self.heater.setpoint_K

    def sensed_K(self) -> float:
        """Reading of the sensor, which may be broken."""
        return self.heater.now_K() if self.reads_K is None else self.reads_K

    def break_sensor(self, reads_K: float | None) -> None:
        """Makes the sensor read one temperature from now on; None repairs it."""
        self.reads_K = reads_K


class ModbusPeer(Peer):
    """Emulated controller with Modbus: a `model` of the driver (eurotherm-3200, ir-2100), or the
    `registers` of another."""

    def __init__(
        self,
        model: str | None = None,
        *,
        registers: RegisterMap | None = None,
        unit: int = 1,
        **options: Any,
    ) -> None:
        super().__init__(**options)
        self._map = registers or MAPS[str(model)]
        formats = {self._map.temperature.format, self._map.setpoint.format}
        self.replies = Replies(BINARY_NAN if formats == {"float32"} else INTEGER_NONE)
        self.temperature_unit: Unit = self._map.unit or "celsius"
        self._unit = unit
        self._loop: asyncio.AbstractEventLoop | None = None
        self._server: Any = None
        self._terminals = Terminals()
        self._master = -1
        self.noise: Callable[[bytes], bytes] = lambda answer: b""  # ahead of it, on a serial line
        self.least_K = 0.0  # set points below it are rejected
        self.request = b""

    def __enter__(self) -> ModbusPeer:
        if self._wants_serial:
            self._master, slave = self._terminals.pair()
            self.serial = os.ttyname(slave)
        ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(ready)), daemon=True)
        self._thread.start()
        if not ready.wait(HANG_s):
            raise RuntimeError("the Modbus server does not start")
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()
        self._terminals.close()

    def unplug(self) -> None:
        """Ends the server, as if the instrument were switched off."""
        if self._loop is not None and self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(HANG_s)
            self._thread.join(HANG_s)

    def hang_up(self) -> None:
        """Closes all connections of the socket; new ones are accepted."""
        if self._loop is not None and self.serial is None:

            async def close() -> None:
                for link in list(self._server.active_connections.values()):
                    link.close()

            asyncio.run_coroutine_threadsafe(close(), self._loop).result(HANG_s)

    async def _serve(self, ready: threading.Event) -> None:
        from pymodbus.server import ModbusSerialServer, ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice

        data = [
            SimData(start, count=len(words), values=0, datatype=DataType.REGISTERS)
            for start, words in self._words().items()
        ]
        device = SimDevice(self._unit, simdata=data, action=self._act)
        if self.serial is None:
            self._server = ModbusTcpServer(
                device, address=(self.host, self.port), trace_packet=self._trace
            )
        else:
            self._server = ModbusSerialServer(
                device, port=self._master_path(), baudrate=19200, trace_packet=self._trace
            )
        self._loop = asyncio.get_running_loop()
        serving = asyncio.create_task(self._server.serve_forever(background=False))
        while self._server.transport is None:
            await asyncio.sleep(0.005)
        if self.serial is None:
            self.port = self._server.transport.sockets[0].getsockname()[1]
        ready.set()
        try:
            await serving
        except asyncio.CancelledError:
            return

    def _trace(self, sending: bool, packet: bytes) -> bytes:
        """A packet as it leaves; the whole server waits for one that is late."""
        if not sending:
            self.request = packet
            return packet
        # The data are after unit, function and number of bytes, within six bytes or a check sum.
        struck = self.replies.struck
        if self.serial is None:
            sent = self.replies.passed(packet, slice(9, None))
            foreign = struck < self.replies.struck and self.replies.fault is Fault.FOREIGN
            return sent[:6] + bytes((sent[6] + 1,)) + sent[7:] if foreign else sent
        sent = self.replies.passed(packet, slice(3, -2))
        if struck < self.replies.struck and self.replies.fault is Fault.FOREIGN:
            sent = of_another(packet)
        elif struck < self.replies.struck and self.replies.fault is Fault.ODD:
            sent = _summed(sent[:-2])  # no damage of the line: its check sum is right
        return self.noise(packet) + sent

    def _master_path(self) -> str:
        """Path of a second terminal, coupled to the first: the server opens its end by name."""
        far_master, far = self._terminals.pair()
        self._terminals.read(self._master, lambda data: os.write(far_master, data))
        self._terminals.read(far_master, lambda data: os.write(self._master, data))
        return os.ttyname(far)

    async def _act(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        current: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Called before pymodbus stores `values`, or answers `current`, which begins at `start`."""
        setpoint = self._map.setpoint
        if values is not None and address == setpoint.address and len(values) == setpoint.words:
            self.writes += 1
            number = setpoint.decode([int(word) for word in values])
            wanted_K = to_kelvin(number, self.temperature_unit)
            if wanted_K < self.least_K:
                from pymodbus.constants import ExcCodes

                return ExcCodes.ILLEGAL_VALUE
            self.heater.aim(wanted_K)
        for register, words in self._words().items():
            at = register - start
            if 0 <= at <= len(current) - len(words):
                current[at : at + len(words)] = words
        return None

    def _words(self) -> dict[int, tuple[int, ...]]:
        """Present content of the registers, by address."""
        held: dict[int, tuple[int, ...]] = {
            at: (2100 if name == "model_code" else 0,) for name, at in self._map.extra.items()
        }
        if self._map.unit_register is not None:
            held[self._map.unit_register] = (UNITS.index(self.temperature_unit),)
        for register, kelvin in (
            (self._map.temperature, self.sensed_K()),
            (self._map.setpoint, self.heater.setpoint_K),
        ):
            held[register.address] = tuple(
                register.encode(from_kelvin(kelvin, self.temperature_unit))
            )
        return held


class FlukePeer(AtOneLine, Peer):
    """Emulated Fluke 4181."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.heating = False
        self.temperature_unit: Unit = "fahrenheit"  # as somebody left it
        self._limit_K = 0.5

    def _obey(self, line: bytes) -> bytes:
        name, _, value = line.decode("ascii", "replace").strip().upper().partition(" ")
        off_K = abs(self.heater.now_K() - self.heater.setpoint_K)
        answers = {
            "*IDN?": "FLUKE,4181,B12345,1.10",
            "SOUR:SPO?": f"{from_kelvin(self.heater.setpoint_K, self.temperature_unit):.2f}",
            "OUTP:STAT?": f"{int(self.heating)}",
            "SOUR:SENS:DATA?": f"{from_kelvin(self.sensed_K(), self.temperature_unit):.3f}",
            "SOUR:STAB:LIM?": f"{self._limit_K:.2f}",
            "SOUR:STAB:TEST?": f"{int(self.heating and off_K <= self._limit_K)}",
            "UNIT:TEMP?": self.temperature_unit[0].upper(),
        }
        if name in answers:
            return answers[name].encode() + b"\r\n"
        if name == "SOUR:SPO":
            self.writes += 1
            self.heater.aim(to_kelvin(float(value), self.temperature_unit))
        elif name == "UNIT:TEMP":
            self.temperature_unit = "celsius" if value == "C" else "fahrenheit"
        elif name == "OUTP:STAT":
            self.heating = value == "1"
        elif name == "SOUR:STAB:LIM":
            self._limit_K = float(value)
        return b""
