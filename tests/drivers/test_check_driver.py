"""`cldit check-driver`: a good driver passes, a broken one fails, an instrument stays cold."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from click.testing import CliRunner, Result

from cldit.cli import main
from cldit.cli.check_driver import _show
from cldit.testing import lost_replies
from cldit.testing import run as testing
from cldit.testing.backgrounds import limits
from cldit.testing.bed import opened
from cldit.testing.expect import EVERYTHING, Allowed, ContractBroken
from cldit.testing.replies import Fault
from cldit.testing.run import Verdict, on_instrument
from cldit.testing.triggers import references_do_not_inject
from tests.emulators.beds import BEDS
from tests.emulators.blackbody import ModbusPeer
from tests.emulators.dg645 import Dg645Peer
from tests.emulators.rig import blackbody_choice

for _module in ("pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.controller import BlackBody
    from drivers.dg645 import Dg645
else:
    from cldit.drivers.controller import BlackBody
    from cldit.drivers.dg645 import Dg645

DG645 = BEDS["dg645"]["tcp"]
EUROTHERM = BEDS["modbus_blackbody"]["eurotherm-tcp"]


# Broken drivers: each of these faults is one that somebody writes, and is found.


def test_an_injector_that_is_not_held_still(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Dg645, "_write_safe", lambda self: None)
    monkeypatch.setattr(Dg645, "_check_safe", lambda self: "inhibited")
    with opened(DG645) as bed, pytest.raises(ContractBroken, match="a trigger injects"):
        bed.device.connect()
        references_do_not_inject(bed, EVERYTHING)
    with pytest.raises(ContractBroken, match="on after make_safe"):
        lost_replies.check_states(DG645)


def test_limits_that_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BlackBody, "set_setpoint", lambda self, kelvin: kelvin)
    with opened(EUROTHERM) as bed, pytest.raises(ContractBroken, match="expected OutOfLimits"):
        bed.device.connect()
        limits(bed.device, EVERYTHING)


def test_a_lost_answer_that_is_taken_for_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """make_safe() of a link that is down does nothing, and says that all is well."""
    plain = Dg645.make_safe

    def trusting(self: Dg645) -> Any:
        from cldit.rig.link import LinkState
        from cldit.rig.protocols import Safety

        return Safety(True, "nothing") if self._state is LinkState.LOST else plain(self)

    monkeypatch.setattr(Dg645, "make_safe", trusting)
    with pytest.raises(
        ContractBroken, match=r"reply \d+ of \d+, drop: .*left on: a trigger injects"
    ):
        lost_replies.check_replies(DG645, lambda n: range(n - 7, n + 1), [Fault.DROP])


# Instruments; here their emulators stand for them.

_ANSWER_s = 0.5  # a dead one is asked six times; a living one answers in a few milliseconds


@pytest.fixture
def rig(tiny_rig: dict[str, Any], tmp_path: Path) -> Iterator[tuple[Path, ModbusPeer, Dg645Peer]]:
    with ModbusPeer("eurotherm-3200", start_K=293.0) as body, Dg645Peer() as generator:
        tiny_rig["background"] = blackbody_choice(body, limits_K=[290.0, 600.0])
        tiny_rig["trigger"] = {
            "driver": "dg645",
            "settings": {"host": generator.host, "port": generator.port, "answer_s": _ANSWER_s},
        }
        tiny_rig["clock"] = {"model": "system"}
        path = tmp_path / "rig.yaml"
        path.write_text(yaml.safe_dump(tiny_rig), encoding="utf-8")
        yield path, body, generator


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cldit.cli.check_driver.on_instrument", partial(on_instrument, pause_s=0.0))


def check(*arguments: str, answer: str = "") -> Result:
    return CliRunner().invoke(main, ["check-driver", *arguments], input=answer)


def test_an_instrument_is_never_heated(rig: tuple[Path, ModbusPeer, Dg645Peer]) -> None:
    path, body, _ = rig
    aimed: list[float] = []
    plain = body.heater.aim

    def watched(setpoint_K: float) -> None:
        aimed.append(setpoint_K)
        plain(setpoint_K)

    body.heater.aim = watched  # type: ignore[method-assign]
    got = check("modbus_blackbody", str(path), "--instrument", answer="y\n")
    assert got.exit_code == 0, got.output
    assert aimed and max(aimed) <= 295.0 + 1e-3
    for text in ("no set point above 295.0 K", "3 passed, 0 failed, 1 skipped", "made safe: set"):
        assert text in got.output, got.output


@pytest.mark.parametrize("part", ["background", "trigger", "camera"])
def test_one_instrument_needs_no_rig(
    rig: tuple[Path, ModbusPeer, Dg645Peer], part: str, tmp_path: Path
) -> None:
    whole = yaml.safe_load(rig[0].read_text())
    alone = tmp_path / "alone.yaml"
    alone.write_text(yaml.safe_dump({part: whole[part], "bench": whole["bench"]}))
    name = whole[part]["driver"]
    got = check(name, str(alone), "--instrument", "--yes")
    assert got.exit_code == 0 and "made safe" in got.output, got.output + got.stderr
    other = check("fluke418x", str(alone), "--instrument", "--yes")
    assert f"no device has the driver fluke418x; it has {part}: {name}" in other.stderr
    alone.write_text("{}")
    assert "it has none" in check(name, str(alone), "--instrument", "--yes").stderr


def test_nothing_is_done_before_it_is_allowed(rig: tuple[Path, ModbusPeer, Dg645Peer]) -> None:
    path, body, generator = rig
    for name in ("modbus_blackbody", "dg645"):
        got = check(name, str(path), "--instrument", answer="n\n")
        assert got.exit_code == 1 and "Continue?" in got.output
    assert body.replies.sent == generator.replies.sent == 0


def test_an_instrument_never_injects(rig: tuple[Path, ModbusPeer, Dg645Peer]) -> None:
    path, _, generator = rig
    got = check("dg645", str(path), "--instrument", "--yes")
    assert got.exit_code == 0, got.output
    assert len(generator.pulses("AB")) == 1 and not generator.pulses("CD")
    assert not generator.injects("CD") and "made safe: inhibited" in got.output


def test_a_broken_one_ends_with_status_one(
    rig: tuple[Path, ModbusPeer, Dg645Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _, generator = rig
    monkeypatch.setattr(Dg645, "inhibit", lambda self: None)
    got = check("dg645", str(path), "--instrument", "--yes")
    assert got.exit_code == 1 and "failed" in got.output and "after inhibit()" in got.output
    assert not generator.injects("CD") and "made safe" in got.output


def test_a_dead_one_is_said_to_be_unsafe(
    rig: tuple[Path, ModbusPeer, Dg645Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It answers until its session, and never again: it may be on, so the status is 1."""
    path, _, generator = rig

    def dies(self: Dg645) -> None:
        generator.deaf = True
        self._line.integer("INSR?")

    monkeypatch.setattr(Dg645, "fire", dies)
    got = check("dg645", str(path), "--instrument", "--yes")
    assert got.exit_code == 1 and "NOT SAFE: trigger: DG645 at" in got.output, got.output


def test_what_cannot_be_checked(tmp_path: Path, rig: tuple[Path, ModbusPeer, Dg645Peer]) -> None:
    for arguments, text in (
        (["simulated_scene"], "is a bench"),
        (["simulated_injector"], "has no emulator"),
        (["dg645", "--instrument"], "requires a RIG file"),
        (["fluke418x", str(rig[0])], "no device has the driver fluke418x"),
    ):
        got = check(*arguments)
        assert got.exit_code == 1 and text in got.output + got.stderr, got.output


def test_warmest_is_what_is_allowed() -> None:
    with opened(EUROTHERM, {"limits_K": [300.0, 500.0]}) as bed:
        results = list(on_instrument(bed.device, "background", Allowed(310.0, False), pause_s=0.0))
        assert [result.verdict for result in results] == [Verdict.PASSED] * 4
        assert bed.left_on() == "set point 310.0 K"


def test_checks_that_are_all_skipped_are_no_success() -> None:
    skipped, passed = (
        testing.Result("instrument", "identity", verdict, "", 0.0)
        for verdict in (Verdict.SKIPPED, Verdict.PASSED)
    )
    assert not _show([skipped])
    assert _show([skipped, passed])
