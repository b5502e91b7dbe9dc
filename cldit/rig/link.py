"""What this process owes an instrument once it was connected: to leave it harmless.

```
                 open()                lost or spoiled answer
    NEVER ----------------> OPEN ------------------------------> LOST
      ^  close(), after      |  ^                                 |
      |  make_safe()         |  +--- connect(), make_safe() ------+
      +----------------------+
                             |  close() while it may be on: CLOSED, which is owed as LOST is
```

`make_safe` of an instrument that is LOST or CLOSED reaches for it again, a few times and not for
long, and raises NotSafe where that fails. Only NEVER is a reason to do nothing.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum

from cldit.rig.errors import ConfigRejected, DeviceTimeout, NotConnected, NotSafe, RigError
from cldit.rig.protocols import Safety

_LEFT = 0.5  # part of the time for connecting that a second attempt needs
_TRIES = 3  # a link that is only out of step is in step again at the second


class LinkState(Enum):
    """Where an instrument stands; see the head of this file."""

    NEVER = "never connected, or let go of harmless"
    OPENING = "being opened"
    OPEN = "connected"
    LOST = "connected, then lost"
    CLOSED = "let go of before it was made safe"


class Told:
    """What an instrument confirmed last, and what was written to it since without an answer."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._words = ["not written"]

    def written(self, text: str) -> None:
        """Notes what was written without an answer."""
        self._words.append(text)

    def confirmed(self, text: str) -> None:
        """Notes what the instrument confirmed."""
        self._words = [text]

    def __str__(self) -> str:
        known, *since = self._words
        return f"{self._what} {known}" + (f" ({since[-1]} written since)" if since else "")


class Linked(ABC):
    """`connect`, `close` and `make_safe` of an instrument behind a line that can fail.

    A driver says how to open the line, how to drop it, what makes the instrument harmless and what
    it was last told. It wraps every exchange in `with self._asking():`.

    Args:
        kind: camera, background or trigger; messages begin with it.
        where: model and address, for whoever has to find the instrument.
        by_hand: what to do at the instrument itself where the computer cannot reach it.
        reach_s: how long `make_safe` reaches for a lost instrument.
    """

    def __init__(self, kind: str, where: str, *, by_hand: str, reach_s: float = 10.0) -> None:
        self._kind = kind
        self._where = where
        self._by_hand = by_hand
        self._reach_s = reach_s
        self._state = LinkState.NEVER
        self._harmless = False  # made safe, and nothing was asked since
        self._answered = False  # at least once since it was last harmless
        self._why_lost = ""
        self._unanswered = False  # an exchange failed since it began to open

    @abstractmethod
    def _open(self, timeout_s: float) -> None:
        """Opens the line and finds out who answers. Raises RigError."""

    @abstractmethod
    def _drop(self) -> None:
        """Lets go of the line, whatever state that is in. Never raises."""

    @abstractmethod
    def _still(self) -> str:
        """Makes the instrument harmless, and reads back that it is; what was done, in words.

        Raises RigError.
        """

    @abstractmethod
    def _last_known(self) -> str:
        """What the instrument was last told, in words, without asking it."""

    def connect(self, timeout_s: float = 10.0) -> None:
        """Raises NotConnected, ConfigRejected; does nothing where it is connected already."""
        if self._state is LinkState.OPEN:
            return
        before, self._state = self._state, LinkState.OPENING
        try:
            self._open_again(timeout_s)
        except BaseException as error:
            owed = self._answered or before is not LinkState.NEVER
            self._state = LinkState.LOST if owed else LinkState.NEVER
            self._why_lost = self._why_lost or str(error)
            self._drop()
            if isinstance(error, RigError) and not isinstance(error, NotConnected | ConfigRejected):
                raise NotConnected(str(error)) from error
            raise
        self._state, self._why_lost = LinkState.OPEN, ""

    def _open_again(self, timeout_s: float) -> None:
        """Opens the line, and once more where an answer was lost or spoiled on it, as noise does:
        whatever is asked while it opens may be asked twice."""
        self._unanswered = False
        start_s = time.monotonic()
        try:
            self._open(timeout_s)
        except (NotConnected, DeviceTimeout):
            left_s = timeout_s - (time.monotonic() - start_s)
            if not self._unanswered or left_s < _LEFT * timeout_s:
                raise
            self._drop()
            self._open(left_s)

    def close(self) -> None:
        """Lets go; an instrument that may be on stays owed to `make_safe`."""
        if self._state is LinkState.OPEN:
            self._state = LinkState.NEVER if self._harmless else LinkState.CLOSED
            self._answered = not self._harmless
        self._drop()

    def make_safe(self) -> Safety:
        """As `cldit.rig.protocols.Device.make_safe`.

        Raises:
            NotSafe: says which instrument, where, what it was last told, what to do by hand.
        """
        before, why = self._state, self._why_lost
        if before is LinkState.NEVER:
            return Safety(connected=False, did="nothing: it was not connected")
        start_s = time.monotonic()
        failures: list[str] = []
        while len(failures) < _TRIES:
            left_s = self._reach_s - (time.monotonic() - start_s)
            if failures and left_s <= 0.0:
                break
            try:
                self.connect(max(left_s, 0.1))
                did = self._still()
            except Exception as error:  # whatever it was, the instrument may be on
                failures.append(str(error))
                self._lose(error)
                continue
            self._harmless, self._answered = True, False
            if before is LinkState.CLOSED:
                self.close()
            found = "".join(f"; found again after: {text}" for text in (why, *failures) if text)
            return Safety(connected=True, did=did + found)
        lost = f"; it was lost before: {why}" if why else ""
        raise NotSafe(
            f"{self._where} could not be made safe: {failures[-1]}{lost}; tried {len(failures)} "
            f"times in {time.monotonic() - start_s:.1f} s. Last known: {self._last_known()}. "
            f"By hand: {self._by_hand}"
        )

    @contextmanager
    def _asking(self) -> Iterator[None]:
        """One exchange, its answer checked within. Where it fails, or is cut short by whatever
        exception, an answer may still come that would be taken for the next one's: the line is
        dropped. A ConfigRejected is an answer.

        Raises:
            NotConnected: the instrument is not connected, or is lost.
        """
        if self._state not in (LinkState.OPEN, LinkState.OPENING):
            raise NotConnected(
                f"{self._kind}: was lost ({self._why_lost}); connect() reaches for it again"
                if self._state is LinkState.LOST
                else f"{self._kind}: is not connected; call connect()"
            )
        self._harmless = False
        try:
            yield
        except BaseException as error:
            if isinstance(error, ConfigRejected):
                self._answered = True
            else:
                self._unanswered = True
                self._lose(error)
            raise
        self._answered = True

    def _lose(self, error: BaseException) -> None:
        """From OPEN to LOST; what is being opened, `connect` drops."""
        if self._state is LinkState.OPEN:
            self._state = LinkState.LOST
            self._why_lost = str(error) or type(error).__name__
            self._drop()
