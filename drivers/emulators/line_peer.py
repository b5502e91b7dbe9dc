"""What peers of text lines share: they answer at a loopback socket, or at a pseudo-terminal."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

from cldit.testing.replies import Replies

from .line_server import LineServer
from .terminal import Terminal


class AtOneLine(ABC):
    """Listens at `host`:`port`, or at `serial` where that is wanted, once it is entered."""

    host: str
    port: int
    serial: str | None
    replies: Replies
    _wants_serial: bool
    _way: LineServer | Terminal | None = None

    def __enter__(self) -> Self:
        if self._wants_serial:
            self._way = Terminal(self._obey, self.replies)
            self.serial = self._way.name
        else:
            self._way = LineServer(self.host, self.port, self._obey, self.replies)
            self.port = self._way.port
        return self

    def __exit__(self, *_: object) -> None:
        if self._way is not None:
            self._way.close()

    def unplug(self) -> None:
        """Cuts every connection of the socket; new ones are taken again."""
        if isinstance(self._way, LineServer):
            self._way.unplug()

    @abstractmethod
    def _obey(self, line: bytes) -> bytes:
        """The answer to a line; nothing for a command that has none."""
