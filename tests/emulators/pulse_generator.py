"""Emulator of a BNC 575 or Quantum Composers 9530 on a loopback socket or a pseudo-terminal.

From the makers' manuals it has an answer `ok` or `?n` to each command, outputs that send one pulse
or a burst after they are switched on, and a step of 250 ps.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from tests.emulators.lines import Edge, PulsePeer

_CHANNELS = "ABCDEFGH"
_STEP_s = 250e-12
_PREFIX, _KEYWORD, _PARAMETER, _INVALID = "?1", "?3", "?4", "?5"
# Keyword: lowest, highest, first value, decimals; or the choices, of which the first is set.
_SYSTEM: dict[str, Any] = {
    "STAT": (0, 1, 0, 0),
    "PER": (50e-9, 5000.0, 1e-3, 9),
    "BCO": (1, 10**6, 5, 0),
    "MOD": ("NORM", "SING", "BURS", "DCYC"),
}
_CHANNEL: dict[str, Any] = {
    "STAT": (0, 1, 0, 0),
    "DEL": (-999.0, 999.99, 0.0, 11),
    "WIDT": (10e-9, 999.99, 1e-3, 11),
    "CMOD": ("NORM", "SING", "BURS", "DCYC"),
    "POL": ("NORM", "COMP", "INV"),
    "OUTP:MODE": ("TTL", "ADJ"),
    "OUTP:AMPL": (2.0, 20.0, 2.0, 3),
}
_TIMES = ("PER", "DEL", "WIDT")


def _channel(output: str) -> str:
    """Begin of the keywords of an output."""
    return f"PULSE{_CHANNELS.index(output) + 1}:"


class PulseGeneratorPeer(PulsePeer):
    """Emulated generator, which listens at `host`:`port`, or at `serial`, once entered.

    identity: answer to *IDN?. system, trigger: keywords of the settings that all outputs share, and
    of the external trigger's mode. outputs: their number. serial: replaces the socket by a
    pseudo-terminal.
    """

    def __init__(
        self,
        *,
        identity: str = "BNC,575-4,31309,2.4.1-1.2.2",
        system: str = "PULSE0",
        trigger: str = "TRIG:MOD",
        outputs: int = 4,
        serial: bool = False,
        on_edge: Callable[[Edge], None] | None = None,
    ) -> None:
        super().__init__(on_edge)
        self.host, self.port = "127.0.0.1", 0
        self.serial: str | None = None
        self._identity, self._system, self._outputs = identity, system, outputs
        self._known = {f"{system}:{name}": allowed for name, allowed in _SYSTEM.items()}
        self._known[f"{system}:{trigger}"] = ("DIS", "TRIG")
        for number in range(1, outputs + 1):
            self._known |= {f"PULSE{number}:{name}": item for name, item in _CHANNEL.items()}
        self.values: dict[str, Any] = {
            name: allowed[0] if isinstance(allowed[0], str) else allowed[2]
            for name, allowed in self._known.items()
        }
        self._wants_serial = serial

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._cycle += 1
        super().__exit__()

    def injects(self, output: str) -> bool:
        """True if the output would send a pulse with the next burst, or free-running."""
        return bool(self.values[f"{_channel(output)}STAT"])

    @property
    def running(self) -> bool:
        return bool(self.values[f"{self._system}:STAT"])

    def _obey(self, line: bytes) -> bytes:
        text = line.decode("ascii", "replace").strip()
        with self._lock:
            return f"{self._answer(text)}\r\n".encode()

    def _answer(self, text: str) -> str:
        if text.upper() == "*IDN?":
            return self._identity
        if text.upper() == ":INST:CAT?":
            return ", ".join(("T0", *(f"CH{name}" for name in _CHANNELS[: self._outputs])))
        if not text.startswith(":"):
            return _PREFIX
        name, _, value = text[1:].partition(" ")
        asked, name = name.endswith("?"), name.rstrip("?").upper()
        if name not in self._known:
            return _KEYWORD
        if asked:
            return self._said(name)
        if not value.strip():
            return _PARAMETER
        try:
            return self._set(name, value.strip().upper())
        except ValueError:
            return _INVALID

    def _said(self, name: str) -> str:
        value = self.values[name]
        return value if isinstance(value, str) else f"{value:.{self._known[name][3]}f}"

    def _set(self, name: str, value: str) -> str:
        allowed = self._known[name]
        if isinstance(allowed[0], str):
            if value not in allowed:
                return _INVALID
            self.values[name] = value
            return "ok"
        number = float({"ON": "1", "OFF": "0"}.get(value, value))
        if not allowed[0] <= number <= allowed[1]:
            return _INVALID
        if name.rpartition(":")[2] in _TIMES:
            number = round(number / _STEP_s) * _STEP_s
        before = self.values[name]
        self.values[name] = number
        if name == f"{self._system}:STAT" and number != before:
            self._cycle += 1
            if number:
                self._begin()
        return "ok"

    def _begin(self) -> None:
        """Starts the pulses of the outputs that are on."""
        mode = self.values[f"{self._system}:MOD"]
        n = {"SING": 1, "BURS": int(self.values[f"{self._system}:BCO"])}.get(mode, 10**6)
        self.triggers += 1
        pulses = sorted(
            (self.values[f"{channel}DEL"], _CHANNELS[number - 1], self.values[f"{channel}WIDT"])
            for number in range(1, self._outputs + 1)
            if self.values[(channel := f"PULSE{number}:") + "STAT"]
        )
        period_s = self.values[f"{self._system}:PER"]
        threading.Thread(
            target=self._run, args=(self._cycle, n, period_s, pulses), daemon=True
        ).start()

    def _run(
        self, cycle: int, n: int, period_s: float, pulses: list[tuple[float, str, float]]
    ) -> None:
        start_s = time.monotonic()
        edges = [
            Edge(output, delay_s, width_s, self.values[f"{_channel(output)}OUTP:AMPL"])
            for delay_s, output, width_s in pulses
        ]
        for index in range(n):
            if not self._send(cycle, edges, start_s + index * period_s):
                return
            time.sleep(1e-4)  # a burst without pulses, and one that runs freely, end here
            with self._lock:
                if cycle != self._cycle:
                    return
