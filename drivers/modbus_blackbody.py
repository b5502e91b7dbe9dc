"""Black bodies whose controller speaks Modbus: Eurotherm 3200, Infrared Systems IR-2100.

Register maps: Eurotherm 3200 engineering manual (HA028651), floats at 0x8000 + 2n; Infrared
Systems IR-2100 manual. Both work in degrees Celsius.

Eurotherm keeps SP1 (24) in a memory that wears out: it is written only when it changes, which is
once for each background.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

from cldit.rig.checks import check_answer, check_temperature
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, NotConnected
from cldit.rig.link import Linked, LinkState
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within

from .controller import KELVIN, BlackBody, ControllerSettings

T = TypeVar("T")


@dataclass(frozen=True)
class RegisterMap:
    """Where a controller keeps what. `tenths`: °C times 10 as int16; else float32 at 0x8000+2n.

    first_words: how many registers, from the temperature's on, are read first on a line; more
    than are read at once later.
    """

    maker: str
    tenths: bool
    temperature: int
    setpoint: int
    extra: dict[str, int]  # further registers, plain integers, for the stored configuration
    baudrate: int
    first_words: int


MAPS = {
    "eurotherm-3200": RegisterMap("Eurotherm", False, 1, 24, {}, 9600, 4),
    "ir-2100": RegisterMap(
        "Infrared Systems", True, 100, 300, {"model_code": 0, "error_code": 101}, 19200, 2
    ),
}


ABOUT = DriverAbout(
    "background",
    "Eurotherm 3200, Infrared Systems IR-2100, Modbus over TCP or serial",
    "untested on hardware; tested with pymodbus' server, which minimalmodbus agrees with",
    needs=("pymodbus", "serial"),
)


class ModbusSettings(ControllerSettings):
    model: Literal["eurotherm-3200", "ir-2100"]
    port: Annotated[int, Within(1, 65535)] = 502
    baudrate: Annotated[int, Within(300, 1_000_000)] | None = None  # the controller's usual one
    unit: Annotated[int, Within(1, 247)] = 1
    answer_s: Annotated[float, Within(0.01, 60.0)] = 1.0


class ModbusBlackBody(Linked, BlackBody[ModbusSettings]):
    """A `cldit.rig.protocols.Background`."""

    def __init__(self, settings: ModbusSettings, context: RigContext) -> None:
        Linked.__init__(
            self,
            "background",
            f"{settings.model} at {settings.where}",
            by_hand="lower its set point at its front panel, or switch its mains off",
        )
        BlackBody.__init__(self, settings, context.clock)
        self._map = MAPS[settings.model]
        self._client: Any = None

    def _open(self, timeout_s: float) -> None:
        from pymodbus.client import ModbusSerialClient, ModbusTcpClient

        settings = self._settings
        # No retries of pymodbus' own: the answer to the first request could come to the second.
        options: dict[str, Any] = {"timeout": min(timeout_s, settings.answer_s), "retries": 0}
        if settings.host is not None:
            self._client = ModbusTcpClient(settings.host, port=settings.port, **options)
        else:
            baudrate = settings.baudrate or self._map.baudrate
            self._client = ModbusSerialClient(settings.where, baudrate=baudrate, **options)
        try:
            if not self._client.connect():
                raise NotConnected(f"{settings.where} does not answer")
            # Nobody asks for so many registers else: what was late for somebody shows by its size.
            with suppress(ConfigRejected):  # a refusal is an answer to this question, too
                self._registers(self._address(self._map.temperature), self._map.first_words)
            self.read_temperature()
        except Exception as error:
            raise NotConnected(
                f"background: {self._where}: {error}; check that it is switched on, its address, "
                "and that nobody else uses the line"
            ) from error

    def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with suppress(Exception):  # it is gone already
                client.close()

    def _last_known(self) -> str:
        return str(self._setpoint)

    def identify(self) -> DeviceInfo:
        maker, model = self._map.maker, self._settings.model
        return DeviceInfo("background", maker, model, tested_on_hardware=False)

    def read_configuration(self) -> dict[str, Any]:
        return {
            **self._settings.model_dump(mode="json"),
            "setpoint_K": self._get(self._map.setpoint),
            **{name: self._registers(at, 1)[0] for name, at in self._map.extra.items()},
        }

    def _still(self) -> str:
        return f"set point {self._aim(self._settings.safe_setpoint_K):.1f} K"

    def read_temperature(self) -> float:
        return self._get(self._map.temperature)

    def is_stable(self) -> bool | None:
        """These controllers have no flag of their own."""
        return None

    def _aim(self, temperature_K: float) -> float:
        self._setpoint.written(f"{temperature_K:.1f} K")
        celsius = temperature_K - KELVIN
        words = self._encode(celsius)
        address = self._address(self._map.setpoint)
        if self._registers(address, len(words)) != words:
            self._write(address, words)
        return self._confirmed(temperature_K, self._get(self._map.setpoint))

    def _get(self, register: int) -> float:
        """Kelvin."""

        def kelvin(words: list[int]) -> float:
            raw = b"".join(word.to_bytes(2, "big") for word in words)
            what = f"register {register}"
            if self._map.tenths:
                celsius = int(struct.unpack(">h", raw)[0]) / 10.0
            else:
                celsius = check_answer("background", what, float(struct.unpack(">f", raw)[0]))
            return check_temperature("background", what, celsius + KELVIN)

        return self._read(self._address(register), 1 if self._map.tenths else 2, kelvin)

    def _encode(self, celsius: float) -> list[int]:
        if self._map.tenths:
            tenths = round(10.0 * celsius)
            if not -(2**15) <= tenths < 2**15:
                raise ConfigRejected(f"background: {celsius:.1f} °C does not fit the controller")
            return [tenths & 0xFFFF]
        raw = struct.pack(">f", celsius)
        return [int.from_bytes(raw[:2], "big"), int.from_bytes(raw[2:], "big")]

    def _address(self, register: int) -> int:
        return register if self._map.tenths else 0x8000 + 2 * register

    def _registers(self, address: int, count: int) -> list[int]:
        return self._read(address, count, list)

    def _read(self, address: int, count: int, parse: Callable[[list[int]], T]) -> T:
        def parsed(answer: Any) -> T:
            if len(answer.registers) != count:
                raise NotConnected(
                    f"background: {len(answer.registers)} registers came for register {address}, "
                    f"expected {count}"
                )
            return parse(answer.registers)

        return self._ask("read_holding_registers", address, {"count": count}, parsed)

    def _write(self, address: int, words: list[int]) -> None:
        def written(answer: Any) -> None:
            if (answer.address, answer.count) != (address, len(words)):
                raise NotConnected(
                    f"background: {answer} came for writing {len(words)} registers at {address}"
                )

        self._ask("write_registers", address, {"values": words}, written)

    def _ask(self, what: str, address: int, named: dict[str, Any], parse: Callable[[Any], T]) -> T:
        """An answer that was lost or spoiled, as noise on a long line does it, is asked for once
        more on a line that was opened anew: whatever is asked here may be asked twice."""
        was_open = self._state is LinkState.OPEN
        try:
            return self._exchange(what, address, named, parse)
        except NotConnected:
            if not was_open:
                raise
        self.connect(self._settings.answer_s)
        return self._exchange(what, address, named, parse)

    def _exchange(
        self, what: str, address: int, named: dict[str, Any], parse: Callable[[Any], T]
    ) -> T:
        with self._asking():
            try:
                answer = getattr(self._client, what)(
                    address, device_id=self._settings.unit, **named
                )
            except Exception as error:  # of pymodbus, of pyserial, of bytes that mean nothing
                raise NotConnected(
                    f"background: no answer at register {address} ({error}); check the line"
                ) from error
            if answer.isError():
                raise ConfigRejected(
                    f"background: the controller refuses register {address}: {answer}"
                )
            return parse(answer)


def open_modbus_blackbody(settings: dict[str, Any], context: RigContext) -> ModbusBlackBody:
    """The driver `modbus_blackbody`."""
    return ModbusBlackBody(check_settings(ModbusSettings, settings), context)
