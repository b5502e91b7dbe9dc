"""Black bodies whose controller speaks Modbus: Eurotherm 3200, Infrared Systems IR-2100.

Register maps: Eurotherm 3200 engineering manual (HA028651), floats at 0x8000 + 2n; Infrared
Systems IR-2100 manual. Both work in degrees Celsius.

Eurotherm keeps SP1 (24) in a memory that wears out: it is written only when it changes, which is
once for each background.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, NotConnected
from cldit.rig.protocols import DeviceInfo
from cldit.scene.checks import Within

from .controller import KELVIN, BlackBody, ControllerSettings, check_readback


@dataclass(frozen=True)
class RegisterMap:
    """Where a controller keeps what. `tenths`: °C times 10 as int16; else float32 at 0x8000+2n."""

    maker: str
    tenths: bool
    temperature: int
    setpoint: int
    extra: dict[str, int]  # further registers, plain integers, for the stored configuration
    baudrate: int


MAPS = {
    "eurotherm-3200": RegisterMap("Eurotherm", False, 1, 24, {}, 9600),
    "ir-2100": RegisterMap(
        "Infrared Systems", True, 100, 300, {"model_code": 0, "error_code": 101}, 19200
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


class ModbusBlackBody(BlackBody[ModbusSettings]):
    """A `cldit.rig.protocols.Background`."""

    def __init__(self, settings: ModbusSettings, context: RigContext) -> None:
        super().__init__(settings, context.clock)
        self._map = MAPS[settings.model]
        self._client: Any = None

    def connect(self, timeout_s: float = 10.0) -> None:
        if self._client is not None:
            return
        from pymodbus.client import ModbusSerialClient, ModbusTcpClient

        settings = self._settings
        wait_s = min(timeout_s, settings.answer_s)
        if settings.host is not None:
            where = f"{settings.host}:{settings.port}"
            client: Any = ModbusTcpClient(
                settings.host, port=settings.port, timeout=wait_s, retries=1
            )
        else:
            where = str(settings.serial)
            client = ModbusSerialClient(
                where,
                baudrate=settings.baudrate or self._map.baudrate,
                timeout=wait_s,
                retries=1,
            )
        self._client = client
        try:
            if not client.connect():
                raise NotConnected(f"{where} does not answer")
            self.read_temperature()
        except Exception as error:
            self.close()
            raise NotConnected(
                f"background: {settings.model}: {where}: {error}; check that it is switched on, "
                "its address, and that nobody else uses the line"
            ) from error

    def close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def identify(self) -> DeviceInfo:
        maker, model = self._map.maker, self._settings.model
        return DeviceInfo("background", maker, model, tested_on_hardware=False)

    def read_configuration(self) -> dict[str, Any]:
        return {
            **self._settings.model_dump(mode="json"),
            "setpoint_K": self._get(self._map.setpoint),
            **{name: self._registers(at, 1)[0] for name, at in self._map.extra.items()},
        }

    def make_safe(self) -> None:
        if self._client is not None:
            self._aim(self._settings.safe_setpoint_K)

    def read_temperature(self) -> float:
        return self._get(self._map.temperature)

    def is_stable(self) -> bool | None:
        """These controllers have no flag of their own."""
        return None

    def _aim(self, temperature_K: float) -> float:
        celsius = temperature_K - KELVIN
        words = self._encode(celsius)
        address = self._address(self._map.setpoint)
        if self._registers(address, len(words)) != words:
            self._ask("write_registers", address, words)
        return check_readback(temperature_K, self._get(self._map.setpoint))

    def _get(self, register: int) -> float:
        """Kelvin."""
        words = self._registers(self._address(register), 1 if self._map.tenths else 2)
        raw = b"".join(word.to_bytes(2, "big") for word in words)
        if self._map.tenths:
            return int(struct.unpack(">h", raw)[0]) / 10.0 + KELVIN
        return float(struct.unpack(">f", raw)[0]) + KELVIN

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
        answer = self._ask("read_holding_registers", address, count)
        if len(answer.registers) != count:
            raise NotConnected(f"background: {len(answer.registers)} registers, expected {count}")
        return list(answer.registers)

    def _ask(self, what: str, address: int, value: int | list[int]) -> Any:
        if self._client is None:
            raise NotConnected("background: is not connected; call connect()")
        from pymodbus.exceptions import ModbusException

        named = {"count" if what.startswith("read") else "values": value}
        try:
            answer = getattr(self._client, what)(address, device_id=self._settings.unit, **named)
        except (ModbusException, OSError) as error:
            raise NotConnected(
                f"background: no answer at register {address} ({error}); check the line"
            ) from error
        if answer.isError():
            raise ConfigRejected(f"background: the controller refuses register {address}: {answer}")
        return answer


def open_modbus_blackbody(settings: dict[str, Any], context: RigContext) -> ModbusBlackBody:
    """The driver `modbus_blackbody`."""
    return ModbusBlackBody(check_settings(ModbusSettings, settings), context)
