"""Lines to peers: text at a loopback socket or a pseudo-terminal, and pulses that leave a peer."""

from __future__ import annotations

import os
import select
import socketserver
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Self

from cldit.testing.replies import Replies
from tests.patience import HANG_s

TEXT = slice(0, -2)  # data of a reply that ends with CR LF

Answer = Callable[[bytes], bytes]  # the answer to a line; empty for a command without one


class LineServer:
    """TCP server of text lines from creation on, at `port`, or a free one for 0. `end` ends a line
    that comes in."""

    def __init__(
        self, host: str, port: int, answer: Answer, replies: Replies, end: bytes = b"\n"
    ) -> None:
        links: set[Any] = set()

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                links.add(self.connection)
                waiting = b""
                try:
                    while data := self.connection.recv(4096):
                        *lines, waiting = (waiting + data).split(end)
                        for line in lines:
                            self.wfile.write(replies.passed(answer(line), TEXT))
                except OSError:
                    return
                finally:
                    links.discard(self.connection)

        class Server(socketserver.ThreadingTCPServer):
            allow_reuse_address = True
            daemon_threads = True

        self._links = links
        self._server = Server((host, port), Handler)
        self.port = self._server.server_address[1]
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def unplug(self) -> None:
        """Closes all connections; new ones are accepted."""
        for link in list(self._links):
            try:
                link.shutdown(2)
            except OSError:
                continue

    def close(self) -> None:
        self.unplug()
        self._server.shutdown()
        self._server.server_close()


class Terminals:
    """Pseudo-terminals, and threads that read them until `close`."""

    def __init__(self) -> None:
        self._handles: list[int] = []
        self._readers: list[threading.Thread] = []
        self._on = True

    def pair(self) -> tuple[int, int]:
        """Opens both ends of a terminal."""
        import tty

        pair = os.openpty()
        for handle in pair:
            tty.setraw(handle)
        self._handles += pair
        return pair

    def read(self, handle: int, take: Callable[[bytes], object]) -> None:
        """Reads from a handle in a thread of its own."""

        def run() -> None:
            while self._on:
                try:
                    if select.select([handle], [], [], 0.02)[0]:
                        take(os.read(handle, 4096))
                except OSError:  # nobody has the other end open
                    time.sleep(0.02)

        self._readers.append(threading.Thread(target=run, daemon=True))
        self._readers[-1].start()

    def close(self) -> None:
        self._on = False
        for reader in self._readers:  # else one could read from the next owner of its number
            reader.join(HANG_s)
        for handle in self._handles:
            os.close(handle)
        self._handles.clear()


class Terminal(Terminals):
    """Answers lines that end with `end` at the terminal `name` from creation on."""

    def __init__(self, answer: Answer, replies: Replies, end: bytes = b"\n") -> None:
        super().__init__()
        master, slave = self.pair()
        self.name = os.ttyname(slave)
        waiting = bytearray()

        def take(data: bytes) -> None:
            waiting.extend(data)
            while end in waiting:
                line, _, rest = bytes(waiting).partition(end)
                waiting[:] = rest
                os.write(master, replies.passed(answer(line), TEXT))

        self.read(master, take)


class AtOneLine(ABC):
    """Listens at `host`:`port`, or at `serial` on request, once entered."""

    host: str
    port: int
    serial: str | None
    replies: Replies
    _wants_serial: bool = False
    _end = b"\n"  # of a line that comes in
    _line: LineServer | Terminal | None = None

    def __enter__(self) -> Self:
        if self._wants_serial:
            self._line = Terminal(self._obey, self.replies, self._end)
            self.serial = self._line.name
        else:
            self._line = LineServer(self.host, self.port, self._obey, self.replies, self._end)
            self.port = self._line.port
        return self

    def __exit__(self, *_: object) -> None:
        if self._line is not None:
            self._line.close()

    def unplug(self) -> None:
        """Closes all connections of the socket; new ones are accepted."""
        if isinstance(self._line, LineServer):
            self._line.unplug()

    @abstractmethod
    def _obey(self, line: bytes) -> bytes:
        """The answer to a line; empty for a command without one."""


@dataclass(frozen=True)
class Edge:
    """One pulse on one output, as an oscilloscope would show it."""

    output: str
    time_s: float  # of time.monotonic()
    width_s: float
    level_V: float


class PulsePeer(AtOneLine):
    """A generator. edges: all pulses sent, in order. triggers: number of bursts that began.
    on_edge: called at the time of each pulse, in a thread of the peer."""

    def __init__(self, on_edge: Callable[[Edge], None] | None) -> None:
        self.on_edge = on_edge
        self.edges: list[Edge] = []
        self.triggers = 0
        self.replies = Replies()
        self._lock = threading.RLock()
        self._cycle = 0  # counts what ends a burst that is being sent

    def pulses(self, output: str) -> list[Edge]:
        """Pulses sent on an output."""
        with self._lock:
            return [edge for edge in self.edges if edge.output == output]

    def _send(self, cycle: int, pulses: Iterable[Edge], begin_s: float) -> bool:
        """Sends pulses at their times after `begin_s`; False if the burst was ended."""
        for pulse in pulses:
            at_s = begin_s + pulse.time_s
            time.sleep(max(at_s - time.monotonic(), 0.0))
            edge = Edge(pulse.output, at_s, pulse.width_s, pulse.level_V)
            with self._lock:
                if cycle != self._cycle:
                    return False
                self.edges.append(edge)
            if self.on_edge is not None:
                self.on_edge(edge)
        return True
