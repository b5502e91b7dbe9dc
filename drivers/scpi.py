"""Text commands over TCP or a serial line, by pyvisa with pyvisa-py."""

from __future__ import annotations

from typing import Any

from cldit.rig.errors import DeviceTimeout, NotConnected
from cldit.rig.protocols import DeviceInfo


class ScpiLink:
    """One line out, one line back. Every failure of the link is one of the rig's errors.

    Args:
        name: the device in messages.
        resource: as VISA writes it: `TCPIP::HOST::PORT::SOCKET` or `ASRL/dev/ttyUSB0::INSTR`.
        options: further attributes of the pyvisa resource (`baud_rate`).
    """

    def __init__(self, name: str, resource: str, **options: Any) -> None:
        self._name = name
        self._resource = resource
        self._options = options
        self._manager: Any = None
        self._visa: Any = None

    @property
    def is_open(self) -> bool:
        return self._visa is not None

    def open(self, timeout_s: float) -> None:
        """Raises NotConnected; does nothing where it is open."""
        if self._visa is not None:
            return
        import pyvisa

        milliseconds = max(1, round(1e3 * timeout_s))
        try:
            self._manager = pyvisa.ResourceManager("@py")
            self._visa = self._manager.open_resource(
                self._resource,
                open_timeout=milliseconds,
                timeout=milliseconds,
                read_termination="\n",
                write_termination="\n",
                **self._options,
            )
        except Exception as error:  # pyvisa, pyserial and the system raise their own
            self.close()
            raise NotConnected(
                f"{self._name}: {self._resource} does not answer ({error}); check that it is "
                "switched on, and its address"
            ) from error

    def close(self) -> None:
        visa, manager, self._visa, self._manager = self._visa, self._manager, None, None
        for item in (visa, manager):
            if item is not None:
                try:
                    item.close()
                except Exception:  # it is gone already
                    continue

    def write(self, command: str) -> None:
        """Raises NotConnected, DeviceTimeout."""
        self._guard(lambda: self._visa.write(command), command)

    def query(self, command: str) -> str:
        """The answer without white space around it. Raises NotConnected, DeviceTimeout."""
        return str(self._guard(lambda: self._visa.query(command), command)).strip()

    def identity(self, model: str) -> DeviceInfo:
        """Who answers. Raises NotConnected where the model does not begin with `model`."""
        answer = self.query("*IDN?")
        parts = [part.strip() for part in answer.split(",")]
        if len(parts) != 4 or not parts[1].startswith(model):
            raise NotConnected(f"{self._name}: {answer!r} answers, expected a {model}")
        maker, name, serial, firmware = parts
        return DeviceInfo(self._name, maker, name, serial, firmware, tested_on_hardware=False)

    def number(self, command: str) -> float:
        """Raises NotConnected, also where the answer is no number."""
        answer = self.query(command)
        try:
            return float(answer)
        except ValueError as error:
            raise NotConnected(
                f"{self._name}: {answer!r} came for {command}, expected a number; is another "
                "program talking to it?"
            ) from error

    def _guard(self, action: Any, command: str) -> Any:
        if self._visa is None:
            raise NotConnected(f"{self._name}: is not connected; call connect()")
        import pyvisa

        try:
            return action()
        except pyvisa.errors.VisaIOError as error:
            # After a time-out the late answer would be taken for that of the next command.
            self.close()
            if error.error_code == pyvisa.constants.StatusCode.error_timeout:
                raise DeviceTimeout(f"{self._name}: no answer to {command}") from error
            raise self._broken(command, error) from error
        except Exception as error:
            self.close()
            raise self._broken(command, error) from error

    def _broken(self, command: str, error: Exception) -> NotConnected:
        return NotConnected(
            f"{self._name}: {self._resource} does not answer {command} ({error}); check that it "
            "is switched on, its address and its cable"
        )
