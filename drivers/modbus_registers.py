"""Registers of a black body's controller: their addresses and formats of numbers.

Presets: Eurotherm 3200 engineering manual (HA028651), floats at 0x8000 + 2n; Infrared Systems
IR-2100 manual.
"""

import struct
from typing import Annotated, Literal

from pydantic import Field, model_validator

from cldit.rig.checks import check_answer
from cldit.rig.errors import ConfigRejected
from cldit.scene.checks import Section, Within

from .controller import Unit

_CODES = {"int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "float32": ">f"}


class Register(Section):
    """One number of the controller."""

    address: Annotated[int, Within(0, 65535)]
    """Address on the line, from 0."""
    format: Literal["int16", "uint16", "int32", "uint32", "float32"]
    """Format; 32 bits take two registers."""
    decimals: Annotated[int, Within(0, 4)] = 0
    """Decimals; with 1 the register contains tenths."""
    low_word_first: bool = False
    """True if the first of two registers has the lower 16 bits."""
    table: Literal["holding", "input"] = "holding"
    """Table, read with function 3 or 4."""

    @property
    def words(self) -> int:
        """Number of registers."""
        return struct.calcsize(_CODES[self.format]) // struct.calcsize("H")

    def encode(self, value: float) -> list[int]:
        """Converts a number to registers; raises ConfigRejected if it does not fit."""
        scaled = value * 10.0**self.decimals
        try:
            raw = struct.pack(
                _CODES[self.format], scaled if self.format == "float32" else round(scaled)
            )
        except (struct.error, OverflowError) as error:
            raise ConfigRejected(
                f"background: {value:.1f} does not fit register {self.address}, {self.format}"
            ) from error
        words = [*struct.unpack(f">{self.words}H", raw)]
        return words[::-1] if self.low_word_first else words

    def decode(self, words: list[int]) -> float:
        """Converts registers to a number; raises NotConnected if it is not finite."""
        ordered = words[::-1] if self.low_word_first else words
        raw = struct.pack(f">{len(words)}H", *ordered)
        number = float(struct.unpack(_CODES[self.format], raw)[0])
        return check_answer("background", f"register {self.address}", number) / 10.0**self.decimals


class RegisterMap(Section):
    """Registers of one model of controller."""

    maker: str = "unknown maker"
    model: str = "Modbus controller"
    unit: Unit | None = None
    """Unit of both registers; compared with that of `unit_register`, if there is one."""
    unit_register: Annotated[int, Within(0, 65535)] | None = None
    """Holding register that gives the unit: 0 Celsius, 1 Fahrenheit, 2 Kelvin."""
    temperature: Register
    """Process value."""
    setpoint: Register
    """Set point, written only if it changes, because some memories wear out."""
    extra: dict[str, Annotated[int, Within(0, 65535)]] = Field(default_factory=dict)
    """Further holding registers (integers), stored with every acquisition."""
    baudrate: Annotated[int, Within(300, 1_000_000)] = 9600
    """Default of the serial line."""

    @model_validator(mode="after")
    def _writable(self) -> "RegisterMap":
        if self.setpoint.table != "holding":
            raise ValueError("setpoint.table: input registers cannot be written; allowed: holding")
        return self


def _eurotherm(parameter: int) -> Register:
    return Register(address=0x8000 + 2 * parameter, format="float32")


def _tenths(address: int) -> Register:
    return Register(address=address, format="int16", decimals=1)


MAPS = {
    "eurotherm-3200": RegisterMap(
        maker="Eurotherm",
        model="eurotherm-3200",
        temperature=_eurotherm(1),
        setpoint=_eurotherm(24),
        baudrate=9600,
    ),
    "ir-2100": RegisterMap(
        maker="Infrared Systems",
        model="ir-2100",
        temperature=_tenths(100),
        setpoint=_tenths(300),
        extra={"model_code": 0, "error_code": 101},
        baudrate=19200,
    ),
}
