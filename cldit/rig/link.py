"""Connection to an instrument, which this process must leave harmless once it was connected.

```
                 open()                lost or spoiled answer
    NEVER ----------------> OPEN ------------------------------> LOST
      ^  close(), after      |  ^                                 |
      |  make_safe()         |  +--- connect(), make_safe() ------+
      +----------------------+
                             |  close() while it may be on: CLOSED, to be made safe as LOST is
```

`make_safe` of an instrument that is LOST or CLOSED opens the line again, with a few attempts in a
limited time, and raises NotSafe if they fail. It does nothing in the state NEVER alone. An attempt
first writes everything that makes the instrument harmless, and only then needs an answer: where the
receiving direction alone is broken, a black body is cooled all the same. If the instrument rejects
that, as a controller may in another unit, it is identified first, and everything is written again.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from typing import TypeVar

from cldit.rig import locks
from cldit.rig.errors import (
    ConfigRejected,
    DeviceTimeout,
    HungUp,
    InUse,
    NotConnected,
    NotSafe,
    OddAnswer,
    RigError,
)
from cldit.rig.protocols import Safety

T = TypeVar("T")

CONNECT_s = 10.0  # TCP repeats a lost first packet after 1, 3 and 7 s (RFC 6298)
_IDLE_s = 10.0  # no session is closed as idle earlier
_TRIES = 3  # a link that is only out of step recovers at the second


class LinkState(Enum):
    """State of the connection; see the head of this file."""

    NEVER = "never connected, or closed while harmless"
    OPENING = "being opened"
    OPEN = "connected"
    LOST = "connected, then lost"
    CLOSED = "closed before it was made safe"


class Told:
    """Last confirmed setting of an instrument, and what was written since without an answer."""

    def __init__(self, setting: str) -> None:
        self._setting = setting
        self._words = ["not written"]

    def written(self, value: str) -> None:
        """Records text that was written and not confirmed."""
        self._words.append(value)

    def confirmed(self, value: str) -> None:
        """Records text that the instrument confirmed."""
        self._words = [value]

    def __str__(self) -> str:
        confirmed, *written = self._words
        return f"{self._setting} {confirmed}" + (
            f" ({written[-1]} written since)" if written else ""
        )


def send_all(*commands: Callable[[], object]) -> None:
    """Sends every command, then raises the first RigError of an answer."""
    errors = []
    for command in commands:
        try:
            command()
        except RigError as error:
            errors.append(error)
    if errors:
        raise errors[0]


class Linked(ABC):
    """`connect`, `close` and `make_safe` of an instrument behind a line that can fail.

    A driver implements how to open the line, how to prepare the instrument for use, how to drop
    the line, how to make the instrument harmless, and the last known setting. It wraps every
    exchange in `with self._asking():`, and what may be repeated in `self._again`.

    kind: one of `cldit.rig.protocols.KINDS`; messages begin with it. where: model and address, to
    find the instrument. by_hand: what to do at the instrument if the computer cannot reach it.
    reach_s: time in which `make_safe` tries to reach a lost instrument. address: gives the address
    by which the instrument is locked while it is used, as `cldit.rig.locks.tcp_address`; None locks
    nothing, as for simulated instruments.
    """

    def __init__(
        self,
        kind: str,
        where: str,
        *,
        by_hand: str,
        reach_s: float = CONNECT_s,
        address: Callable[[], str] | None = None,
    ) -> None:
        self._address = address
        self._locked: str | None = None
        self._kind = kind
        self._where = where
        self._by_hand = by_hand
        self._reach_s = reach_s
        self._state = LinkState.NEVER
        self._harmless = False  # made safe, and nothing was asked since
        self._answered = False  # at least once since it was last harmless
        self._last_answer_s = time.monotonic()
        self._prepared = False  # for use, on this line
        self._whole = False  # a larger exchange is repeated as a whole
        self._why_lost = ""
        self._unanswered = False  # an exchange failed since it began to open

    @abstractmethod
    def _open(self, timeout_s: float) -> None:
        """Opens the line, which needs no answer of the instrument if possible; raises RigError."""

    def _identify(self) -> None:  # noqa: B027
        """Checks which instrument answers, which needs no reading; raises RigError."""

    def _prepare(self) -> None:  # noqa: B027
        """Prepares the instrument for use: readings must be plausible; raises RigError."""

    @abstractmethod
    def _drop(self) -> None:
        """Closes the line in any state; never raises."""

    @abstractmethod
    def _write_safe(self) -> None:
        """Writes everything that makes the instrument harmless, before it raises the RigError of
        any answer; see `send_all`."""

    @abstractmethod
    def _check_safe(self) -> str:
        """Reads back that the instrument is harmless, and describes it; raises RigError."""

    @abstractmethod
    def _last_known(self) -> str:
        """Last known settings in words, without a query."""

    def connect(self, timeout_s: float = CONNECT_s) -> None:
        """Connects, unless connected already; raises NotConnected, ConfigRejected."""
        if self._state is LinkState.OPEN and not self._prepared:
            self._state = LinkState.LOST  # opened to be made safe alone
            self._drop()
        self._reach(timeout_s, for_use=True)

    def _reach(self, timeout_s: float, *, for_use: bool) -> None:
        """Opens the line unless it is open, and prepares the instrument if it is for use."""
        if self._state is LinkState.OPEN:
            return
        self.reserve()
        previous, self._state = self._state, LinkState.OPENING
        self._prepared = False
        try:
            self._open_twice(timeout_s, for_use)
        except BaseException as error:
            owed = self._answered or previous is not LinkState.NEVER
            self._state = LinkState.LOST if owed else LinkState.NEVER
            self._why_lost = self._why_lost or str(error)
            self._drop()
            self.let_go()
            if isinstance(error, RigError) and not isinstance(error, NotConnected | ConfigRejected):
                raise NotConnected(str(error)) from error
            raise
        self._state, self._why_lost, self._prepared = LinkState.OPEN, "", for_use

    def _open_twice(self, timeout_s: float, for_use: bool) -> None:
        """Opens the line, a second time if an answer was lost or damaged, as by noise: every query
        during opening may be sent twice."""

        def attempt(left_s: float) -> None:
            self._open(left_s)
            self._identify()
            if for_use:
                self._prepare()

        self._unanswered = False
        start_s = time.monotonic()
        try:
            attempt(timeout_s)
        except (NotConnected, DeviceTimeout):
            took_s = time.monotonic() - start_s
            left_s = timeout_s - took_s
            if not self._unanswered or left_s < took_s:
                raise
            self._drop()
            attempt(left_s)

    def close(self) -> None:
        """Closes the line; an instrument that may be on must still be made safe."""
        if self._state is LinkState.OPEN:
            self._state = LinkState.NEVER if self._harmless else LinkState.CLOSED
            self._answered = not self._harmless
        self._drop()
        self._unlock()

    def reserve(self) -> None:
        """Locks the instrument for this process, and asks nothing of it; `close` frees it. Raises
        InUse, which names the process that uses it, and since when.
        """
        if self._locked is None and self._address is not None:
            address = self._address()
            try:
                locks.take(address, self)
            except InUse as error:
                raise InUse(f"{self._kind}: {self._where} {error}") from None
            self._locked = address

    def let_go(self) -> None:
        """Frees an instrument that was reserved, and of which nothing was asked."""
        if self._state is LinkState.NEVER:
            self._unlock()

    def _unlock(self) -> None:
        if self._locked is not None:
            locks.free(self._locked, self)
            self._locked = None

    def make_safe(self) -> Safety:
        """Implements `cldit.rig.protocols.Device.make_safe`; NotSafe names the instrument, its
        address, its last known settings, and what to do.
        """
        previous, why_lost = self._state, self._why_lost
        if previous is LinkState.NEVER:
            return Safety(connected=False, did="nothing: it was not connected")
        start_s = time.monotonic()
        failures: list[str] = []
        while len(failures) < _TRIES:
            left_s = self._reach_s - (time.monotonic() - start_s)
            if failures and left_s <= 0.0:
                break
            try:
                did = self._attempt_safe(max(left_s, 0.1))
            except Exception as error:  # after any error, the instrument may be on
                failures.append(str(error))
                continue
            self._harmless, self._answered = True, False
            if previous is LinkState.CLOSED:
                self.close()
            history = "".join(
                f"; found again after: {reason}" for reason in (why_lost, *failures) if reason
            )
            return Safety(connected=True, did=did + history)
        lost = f"; it was lost before: {why_lost}" if why_lost else ""
        raise NotSafe(
            f"{self._where} could not be made safe: {failures[-1]}{lost}; tried {len(failures)} "
            f"times in {time.monotonic() - start_s:.1f} s. Last known: {self._last_known()}. "
            f"By hand: {self._by_hand}"
        )

    def _attempt_safe(self, timeout_s: float) -> str:
        """Makes the instrument harmless in one attempt. A missing answer does not drop the line
        before everything is written, because the state is OPENING."""
        was_open = self._state is LinkState.OPEN
        self.reserve()
        self._state = LinkState.OPENING
        self._prepared = self._prepared and was_open
        try:
            if not was_open:
                self._open(timeout_s)
            try:
                self._write_safe()
            except ConfigRejected:  # an answer, to numbers in a unit that may not be known yet
                if was_open:
                    raise
                self._identify()
                self._write_safe()
            else:
                if not was_open:
                    self._identify()
            did = self._check_safe()
        except BaseException as error:
            self._state = LinkState.OPEN
            self._lose(error)
            raise
        self._state, self._why_lost = LinkState.OPEN, ""
        return did

    @contextmanager
    def observed(self) -> Iterator[None]:
        """Context in which an instrument that was made safe is read, and stays harmless; it is
        opened, and closed again, if need be. Raises RigError."""
        closed = self._state is LinkState.NEVER
        self._reach(self._reach_s, for_use=False)
        try:
            yield
            self._harmless, self._answered = True, False
        finally:
            if closed:
                self.close()

    def take_over(self) -> None:
        """States that another process, which ended, may have left the instrument on."""
        if self._state is LinkState.NEVER:
            self._state = LinkState.CLOSED

    @contextmanager
    def _asking(self) -> Iterator[None]:
        """Context of one exchange, its answer checked within.

        After any exception but ConfigRejected, which is an answer, a late answer could be taken for
        that of the next query, so the line is dropped. Raises NotConnected if the instrument is not
        connected, or is lost.
        """
        if self._state not in (LinkState.OPEN, LinkState.OPENING):
            raise NotConnected(
                f"{self._kind}: was lost ({self._why_lost}); connect() tries again"
                if self._state is LinkState.LOST
                else f"{self._kind}: is not connected; call connect()"
            )
        self._harmless = False
        try:
            yield
        except BaseException as error:
            if isinstance(error, ConfigRejected | OddAnswer):
                self._answered = True
            if not isinstance(error, ConfigRejected):
                self._unanswered = True
                self._lose(error)
            raise
        self._answered, self._last_answer_s = True, time.monotonic()

    def _again(self, work: Callable[[], T], errors: type[NotConnected] = HungUp) -> T:
        """Result of `work`, which may be repeated.

        It is, once, on a line opened anew, after one of the `errors`, and after any failure that
        follows a pause: instruments and gateways close idle sessions, some without a word.
        """
        if self._whole or self._state is not LinkState.OPEN:
            return work()
        was_idle = time.monotonic() - self._last_answer_s >= _IDLE_s
        self._whole = True
        try:
            try:
                return work()
            except (NotConnected, DeviceTimeout) as error:
                if not (was_idle or isinstance(error, errors)) or not self._is_lost():
                    raise
            prepared = self._prepared
            self._reach(CONNECT_s, for_use=False)
            self._prepared = prepared
            return work()
        finally:
            self._whole = False

    def _is_lost(self) -> bool:
        return self._state is LinkState.LOST

    def _lose(self, error: BaseException) -> None:
        """Changes from OPEN to LOST; a line that is being opened is dropped by `connect`."""
        if self._state is LinkState.OPEN:
            self._state = LinkState.LOST
            self._why_lost = str(error) or type(error).__name__
            self._drop()


class HarmlessLink(Linked):
    """Connection to an instrument that is harmless in every state, as a filter wheel is: there is
    nothing to make safe, and a lost one is no danger."""

    def make_safe(self) -> Safety:
        """Asks nothing of the instrument; never raises."""
        if self._state is LinkState.NEVER:
            return Safety(connected=False, did="nothing: it was not connected")
        return Safety(connected=True, did="nothing: it is harmless in every position")

    def close(self) -> None:
        """Closes the line."""
        self._state = LinkState.NEVER
        super().close()

    def _write_safe(self) -> None:
        """Writes nothing."""

    def _check_safe(self) -> str:
        return ""

    def _last_known(self) -> str:
        return ""
