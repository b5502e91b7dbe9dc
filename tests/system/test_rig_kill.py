"""A plan of 3 x 3 on instruments over sockets, killed twenty times: what the instruments show.

Rationale: a process that dies leaves the instruments as they are, so something else must cool the
black body and disarm the camera; and every injection that the generator counted must be known.
Set-up: camera, black body and delay generator on loopback in the test's process, which no kill
reaches; three backgrounds with three delays each; the acquisition in a process of its own, killed
with SIGKILL at seeded moments, and started again.
Expected after each kill, on the instruments' side: the set point is the safe one, a heater that has
a switch is off, the camera is not armed and free, a stray trigger would not inject, no burst runs.
At the end: every shot once.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path

import pytest
import yaml

from cldit.acquisition import Plan, open_acquisition
from tests.emulators.gige_camera import GigePeer
from tests.emulators.rig import PeerRig
from tests.journals import read_journal
from tests.patience import HANG_s, until

for _module in ("viva_genicam", "pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")


CHILD = Path(__file__).with_name("acquisition_child.py")
pytestmark = [
    pytest.mark.gige,
    pytest.mark.skipif(os.name == "nt", reason="SIGKILL is POSIX"),
]

PLAN = Plan.model_validate(
    {
        "backgrounds_K": [440.0, 480.0, 520.0],
        "delays_s": [0.0005, 0.001, 0.0015],
        "shots": 8,
        "references": 3,
        "pause_s": 0.1,
        "frame_timeout_s": 60.0,
        "retakes": 5,
        "stability": {"tolerance_K": 0.2, "hold_s": 0.1, "settle_s": 0.0, "timeout_s": HANG_s},
    }
)


def kill_and_resume(folder: Path, kills: int, plan: Plan, *, fluke: bool) -> None:
    rng = random.Random(11)
    acquired, log = folder / "acquired", folder / "acquired" / "guard.log"
    # The nearest to 295 K within the instrument's limits.
    safe_K = 308.15 if fluke else 295.0
    with PeerRig(camera=GigePeer((64, 48)), fluke=fluke) as peers:
        (folder / "rig.yaml").write_text(yaml.safe_dump(peers.rig_data()))
        (folder / "plan.yaml").write_text(plan.dump())

        def start() -> subprocess.Popen[str]:
            return subprocess.Popen(
                [sys.executable, str(CHILD), *(str(folder / f"{n}.yaml") for n in ("rig", "plan")),
                 str(acquired)],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip

        def reports() -> int:
            return log.read_text().count("every device is safe") if log.exists() else 0

        def more(what: str, than: int) -> bool:
            return (peers.generator.triggers if what == "triggers" else reports()) > than

        for number in range(kills):
            with start() as process:
                triggers, heard = peers.generator.triggers, reports()
                # Half of them while shots are taken, the others anywhere after the start.
                until(lambda: peers.camera.controlled)
                if number % 2:
                    until(partial(more, "triggers", triggers))
                time.sleep(rng.uniform(0.0, 0.4))
                process.kill()
                process.communicate(timeout=HANG_s)
            assert process.returncode == -signal.SIGKILL, f"kill {number} came too late"
            until(partial(more, "reports", heard), lambda: log.exists() and log.read_text())
            assert peers.blackbody.setpoint_K == pytest.approx(safe_K, abs=0.01)
            assert not getattr(peers.blackbody, "heating", False)
            assert not peers.camera.armed and not peers.camera.controlled
            assert not peers.generator.injects("CD") and not peers.generator.busy
            assert peers.generator.values["BURM"] == 0 and peers.generator.values["TSRC"] == 5
        with start() as process:
            out, err = process.communicate(timeout=HANG_s)
        assert process.returncode == 0 and out.splitlines()[-1].startswith("complete"), err
        assert reports() == kills  # after a regular end the guard does nothing

        assert open_acquisition(acquired).complete
        entries = read_journal(acquired / "journal.jsonl")
        saved = Counter(entry["shot"] for entry in entries if entry["event"] == "saved")
        assert saved == Counter(shot.id for shot in plan.steps())
        fired = [entry for entry in entries if entry["event"] == "fired"]
        announced = sum(entry["inject"] for entry in fired)
        wanted = sum(shot.kind == "injection" for shot in plan.steps())
        # A `fired` line is on the disk before its trigger: a kill in between costs a line, never
        # an injection that nobody knows of.
        assert wanted <= peers.injections <= announced <= peers.injections + kills
        ended = Counter(
            (entry["shot"], entry["attempt"])
            for entry in entries
            if entry["event"] in ("saved", "rejected", "lost")
        )
        assert ended == Counter((entry["shot"], entry["attempt"]) for entry in fired)


def test_killed_three_times(tmp_path: Path) -> None:
    few = PLAN.model_copy(update={"shots": 2, "references": 1})
    kill_and_resume(tmp_path, 3, few, fluke=True)


@pytest.mark.slow
def test_killed_twenty_times(tmp_path: Path) -> None:
    kill_and_resume(tmp_path, 20, PLAN, fluke=False)
