"""A second process that asks for instruments in use is refused by name, and touches nothing.

Set-up: black body and delay generator on loopback, as a session leaves them: hot, an injection
ready. Another process has them, and is then killed.
Expected: acquisition, dry run, check of a driver and script are refused, naming the first process
and since when; set point, outputs and number of questions stay as they are. Once the first process
is gone, the same instruments are free.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

import cldit
from cldit.rig.errors import InUse, NotSafe
from cldit.testing.bed import opened
from cldit.testing.replies import Replies
from tests.beds import in_tiers, make_of
from tests.command_line import command
from tests.emulators.blackbody import ModbusPeer
from tests.emulators.rig import blackbody_choice
from tests.patience import HANG_s

HOLDS = """
import sys
from pathlib import Path
from cldit.io.plain_data import parse_yaml
from cldit.rig.clock import Clock
from cldit.rig.drivers import RigContext, load_driver
driver, settings = sys.argv[1], parse_yaml(sys.argv[2], source="settings")
device = load_driver(driver)(settings, RigContext(Clock(), None, Path(), 1))
device.connect()
print("has it", flush=True)
sys.stdin.read()
"""


@contextmanager
def in_another_process(device: Any, driver: str) -> Iterator[subprocess.Popen[str]]:
    """A process that has connected the instrument of `device`."""
    if driver == "fluke418x":  # which gives its settings to the other one
        driver = "line_blackbody"
    settings = yaml.safe_dump(device._settings.model_dump(mode="json", exclude_none=True))
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDS, driver, settings],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == "has it\n"
        yield process
    finally:
        process.kill()
        process.communicate(timeout=HANG_s)


@contextmanager
def silent(process: subprocess.Popen[str], replies: Replies) -> Iterator[None]:
    """Stops the process, which has the instrument and may send it heartbeats."""
    process.send_signal(signal.SIGSTOP)
    sent = -1
    while sent != replies.sent:  # to what was under way
        sent = replies.sent
        time.sleep(0.5)
    yield
    process.send_signal(signal.SIGCONT)


@pytest.mark.skipif(os.name == "nt", reason="SIGSTOP is POSIX")
@pytest.mark.parametrize(("driver", "variant"), in_tiers())
def test_a_second_user_touches_nothing(driver: str, variant: str) -> None:
    with opened(make_of(driver, variant, {})) as bed:
        assert bed.replies is not None
        with in_another_process(bed.device, driver) as holder:
            with silent(holder, bed.replies):
                asked = bed.replies.sent
                with pytest.raises(InUse) as caught:
                    bed.device.connect()
                assert not bed.device.make_safe().connected
                assert bed.replies.sent == asked
            assert f"is in use by process {holder.pid} (" in str(caught.value)
            assert time.strftime("since %Y-%m-%d") in str(caught.value)
        bed.device.connect()  # the other one was killed
        assert bed.device.make_safe().connected
        bed.device.close()


def test_free_when_closed_and_used_twice_in_a_process() -> None:
    with opened(make_of("fluke418x", "tcp", {})) as bed:
        assert bed.afresh is not None
        bed.device.connect()
        second = bed.afresh()
        second.connect()  # a script may
        second.make_safe()
        second.close()
        bed.device.close()
        with in_another_process(bed.device, "fluke418x"):
            with pytest.raises(InUse):
                second.connect()
            with pytest.raises(NotSafe, match="is in use by process"):  # it was closed while on
                bed.device.make_safe()


def test_a_rig_touches_none_of_its_instruments(tiny_rig: dict[str, Any], tmp_path: Path) -> None:
    """One of them is in use: the others are asked nothing either, whatever the command."""
    with (
        ModbusPeer("eurotherm-3200", start_K=440.0) as body,
        opened(make_of("dg645", "tcp", {})) as bed,
    ):
        assert bed.replies is not None
        tiny_rig["background"] = blackbody_choice(body)
        settings = bed.device._settings.model_dump(mode="json")
        tiny_rig["trigger"] = {"driver": "dg645", "settings": settings}
        tiny_rig["clock"] = {"model": "system"}
        rig, plan, out = tmp_path / "rig.yaml", tmp_path / "plan.yaml", str(tmp_path / "shots")
        rig.write_text(yaml.safe_dump(tiny_rig), encoding="utf-8")
        plan.write_text("backgrounds_K: [440.0]\nshots: 1\n", encoding="utf-8")
        acquire = ["acquire", str(rig), str(plan), "--out", out]
        with in_another_process(bed.device, "dg645") as holder:
            asked = bed.replies.sent
            for words in (
                acquire,
                [*acquire, "--live"],
                [*acquire, "--dry-run"],
                ["check-driver", "dg645", str(rig), "--instrument", "--yes"],
            ):
                got = command(*words, status=1)
                said = " ".join((got.output + got.stderr).split())
                assert f"is in use by process {holder.pid} (" in said
                assert "NOT SAFE" not in said
            with cldit.open_rig(rig) as opened_rig, pytest.raises(InUse):
                opened_rig.connect()
            assert bed.replies.sent == asked
            assert body.replies.sent == 0 and body.setpoint_K == 440.0
