"""An acquisition as a process of its own: killed, interrupted, without room on the disk.

Rationale: whatever happens to the computer, every injection that went into the vessel must be
known, and every shot of the plan must be there once after resuming.
Set-up: a tiny traced scene, the simulated rig, ten shots; the simulated injector counts its
pulses into a file of its own, as the real one would on a counter.
Expected, for every kill: each shot saved once; each pulse has its `fired` line; each `fired`
line ends in `saved`, `rejected` or `lost`; no unfinished file stays.
"""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import random
import signal
from collections import Counter
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

import pytest
import yaml

from cldit.acquisition import Plan, open_acquisition
from tests.journals import read_journal
from tests.patience import HANG_s, until

CHILD = "tests.system.acquisition_child"
pytestmark = pytest.mark.skipif(os.name == "nt", reason="SIGKILL is POSIX")

# A server, started once, has imported all that an acquisition needs: nine tenths of what a process
# costs here. Each acquisition is a fork of it, with memory, files and signals of its own.
FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload([CHILD, "cldit.drivers.simulated_scene"])


class Child:
    """A process that acquires; its output is in two files."""

    def __init__(self, arguments: list[str], folder: Path, most_bytes: int | None) -> None:
        self.out, self.err = folder / "child.out", folder / "child.err"
        self.out.unlink(missing_ok=True)
        run = importlib.import_module(CHILD).child
        self.process: ForkServerProcess = FORKS.Process(
            target=run, args=(arguments, self.out, self.err, most_bytes)
        )
        self.process.start()

    def terminate(self) -> None:
        self.process.terminate()

    def ended(self) -> tuple[int, str, str]:
        """Its exit status and what it wrote; killed, and a failure, if it does not end."""
        self.process.join(HANG_s)
        if self.process.exitcode is None:
            self.process.kill()
            pytest.fail(f"the process did not end within {HANG_s:g} s")
        return self.process.exitcode, self.out.read_text(), self.err.read_text()


class Bench:
    """One acquisition folder, the rig file and plan for it, and processes that work on it."""

    def __init__(self, rig: dict[str, Any], plan: Plan, folder: Path) -> None:
        self.pulse_log = Path(rig["trigger"]["settings"]["pulse_log"])
        self.plan = plan
        self.folder = folder / "acquired"
        self.rig_path, self.plan_path = folder / "rig.yaml", folder / "plan.yaml"
        self.rig_path.write_text(yaml.safe_dump(rig))
        self.change()

    def change(self, **values: Any) -> None:
        """Another plan, before anything is acquired."""
        self.plan = self.plan.model_copy(update=values)
        self.plan_path.write_text(self.plan.dump())

    def start(self, *death: str, most_bytes: int | None = None) -> Child:
        paths = (self.rig_path, self.plan_path, self.folder)
        return Child([*map(str, paths), *death], self.rig_path.parent, most_bytes)

    def run(self, *death: str, most_bytes: int | None = None) -> tuple[int, str, str]:
        return self.start(*death, most_bytes=most_bytes).ended()

    def pulses(self) -> Counter[bool]:
        if not self.pulse_log.exists():
            return Counter()
        entries = [json.loads(line) for line in self.pulse_log.read_text().splitlines()]
        return Counter(entry["inject"] for entry in entries)

    def lines(self) -> list[dict[str, Any]]:
        return read_journal(self.folder / "journal.jsonl")

    def check(self) -> None:
        """The acquisition is complete and nothing is unaccounted for."""
        acquisition = open_acquisition(self.folder)
        assert acquisition.complete
        assert len({acquisition.load(shot).tobytes() for shot in acquisition.shots}) == len(
            self.plan.steps()
        )
        names = sorted(path.name for path in (self.folder / "shots").iterdir())
        assert names == sorted(f"{shot.id}.tif" for shot in self.plan.steps())
        entries = self.lines()
        saved = Counter(entry["shot"] for entry in entries if entry["event"] == "saved")
        assert saved == Counter(shot.id for shot in self.plan.steps())
        fired = [entry for entry in entries if entry["event"] == "fired"]
        attempts = Counter((entry["shot"], entry["attempt"]) for entry in fired)
        ended = Counter(
            (entry["shot"], entry["attempt"])
            for entry in entries
            if entry["event"] in ("saved", "rejected", "lost")
        )
        assert attempts == ended and set(attempts.values()) == {1}
        announced = Counter(entry["inject"] for entry in fired)
        pulses = self.pulses()
        wanted = Counter(shot.kind == "injection" for shot in self.plan.steps())
        for inject in (True, False):
            assert wanted[inject] <= pulses[inject] <= announced[inject]


@pytest.fixture
def bench(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> Bench:
    return Bench(tiny_rig, tiny_plan, tmp_path)


def test_killed_at_every_kind_of_point(bench: Bench) -> None:
    """One acquisition, killed twelve times in turn; each process gets a little further."""
    deaths = [
        ("folder", "1"),
        ("folder", "3"),
        ("journal_line", "1"),  # start
        ("torn_approach", "2"),
        ("torn_line", "2"),
        ("fire", "1"),
        ("fired", "1"),
        ("part", "2"),
        ("renamed", "2"),
        ("journal_line", "6"),
        ("torn_line", "5"),
        ("fired", "2"),
    ]
    for death in deaths:
        code, out, err = bench.run(*death)
        assert code == -signal.SIGKILL, (death, out, err)
    code, out, err = bench.run()
    assert code == 0, err
    bench.check()
    events = Counter(entry["event"] for entry in bench.lines())
    assert events["start"] == 10 + 1 and events["lost"] >= 4
    assert any(entry.get("adopted") for entry in bench.lines())
    lost = sum(entry["inject"] for entry in bench.lines() if entry["event"] == "lost")
    assert out.splitlines()[-1] == f"complete {lost}"
    # At two deaths ("fire", and the sixth line of its process is a `fired` one) the pulse was
    # announced but not sent; every other announced pulse was counted by the injector, and no more.
    fired = sum(entry["event"] == "fired" for entry in bench.lines())
    assert fired - sum(bench.pulses().values()) == 2


def test_killed_at_any_time(bench: Bench) -> None:
    """A hundred shots, five kills at seeded moments, then to the end.

    A process needs some 10 ms to a stable background and some 3 ms a shot, so that 5 x 30 ms do
    not suffice for all of them.
    """
    bench.change(shots=30, references=20)
    rng = random.Random(20)
    for _ in range(5):
        milliseconds = str(rng.randint(0, 30))  # after preflight has begun
        assert bench.run("milliseconds", milliseconds)[0] == -signal.SIGKILL
    code, out, err = bench.run()
    assert code == 0 and out.splitlines()[-1].startswith("complete"), err
    bench.check()


def long_shots(bench: Bench) -> None:
    """Shots that take a thousand seconds: the rig's clock passes at a thousandth of that speed. No
    other waiting."""
    data = yaml.safe_load(bench.rig_path.read_text())
    data["clock"]["real_time_factor"] = 1e-3
    data["background"]["settings"]["time_constant_s"] = 0.0
    bench.rig_path.write_text(yaml.safe_dump(data))
    bench.change(
        stability=bench.plan.stability.model_copy(update={"hold_s": 0.0, "settle_s": 0.0}),
        trigger=bench.plan.trigger.model_copy(update={"camera_delay_s": 1.0}),
        pause_s=0.0,
        references=0,
    )


def test_ctrl_c_finishes_the_shot(bench: Bench) -> None:
    """Once, while the fifth shot is in the air: it is saved, then it stops; and resumes."""
    code, out, err = bench.run("ctrl_c", "5")
    assert code == 0, err
    assert out.splitlines()[-1] == "stopped 0"
    ended = [entry["event"] for entry in bench.lines()[-4:]]
    assert ended == ["fired", "saved", "stopped", "made safe"]
    assert len(open_acquisition(bench.folder).shots) == bench.pulses().total() == 5
    assert bench.run()[0] == 0
    bench.check()


def test_a_signal_to_end_aborts_the_shot(bench: Bench) -> None:
    """SIGTERM, as a second Ctrl-C, within a shot that would not end: it is aborted, and the
    injection is written off."""
    long_shots(bench)
    process = bench.start()
    until(lambda: any(entry["event"] == "fired" for entry in bench.lines()))
    process.terminate()
    code, _, err = process.ended()
    assert code == 3 and err.startswith("Aborted: stopped within a shot"), err
    entries = bench.lines()
    assert [entry["event"] for entry in entries[-3:]] == ["fired", "lost", "made safe"]
    assert entries[-2]["inject"] is True
    assert open_acquisition(bench.folder).shots == ()


def test_full_disk(bench: Bench) -> None:
    """No file may grow beyond the journal and a little more: what to do is said, no half
    picture stays, and the same command without the limit completes."""
    assert bench.run("journal_line", "2")[0] == -signal.SIGKILL
    size = (bench.folder / "journal.jsonl").stat().st_size
    code, _, err = bench.run(most_bytes=size + 200)
    assert code == 3 and "DiskFull" in err and "disk is full" in err and "resumes" in err, err
    assert len(bench.lines()) >= 2
    assert not list((bench.folder / "shots").glob("*.part"))
    assert bench.run()[0] == 0
    bench.check()
