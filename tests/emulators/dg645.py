"""Emulator of a DG645 on a loopback socket, for tests of the driver and of scripts.

From the manual it has registers that reading clears, an error queue, a rate error for a trigger
while busy, settings that abort the running cycle, bursts, and the inhibit input.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from tests.emulators.lines import Edge, PulsePeer

_SCALARS = {  # command: lowest, highest, value after *RST
    "TSRC": (0, 6, 5),
    "BURM": (0, 1, 0),
    "BURC": (1, 2**32 - 1, 2),
    "BURP": (1e-7, 2000.0, 1e-4),
    "BURD": (0.0, 2000.0, 0.0),
    "BURT": (0, 1, 0),
    "INHB": (0, 5, 0),
    "TLVL": (-3.5, 3.5, 1.0),
    "TRAT": (1e-6, 1e7, 1e3),
}
_BY_OUTPUT = {"LAMP": (0.5, 5.0, 2.5), "LOFF": (-2.0, 2.0, 0.0), "LPOL": (0, 1, 1)}
_WHOLE = {"TSRC", "BURM", "BURC", "BURT", "INHB", "LPOL"}
_NO_ABORT = {"INHB", "TLVL"}
_RANGE, _SYNTAX, _UNKNOWN = 10, 112, 111  # codes of LERR?
_NAMES = ("T0", "AB", "CD", "EF", "GH")


class Dg645Peer(PulsePeer):
    """Emulated DG645, a TCP server on `host`; `port` is known once it is entered.

    inhibit_input: level of the input at the back, which INHB gives a meaning. deaf: commands are
    read and never answered, as by an instrument that hangs. fail_rate: number of the next triggers
    that find the instrument busy.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        on_edge: Callable[[Edge], None] | None = None,
    ) -> None:
        super().__init__(on_edge)
        self.host, self.port = host, port
        self.inhibit_input = False
        self.deaf = False
        self.fail_rate = 0
        self._busy_until_s = 0.0
        self._running = self._in_burst = False
        self._insr = 0
        self._errors: deque[int] = deque()
        self._reset()

    def _obey(self, line: bytes) -> bytes:
        commands = line.decode("ascii", "replace").strip().split(";")
        answers = [self._answer(command.strip()) for command in commands]
        said = "".join(f"{answer}\r\n" for answer in answers if answer is not None)
        return b"" if self.deaf else said.encode()

    @property
    def busy(self) -> bool:
        return self._running or time.monotonic() < self._busy_until_s

    def injects(self, output: str) -> bool:
        """True if a trigger now would pulse the output."""
        first = 2 * _NAMES.index(output)
        with self._lock:
            return self._delay(first + 1) > self._delay(first)

    def _reset(self) -> None:
        self.values: dict[str, float] = {name: item[2] for name, item in _SCALARS.items()}
        self.values |= {
            f"{name} {output}": item[2] for name, item in _BY_OUTPUT.items() for output in range(5)
        }
        self.delays: dict[int, tuple[int, float]] = {0: (0, 0.0), 1: (0, 0.0)}
        self.delays |= {channel: (0, 0.0) for channel in range(2, 10)}

    def _delay(self, channel: int) -> float:
        reference, delay = self.delays[channel]
        return delay if channel < 2 else delay + self._delay(reference)

    def _answer(self, line: str) -> str | None:
        name, _, rest = line.partition(" ")
        name = name.upper()
        arguments = [part.strip() for part in rest.split(",")] if rest.strip() else []
        try:
            with self._lock:
                return self._command(name, arguments)
        except (ValueError, IndexError, KeyError):
            self._errors.append(_SYNTAX)
        return None

    def _command(self, name: str, arguments: list[str]) -> str | None:
        asked = name.endswith("?")
        bare = name.rstrip("?")
        if bare in _SCALARS or bare in _BY_OUTPUT:
            return self._value(bare, arguments, asked)
        if bare == "DLAY":
            return self._set_delay(arguments, asked)
        if name == "*IDN?":
            return "Stanford Research Systems,DG645,s/n001234,ver1.10.10E"
        if name == "*STB?":
            status = (2 if self.busy else 0) | (4 if self._in_burst else 0)
            return str(status | (1 if self._insr else 0))
        if name == "INSR?":
            status, self._insr = self._insr, 0
            return str(status)
        if name == "LERR?":
            return str(self._errors.popleft() if self._errors else 0)
        if name == "*ESR?":
            return "0"
        if name == "*CLS":
            self._insr = 0
            self._errors.clear()
        elif name == "*RST":
            self._abort()
            self._reset()
        elif name == "*TRG":
            self._trigger()
        elif name:
            self._errors.append(_UNKNOWN)
        return None

    def _value(self, name: str, arguments: list[str], asked: bool) -> str | None:
        low, high, _ = _SCALARS.get(name) or _BY_OUTPUT[name]
        key = name
        if name in _BY_OUTPUT:
            output = int(arguments.pop(0))
            key = f"{name} {output}"
        if asked:
            value = self.values[key]
            return f"{value:.0f}" if name in _WHOLE else f"{value:+.12g}"
        value = float(arguments[0])
        if key not in self.values or not low <= value <= high:
            self._errors.append(_RANGE)
            return None
        if name == "BURP":
            value = round(value / 1e-8) * 1e-8
        if value != self.values[key] and name not in _NO_ABORT:
            self._abort()
        self.values[key] = value
        return None

    def _set_delay(self, arguments: list[str], asked: bool) -> str | None:
        channel = int(arguments[0])
        if asked:
            reference, delay = self.delays[channel]
            return f"{reference},{delay:+.12f}"
        reference, delay = int(arguments[1]), float(arguments[2])
        if not 2 <= channel <= 9 or reference not in self.delays or not 0.0 <= delay < 2000.0:
            self._errors.append(_RANGE)
            return None
        chain = reference
        while chain >= 2 and chain != channel:
            chain = self.delays[chain][0]
        if chain == channel:  # linked in a circle
            self._errors.append(_RANGE)
            return None
        delay = round(delay / 5e-12) * 5e-12
        if (reference, delay) != self.delays[channel]:
            self._abort()
        self.delays[channel] = (reference, delay)
        return None

    def _abort(self) -> None:
        if self.busy:
            self._insr |= 1 << 5
        self._cycle += 1
        self._running = self._in_burst = False
        self._busy_until_s = 0.0

    def _trigger(self) -> None:
        if self.values["TSRC"] != 5:
            return
        if self.inhibit_input and self.values["INHB"] == 1:
            self._insr |= 1 << 4
            return
        if self.busy or self.fail_rate > 0:
            self.fail_rate = max(self.fail_rate - 1, 0)
            self._insr |= 1 << 1
            return
        self._insr |= 1
        self.triggers += 1
        self._cycle += 1
        burst = self.values["BURM"] == 1
        n = int(self.values["BURC"]) if burst else 1
        period_s = self.values["BURP"]
        cycle_s = max(self._delay(channel) for channel in self.delays) + 1e-6
        start_s = time.monotonic() + (self.values["BURD"] if burst else 0.0)
        self._running, self._in_burst = True, burst
        self._busy_until_s = start_s + (n - 1) * period_s + cycle_s
        threading.Thread(
            target=self._run, args=(self._cycle, n, period_s, start_s), daemon=True
        ).start()

    def _run(self, cycle: int, n: int, period_s: float, start_s: float) -> None:
        pulses = []
        with self._lock:
            silent = int(self.values["INHB"]) - 1 if self.inhibit_input else 0
            for number in range(1, 5):
                begin, end = self._delay(2 * number), self._delay(2 * number + 1)
                if end > begin and number > silent:
                    level = self.values[f"LAMP {number}"]
                    pulses.append(Edge(_NAMES[number], begin, end - begin, level))
        pulses.sort(key=lambda pulse: pulse.time_s)
        for index in range(n):
            if not self._send(cycle, pulses, start_s + index * period_s):
                return
        time.sleep(max(self._busy_until_s - time.monotonic(), 0.0))
        with self._lock:
            if cycle == self._cycle:
                self._insr |= (1 << 2) | ((1 << 3) if self._in_burst else 0)
                self._running = self._in_burst = False
