"""Text commands over TCP or a serial line, by pyvisa with pyvisa-py."""

import select
import socket
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import Any, TypeVar

from cldit.rig.checks import check_answer
from cldit.rig.errors import ConfigRejected, DeviceTimeout, HungUp, NotConnected, RigError
from cldit.rig.link import Linked
from cldit.rig.protocols import DeviceInfo

from .line_address import LineAddress

T = TypeVar("T")

_MANAGER = threading.Lock()  # pyvisa makes one resource manager per process, without a lock
_QUIET_s = 0.02  # 20 letters at 9600 baud, the slowest usual rate
_NO_WORDS = ("NAN", "OK")  # not entries of an enumeration: damaged, or late for a command
_STALE = 5  # late answers, and parts of some, that may arrive before an identity


class ScpiInstrument(Linked):
    """Instrument behind a line of text commands, `_line`; `info` is its identity until it is read.

    settings: its address, and the time to wait for an answer. by_hand: as for
    `cldit.rig.link.Linked`. baudrate: of a serial line. options: as for `ScpiLine`.
    """

    def __init__(
        self,
        info: DeviceInfo,
        settings: LineAddress,
        *,
        by_hand: str,
        baudrate: int | None = None,
        **options: Any,
    ) -> None:
        where = f"{info.model} at {settings.where}"
        super().__init__(info.kind, where, by_hand=by_hand, address=settings.address)
        self._info = info
        self._answer_s = settings.answer_s
        if settings.serial is not None:
            options["baud_rate"] = baudrate
        resource = settings.resource
        self._line = ScpiLine(info.kind, resource, self._asking, again=self._again, **options)

    def _open(self, timeout_s: float) -> None:
        self._line.open(min(timeout_s, self._answer_s))

    def _drop(self) -> None:
        self._line.close()

    def identify(self) -> DeviceInfo:
        return self._info


class ScpiLine:
    """Sends a line and reads a line, with errors of the rig.

    All lines of the process share pyvisa's resource manager, so none closes it.

    kind: the device in messages. resource: VISA name, `TCPIP::HOST::PORT::SOCKET` or
    `ASRL/dev/ttyUSB0::INSTR`. asking: context of each exchange, see `cldit.rig.link.Linked`.
    again: repeats an exchange, see there. quiet_s: silence after which a serial line counts as
    drained. options: further attributes of the pyvisa resource (`baud_rate`).
    """

    def __init__(
        self,
        kind: str,
        resource: str,
        asking: Callable[[], AbstractContextManager[None]],
        quiet_s: float = _QUIET_s,
        again: Callable[[Callable[[], Any]], Any] = lambda work: work(),
        **options: Any,
    ) -> None:
        self._kind = kind
        self._quiet_s = quiet_s
        self._resource = resource
        self._asking = asking
        self._again = again
        self._options = options
        self._visa: Any = None

    def add_options(self, **options: Any) -> None:
        """Adds attributes that only pyvisa can name."""
        self._options |= options

    def open(self, timeout_s: float) -> None:
        """Opens the line; raises NotConnected."""
        import pyvisa

        milliseconds = max(1, round(1e3 * timeout_s))
        try:
            with _MANAGER:
                manager = pyvisa.ResourceManager("@py")
            self._visa = manager.open_resource(
                self._resource,
                open_timeout=milliseconds,
                timeout=milliseconds,
                **{"read_termination": "\n", "write_termination": "\n", **self._options},
            )
            if self._resource.startswith("ASRL"):
                self._drain()
        except Exception as error:  # pyvisa, pyserial and the system raise their own
            self.close()
            raise NotConnected(
                f"{self._kind}: {self._resource} does not answer ({error}); check that it is "
                "switched on, and its address"
            ) from error

    def _drain(self) -> None:
        import pyvisa

        usual, self._visa.timeout = self._visa.timeout, round(1e3 * self._quiet_s)
        try:
            while True:
                self._visa.read_bytes(1)
        except pyvisa.errors.VisaIOError:  # nothing more
            self._visa.timeout = usual

    def close(self) -> None:
        visa, self._visa = self._visa, None
        if visa is not None:
            with suppress(Exception):  # already gone
                visa.close()

    def write(self, command: str) -> None:
        """Sends a command without an answer; raises NotConnected."""
        self._again(lambda: self._exchange(command, lambda: self._visa.write(command)))

    def query(self, command: str) -> str:
        """The answer without surrounding white space; raises NotConnected, DeviceTimeout."""
        return self.ask(command, str)

    def numbers(self, command: str, count: int) -> list[float]:
        """Finite numbers of an answer, separated by commas; raises as `query`."""

        def parse(answer: str) -> list[float]:
            values = [check_answer(self._kind, command, part) for part in answer.split(",")]
            if len(values) != count:
                raise self._odd(command, answer, f"{count} numbers")
            return values

        return self.ask(command, parse)

    def number(self, command: str) -> float:
        """The finite number of an answer; raises as `query`."""
        return self.numbers(command, 1)[0]

    def integer(self, command: str, *, once: bool = False) -> int:
        """The integer of an answer; raises as `query`. `once`: the command is never repeated."""

        def parse(answer: str) -> int:
            value = check_answer(self._kind, command, answer)
            if not value.is_integer():
                raise self._odd(command, answer, "a whole number")
            return int(value)

        return self.ask(command, parse, once=once)

    def flag(self, command: str) -> bool:
        """The flag of an answer, 0 or 1; raises as `query`."""

        def parse(answer: str) -> bool:
            value = check_answer(self._kind, command, answer)
            if value not in (0.0, 1.0):
                raise self._odd(command, answer, "0 or 1")
            return value == 1.0

        return self.ask(command, parse)

    def word(self, command: str) -> str:
        """The entry of an enumeration in capitals; raises as `query`."""

        def parse(answer: str) -> str:
            if not answer.isalpha() or answer.upper() in _NO_WORDS:
                raise self._odd(command, answer, "a word")
            return answer.upper()

        return self.ask(command, parse)

    def acknowledged(self, command: str, word: str, *, once: bool = False) -> None:
        """Sends a command to an instrument that answers `word` to each, or `?` and a number, which
        raises ConfigRejected; otherwise raises as `query`."""

        self.ask(command, lambda answer: self._acknowledge(command, word, answer), once=once)

    def _acknowledge(self, command: str, word: str, answer: str) -> None:
        if answer.startswith("?") and answer[1:].isdigit():
            raise ConfigRejected(f"{self._kind}: {self._resource} rejects {command} ({answer})")
        if answer.lower() != word:
            raise self._odd(command, answer, word)

    def identity(self, model: str) -> DeviceInfo:
        """Identity, as the first query on a line, because its answer is unique.

        Raises NotConnected unless the name of the model begins with `model`.
        """

        def parse(answer: str) -> DeviceInfo | None:
            parts = [part.strip() for part in answer.split(",")]
            if len(parts) != 4:
                return None
            maker, name, serial, firmware = parts
            if not name.startswith(model):
                raise self._odd("*IDN?", answer, f"a {model}")
            return DeviceInfo(self._kind, maker, name, serial, firmware, tested_on_hardware=False)

        return self.first("*IDN?", parse, f"a {model}")

    def first(self, command: str, parse: Callable[[str], T | None], expected: str) -> T:
        """Result of the first query on a line, after late answers to earlier programs.

        `parse` converts the unique answer, and returns None for others; `expected` describes it in
        the NotConnected that is raised without it.
        """

        def ask() -> T:
            answer = str(self._visa.query(command)).strip()
            for _ in range(_STALE):
                if (parsed := parse(answer)) is not None:
                    return parsed
                answer = str(self._visa.read()).strip()
            raise self._odd(command, answer, expected)

        return self._exchange(command, ask)

    def ask(
        self, command: str, parse: Callable[[str], T], *, once: bool = False, more_s: float = 0.0
    ) -> T:
        """Result of `parse` for the answer, whose errors but ConfigRejected break the link; raises
        as `query`. Unless `once`, the command may be repeated. `more_s`: additional time to wait
        for an instrument that answers when it is done."""

        def answer() -> T:
            usual, self._visa.timeout = self._visa.timeout, self._visa.timeout + 1e3 * more_s
            got = str(self._visa.query(command)).strip()
            self._visa.timeout = usual  # after an error, the line is closed
            return parse(got)

        def work() -> T:
            return self._exchange(command, answer)

        result: T = work() if once else self._again(work)
        return result

    def _check_session(self) -> None:
        """Raises HungUp if the other end closed the session; then nothing was sent."""
        if not self._resource.startswith("TCPIP"):
            return
        link = self._visa.visalib.sessions[self._visa.session].interface
        try:
            readable, _, _ = select.select([link], [], [], 0.0)
            closed = bool(readable) and not link.recv(1, socket.MSG_PEEK)
        except OSError:
            closed = True
        if closed:
            raise HungUp(
                f"{self._kind}: {self._resource} closed the session; check that it is switched on, "
                "and its time limit for idle sessions"
            )

    def _odd(self, command: str, answer: str, expected: str) -> NotConnected:
        return NotConnected(f"{self._kind}: answered {answer!r} to {command}, expected {expected}")

    def _exchange(self, command: str, action: Callable[[], T]) -> T:
        import pyvisa

        with self._asking():
            try:
                self._check_session()
                return action()
            except RigError:
                raise
            except Exception as error:
                timeout = pyvisa.constants.StatusCode.error_timeout
                if getattr(error, "error_code", None) == timeout:
                    raise DeviceTimeout(f"{self._kind}: no answer to {command}") from error
                raise NotConnected(
                    f"{self._kind}: {self._resource} does not answer {command} ({error}); check "
                    "that it is switched on, its address and its cable"
                ) from error
