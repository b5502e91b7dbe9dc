"""Black bodies with a Modbus controller: Eurotherm 3200, Infrared Systems IR-2100, and any other
by its registers in the rig file.

The SP1 (24) of Eurotherm is in a memory that wears out: it is written only if it changes, which is
once for each background.
"""

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any, Literal, TypeVar

from pydantic import model_validator

from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, NotConnected
from cldit.rig.link import Linked
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within

from .controller import UNITS, BlackBody, ControllerSettings, Unit, from_kelvin, to_kelvin
from .modbus_registers import MAPS, Register, RegisterMap

T = TypeVar("T")

_WRITE, _REJECTED = 16, 0x80  # function of a write, bit of a rejected one
_BUSY = 6  # exception: ask again later
_BUSY_PAUSES_s = (0.05, 0.1, 0.2, 0.4, 0.8)

ABOUT = DriverAbout(
    "background",
    "Eurotherm 3200, Infrared Systems IR-2100, others by their registers; Modbus, TCP or serial",
    "untested on hardware; tested with pymodbus' server, which minimalmodbus agrees with",
    needs=("pymodbus", "serial"),
)


class ModbusSettings(ControllerSettings):
    model: Literal["eurotherm-3200", "ir-2100"] | None = None
    registers: RegisterMap | None = None  # of another model, or in another use
    port: Annotated[int, Within(1, 65535)] = 502
    baudrate: Annotated[int, Within(300, 1_000_000)] | None = None  # None: the controller's default
    unit: Annotated[int, Within(1, 247)] = 1
    answer_s: Annotated[float, Within(0.01, 60.0)] = 1.0
    temperature_unit: Unit | None = None  # as at its front panel, if no register gives it

    @model_validator(mode="after")
    def _one_map(self) -> "ModbusSettings":
        if (self.model is None) == (self.registers is None):
            raise ValueError("model, registers: allowed: one of the two")
        if self.map.unit_register is None and self.stated_unit is None:
            raise ValueError(
                "temperature_unit: required, because no register gives it; allowed: the unit at "
                "the controller's front panel (celsius, fahrenheit, kelvin)"
            )
        return self

    @property
    def stated_unit(self) -> Unit | None:
        """Unit of the temperatures in the rig file."""
        return self.temperature_unit or self.map.unit

    def address(self) -> str:
        # Several controllers share a line; a serial one is of one program all the same.
        return super().address() + (f" unit {self.unit}" if self.host is not None else "")

    @property
    def map(self) -> RegisterMap:
        """The registers."""
        return self.registers if self.registers is not None else MAPS[str(self.model)]


class ModbusBlackBody(BlackBody[ModbusSettings], Linked):
    """Implements `cldit.rig.protocols.Background`."""

    _unit_key = "temperature_unit"

    def __init__(self, settings: ModbusSettings, context: RigContext) -> None:
        Linked.__init__(
            self,
            "background",
            f"{settings.map.model} at {settings.where}",
            by_hand="lower its set point at its front panel, or switch its mains off",
            address=settings.address,
        )
        BlackBody.__init__(self, settings, context.clock)
        self._map = settings.map
        self._unit = settings.stated_unit
        self._client: Any = None
        self._request = self._heard = b""  # on a serial line

    def _open(self, timeout_s: float) -> None:
        from pymodbus.client import ModbusSerialClient, ModbusTcpClient

        # Its errors are raised as the rig's; they need not appear on the terminal too.
        logging.getLogger("pymodbus").addHandler(logging.NullHandler())
        settings = self._settings
        # No retries by pymodbus: the answer to the first request could be taken for the second's.
        options: dict[str, Any] = {"timeout": min(timeout_s, settings.answer_s), "retries": 0}
        if settings.host is not None:
            self._client = ModbusTcpClient(settings.host, port=settings.port, **options)
        else:
            baudrate = settings.baudrate or self._map.baudrate
            self._client = ModbusSerialClient(
                settings.where, baudrate=baudrate, trace_packet=self._own_answer, **options
            )
        try:
            if not self._client.connect():
                raise NotConnected(f"{settings.where} does not answer")
        except Exception as error:
            raise NotConnected(
                f"background: {self._where}: {error}; check that it is switched on, its address, "
                "and that no other program uses the line"
            ) from error

    def _identify(self) -> None:
        # No other request has so many registers, so the size of a late answer gives it away.
        count = 2 * max(self._map.temperature.words, self._map.setpoint.words)
        with suppress(ConfigRejected):  # a rejection is an answer, too
            self._registers(self._map.temperature, count)
        self._check_unit()

    def _check_unit(self) -> None:
        """Reads the unit of the temperatures, if a register gives it; raises ConfigRejected."""
        at, stated = self._map.unit_register, self._settings.stated_unit
        if at is None:
            return
        code = self._registers(Register(address=at, format="uint16"), 1)[0]
        unit = UNITS[code] if code < len(UNITS) else None
        if unit is None or stated not in (None, unit):
            raise ConfigRejected(
                f"background: its unit is {unit or 'unknown'} (register {at}: {code}); "
                f"allowed: {stated or ', '.join(UNITS)}"
            )
        self._unit = unit

    def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with suppress(Exception):  # already gone
                client.close()

    def identify(self) -> DeviceInfo:
        maker, model = self._map.maker, self._map.model
        return DeviceInfo("background", maker, model, tested_on_hardware=False)

    def read_configuration(self) -> dict[str, Any]:
        return {
            **self._settings.model_dump(mode="json"),
            "temperature_unit": self._unit,
            "setpoint_K": self._get(self._map.setpoint),
            **{
                name: self._registers(Register(address=at, format="uint16"), 1)[0]
                for name, at in self._map.extra.items()
            },
        }

    def _write_safe(self) -> None:
        safe_K, register = self._settings.safe_setpoint_K, self._map.setpoint
        self._setpoint.written(f"{safe_K:.1f} K")
        self._write(register.address, self._encoded(register, safe_K))

    def _check_safe(self) -> str:
        got_K = self._confirmed(self._settings.safe_setpoint_K, self._get(self._map.setpoint))
        return self._described(got_K)

    def read_temperature(self) -> float:
        return self._get(self._map.temperature)

    def is_stable(self) -> bool | None:
        """Always None, because these controllers have no flag."""
        return None

    def _aim(self, temperature_K: float) -> float:
        self._setpoint.written(f"{temperature_K:.1f} K")
        register = self._map.setpoint
        words = self._encoded(register, temperature_K)
        if self._registers(register, len(words)) != words:
            self._write(register.address, words)
        return self._confirmed(temperature_K, self._get(register))

    def _encoded(self, register: Register, temperature_K: float) -> list[int]:
        return register.encode(from_kelvin(temperature_K, self._known_unit))

    def _get(self, register: Register) -> float:
        def kelvin(words: list[int]) -> float:
            query = f"register {register.address}"
            return self._plausible(query, to_kelvin(register.decode(words), self._known_unit))

        return self._read(register, register.words, kelvin)

    def _registers(self, start: Register, count: int) -> list[int]:
        return self._read(start, count, list)

    def _read(self, start: Register, count: int, parse: Callable[[list[int]], T]) -> T:
        def parsed(answer: Any) -> T:
            if len(answer.registers) != count:
                raise NotConnected(
                    f"background: answered {len(answer.registers)} registers to register "
                    f"{start.address}, expected {count}"
                )
            return parse(answer.registers)

        return self._ask(f"read_{start.table}_registers", start.address, {"count": count}, parsed)

    def _write(self, address: int, words: list[int]) -> None:
        def written(answer: Any) -> None:
            if (answer.address, answer.count) != (address, len(words)):
                raise NotConnected(
                    f"background: answered {answer} to {len(words)} registers written at {address}"
                )

        self._ask("write_registers", address, {"values": words}, written)

    def _own_answer(self, sending: bool, data: bytes) -> bytes:
        """Called by pymodbus for a request, and for all bytes that came since. Returns this unit's
        whole answer among them, or nothing, which waits on: a line also carries late answers, those
        of other units, and echoes."""
        from pymodbus.framer import FramerRTU

        if sending:
            self._request, self._heard = data, b""
            return data
        self._heard = data
        unit, function = self._request[:2]
        size = 8 if function == _WRITE else 5 + 2 * int.from_bytes(self._request[4:6], "big")
        for at in range(len(data)):
            for code, length in ((function, size), (function | _REJECTED, 5)):
                frame = data[at : at + length]
                complete = frame[:2] == bytes((unit, code)) and len(frame) == length
                if complete and FramerRTU.compute_CRC(frame[:-2]) == int.from_bytes(
                    frame[-2:], "big"
                ):
                    return frame
        return b""

    def _strange(self) -> str:
        """Describes the bytes that came instead of an answer on a serial line."""
        heard, unit = self._heard, self._settings.unit
        if not heard:
            return ""
        if heard == self._request:
            return "; the request itself came back: does the adapter echo, is the controller off?"
        return f"; {len(heard)} bytes came, no whole answer of unit {unit}: {heard[:12].hex(' ')}"

    def _ask(
        self, request: str, address: int, named: dict[str, Any], parse: Callable[[Any], T]
    ) -> T:
        """One exchange; every request may be sent twice."""

        def sent() -> Any:
            try:
                return getattr(self._client, request)(
                    address, device_id=self._settings.unit, **named
                )
            except Exception as error:  # of pymodbus, of pyserial, of damaged bytes
                raise NotConnected(
                    f"background: no answer at register {address} ({error}{self._strange()}); "
                    "check the line"
                ) from error

        def work() -> T:
            with self._asking():
                answer = sent()
                for pause_s in _BUSY_PAUSES_s:
                    if getattr(answer, "exception_code", 0) != _BUSY:
                        break
                    time.sleep(pause_s)
                    answer = sent()
                if answer.isError():
                    raise ConfigRejected(
                        f"background: the controller rejects register {address}: {answer}"
                    )
                return parse(answer)

        return self._again(work, NotConnected)


def open_modbus_blackbody(settings: dict[str, Any], context: RigContext) -> ModbusBlackBody:
    """The driver `modbus_blackbody`."""
    return ModbusBlackBody(check_settings(ModbusSettings, settings), context)
