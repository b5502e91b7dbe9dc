"""What a device owes once it was connected; its instrument is a few lines here."""

from __future__ import annotations

import time

import pytest

from cldit.rig.errors import Aborted, ConfigRejected, NotConnected, NotSafe
from cldit.rig.link import _TRIES, Linked, Told


class Lamp(Linked):
    """`fails`: exceptions of the next exchanges, None for one that works."""

    def __init__(self, reach_s: float = 10.0) -> None:
        super().__init__("camera", "lamp at 1.2.3.4", by_hand="pull its plug", reach_s=reach_s)
        self.fails: list[BaseException | None] = []
        self.on = False
        self.opened = self.dropped = 0
        self.slow_s = 0.0
        self.told = Told("light")

    def _open(self, timeout_s: float) -> None:
        self.opened += 1
        time.sleep(self.slow_s)
        self._exchange()

    def _drop(self) -> None:
        self.dropped += 1

    def _write_safe(self) -> None:
        self.switch(False)

    def _check_safe(self) -> str:
        return "light off"

    def _last_known(self) -> str:
        return str(self.told)

    def switch(self, on: bool) -> None:
        state = "on" if on else "off"
        self.told.written(state)
        self._exchange()
        self.on = on
        self.told.confirmed(state)

    def _exchange(self) -> None:
        with self._asking():
            error = self.fails.pop(0) if self.fails else None
            if error is not None:
                raise error


def lit() -> Lamp:
    lamp = Lamp()
    lamp.connect()
    lamp.switch(True)
    return lamp


LOST = NotConnected("no answer")


def test_never_connected_is_nothing_to_do() -> None:
    lamp = Lamp()
    assert not lamp.make_safe().connected and lamp.opened == 0
    lamp.fails = [LOST, LOST]
    with pytest.raises(NotConnected):
        lamp.connect()
    assert not lamp.make_safe().connected  # nobody ever answered
    with pytest.raises(NotConnected, match=r"is not connected; call connect\(\)"):
        lamp.switch(True)


@pytest.mark.parametrize(
    "error", [LOST, ValueError("nan"), Aborted("stopped"), KeyboardInterrupt()], ids=repr
)
def test_a_lost_one_is_reached_for(error: BaseException) -> None:
    """Whatever cut the exchange short: an answer may still be under way, so the line is new."""
    lamp = lit()
    lamp.fails = [error]
    with pytest.raises(type(error)):
        lamp.switch(True)
    assert lamp.dropped == 1
    with pytest.raises(NotConnected, match="was lost"):
        lamp.switch(True)
    safety = lamp.make_safe()
    assert safety.connected and not lamp.on and "found again" in safety.did
    assert lamp.opened == 2


def test_an_answer_lost_while_it_connects_is_asked_for_again() -> None:
    """Once, on a line opened anew; not where the user stopped it, nor where no time is left."""
    lamp = Lamp()
    lamp.fails = [LOST]
    lamp.connect()
    assert (lamp.opened, lamp.dropped) == (2, 1)
    cases = ((Aborted("stopped"), 0.0), (ConfigRejected("no"), 0.0), (LOST, 0.1))
    for error, slow_s in cases:
        second_lamp = Lamp()
        second_lamp.fails, second_lamp.slow_s = [error], slow_s
        with pytest.raises((NotConnected, ConfigRejected)):
            second_lamp.connect(0.15)
        assert second_lamp.opened == 1


def test_a_refusal_is_an_answer() -> None:
    lamp = lit()
    lamp.fails = [ConfigRejected("too bright")]
    with pytest.raises(ConfigRejected):
        lamp.switch(True)
    assert lamp.dropped == 0
    lamp.switch(True)


@pytest.mark.parametrize("error", [LOST, ConfigRejected("stuck"), RuntimeError("a bug")], ids=repr)
def test_one_that_stays_on_is_an_error(error: Exception) -> None:
    lamp = lit()
    lamp.fails = [error] * 100
    with pytest.raises(NotSafe) as caught:
        lamp.make_safe()
    message = str(caught.value)
    for part in ("lamp at 1.2.3.4", str(error), "Last known: light on (off written since)",
                 "By hand: pull its plug", f"tried {_TRIES} times"):  # fmt: skip
        assert part in message
    lamp.close()
    with pytest.raises(NotSafe):  # closing it does not pay what is owed
        lamp.make_safe()
    lamp.fails = []
    assert lamp.make_safe().connected and not lamp.on


def test_reaching_is_bounded_in_time() -> None:
    lamp = Lamp(reach_s=0.1)
    lamp.connect()
    lamp.fails, lamp.slow_s = [LOST] * 100, 0.15
    with pytest.raises(NotSafe, match="tried 2 times"):
        lamp.make_safe()


def test_let_go_of_while_on_is_owed() -> None:
    lamp = lit()
    lamp.close()
    assert lamp.make_safe().connected and not lamp.on
    with pytest.raises(NotConnected):  # it was let go of, so it is again
        lamp.switch(True)
    assert not lamp.make_safe().connected


def test_let_go_of_harmless_is_not_owed() -> None:
    lamp = lit()
    lamp.make_safe()
    lamp.close()
    assert not lamp.make_safe().connected
    lamp.connect()
    lamp.make_safe()
    lamp.switch(True)  # after it was made safe
    lamp.close()
    assert lamp.make_safe().connected and not lamp.on


def test_lost_while_it_is_connected_again() -> None:
    """It answered once while it was opened, so that it may have been told something."""
    lamp = lit()
    lamp.fails = [LOST, LOST, LOST]
    with pytest.raises(NotConnected):
        lamp.switch(True)
    with pytest.raises(NotConnected):
        lamp.connect()
    assert lamp.make_safe().connected and not lamp.on
