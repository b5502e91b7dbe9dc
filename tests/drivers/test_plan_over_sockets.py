"""The runner, unchanged, with drivers of real instruments and their peers over sockets."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from cldit.acquisition import Plan, acquire, open_acquisition
from cldit.rig.errors import RetakesExhausted
from cldit.rig.load import Rig, open_rig
from tests.emulators.gige_camera import GigePeer
from tests.emulators.rig import PeerRig
from tests.journals import read_journal
from tests.patience import HANG_s

for _module in ("viva_genicam", "pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")


def plan(**changes: Any) -> Plan:
    return Plan.model_validate(
        {
            "backgrounds_K": [440.0, 460.0, 480.0],
            "shots": 3,
            "references": 2,
            "pause_s": 0.0,
            "frame_timeout_s": 2.0,
            "stability": {"tolerance_K": 0.2, "hold_s": 0.1, "settle_s": 0.0, "timeout_s": HANG_s},
            **changes,
        }
    )


@pytest.mark.gige
def test_plan_over_sockets(tmp_path: Path) -> None:
    """Three backgrounds with 0.5 % packet loss, a rate error and a picture that is never sent:
    every shot once and bit-exact, every injection accounted for, all devices safe."""
    with ExitStack() as stack:
        peers = stack.enter_context(PeerRig(camera=GigePeer(loss=0.005, seed=2)))
        rig: Rig = stack.enter_context(open_rig(peers.rig_data()))
        seen = 0

        def watch(progress: Any) -> None:
            nonlocal seen
            if progress.done == 4 and not seen:
                peers.camera.skip = seen = 1

        record = acquire(rig, plan(), tmp_path / "a", progress=watch)
        assert record.complete and record.rejected >= 1
        acquisition = open_acquisition(tmp_path / "a")
        assert len(acquisition.shots) == 15 and not acquisition.simulated
        sent = {peers.camera.image(n).tobytes() for n in range(1, peers.camera.taken + 1)}
        pictures = {acquisition.load(shot).tobytes() for shot in acquisition.shots}
        assert len(pictures) == 15 and pictures <= sent
        fired = [
            entry for entry in read_journal(tmp_path / "a" / "journal.jsonl")
            if entry["event"] == "fired"
        ]  # fmt: skip
        assert peers.injections == sum(entry["inject"] for entry in fired) >= 9
        assert peers.generator.triggers == len(fired)
        assert not peers.camera.armed and not peers.generator.injects("CD")
        assert peers.blackbody.setpoint_K == pytest.approx(295.0, abs=0.01)
    assert not peers.camera.controlled


@pytest.mark.gige
def test_shots_of_several_frames_over_sockets(tmp_path: Path) -> None:
    """With 0.5 % packet loss: each shot one trigger and four pictures, bit-exact and in order; a
    picture that never comes costs the whole shot, which is taken again; a misfire is found."""
    with ExitStack() as stack:
        peers = stack.enter_context(PeerRig(camera=GigePeer((320, 256), loss=0.005, seed=5)))
        rig: Rig = stack.enter_context(open_rig(peers.rig_data()))

        def watch(progress: Any) -> None:
            if progress.done == 3 and not peers.camera.skipped:
                peers.camera.skip = 1

        record = acquire(rig, plan(frames=4), tmp_path / "a", progress=watch)
        assert record.complete and record.rejected >= 1
        acquisition = open_acquisition(tmp_path / "a")
        images = {peers.camera.image(n).tobytes(): n for n in range(1, peers.camera.taken + 1)}
        for shot in acquisition.shots:
            frames, meta = acquisition.load_frames(shot)
            numbers = [images[frame.tobytes()] for frame in frames]
            assert numbers == list(range(numbers[0], numbers[0] + 4))
            assert len(meta["frame_timestamps_ns"]) == 4
        fired = sum(e["event"] == "fired" for e in read_journal(tmp_path / "a" / "journal.jsonl"))
        assert peers.generator.triggers == fired
        peers.fuel_pressure = False
        with pytest.raises(RetakesExhausted, match="failed injection"):
            acquire(rig, plan(retakes=1), tmp_path / "b")
