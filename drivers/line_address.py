"""Settings of drivers for an instrument on TCP or a serial line: its address."""

from typing import Annotated

from pydantic import model_validator

from cldit.rig.locks import serial_address, tcp_address
from cldit.scene.checks import Section, Within


class LineAddress(Section):
    host: str | None = None  # on TCP, or that of a serial server
    port: Annotated[int, Within(1, 65535)]
    serial: str | None = None  # /dev/ttyUSB0, COM3
    answer_s: Annotated[float, Within(0.01, 60.0)]

    @model_validator(mode="after")
    def _one_line(self) -> "LineAddress":
        if (self.host is None) == (self.serial is None):
            raise ValueError("host, serial: allowed: one of the two")
        return self

    @property
    def where(self) -> str:
        """Address for messages, and name of a serial line."""
        return f"{self.host}:{self.port}" if self.host is not None else str(self.serial)

    @property
    def resource(self) -> str:
        """Name for VISA."""
        if self.host is not None:
            return f"TCPIP::{self.host}::{self.port}::SOCKET"
        return f"ASRL{self.serial}::INSTR"

    def address(self) -> str:
        """Address by which the instrument is locked."""
        if self.host is not None:
            return tcp_address(self.host, self.port)
        return serial_address(str(self.serial))
