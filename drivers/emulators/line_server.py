"""A TCP server of text lines, which two of the peers are."""

from __future__ import annotations

import socketserver
import threading
from collections.abc import Callable
from typing import Any

from cldit.testing.replies import Replies

TEXT = slice(0, -2)  # of a reply that ends with CR LF


class LineServer:
    """Listens from when it is made on `port`, which is a free one if 0 is asked for.

    Args:
        answer: what goes back for a line, nothing for a command that has no answer.
        replies: the way of those answers.
    """

    def __init__(
        self, host: str, port: int, answer: Callable[[bytes], bytes], replies: Replies
    ) -> None:
        links: set[Any] = set()

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                links.add(self.connection)
                try:
                    for line in self.rfile:
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
        """Cuts every connection; new ones are taken again."""
        for link in list(self._links):
            try:
                link.shutdown(2)
            except OSError:
                continue

    def close(self) -> None:
        self.unplug()
        self._server.shutdown()
        self._server.server_close()
