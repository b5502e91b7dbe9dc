"""One answer of an instrument is lost in the middle of an acquisition.

Rationale: the acquisition ends, and what it leaves on is what matters.
Set-up: camera, black body and delay generator on loopback; the answer to the line that raises the
injector's level, or to the first question after the black body is at 440 K, is lost; or no answer
comes from then on.
Expected: where the link works again, the instrument is safe and the journal says how; where it
does not, the error, the journal and guard.log name it, its address, what it was last told and what
to do by hand, and the others are safe.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cldit.acquisition import Plan, acquire
from cldit.acquisition import guard as guard_module
from cldit.rig.errors import DeviceTimeout, RigError
from cldit.rig.load import open_rig
from cldit.testing.replies import Fault
from tests.emulators.gige_camera import GigePeer
from tests.emulators.rig import PeerRig
from tests.journals import read_journal
from tests.patience import HANG_s

for _module in ("viva_genicam", "pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")


pytestmark = pytest.mark.gige

PLAN = Plan.model_validate(
    {
        "backgrounds_K": [440.0],
        "shots": 2,
        "references": 1,
        "frame_timeout_s": 60.0,
        "stability": {"tolerance_K": 0.5, "hold_s": 0.1, "settle_s": 0.0, "timeout_s": HANG_s},
    }
)


def lossy(peers: PeerRig, *, last: int | None) -> dict[str, Any]:
    """The rig file; the generator loses the answer to the first level above 0.5 V at 440 K, and
    the following ones up to `last` more."""
    generator = peers.generator
    obey = generator._obey

    def answer(line: bytes) -> bytes:
        if line.startswith(b"LAMP 2,5") and peers.blackbody.setpoint_K > 400.0:
            first = generator.replies.sent + 1
            if not generator.replies.struck:
                generator.replies.spoil(Fault.DROP, first, last=first + (last or 0))
        return obey(line)

    generator._obey = answer  # type: ignore[method-assign]
    generator.__exit__()  # switched off, and on again with that ear
    generator.__enter__()
    data = peers.rig_data()
    data["trigger"]["settings"]["answer_s"] = 1.0
    return data


def test_generator_loses_an_answer(tmp_path: Path) -> None:
    with PeerRig(camera=GigePeer((64, 48))) as peers:
        data = lossy(peers, last=None)
        with open_rig(data) as rig, pytest.raises(DeviceTimeout, match="no answer to LAMP 2,5"):
            acquire(rig, PLAN, tmp_path / "a")
        assert peers.generator.replies.struck == 1 and peers.injections == 0
        assert not peers.generator.injects("CD")
        assert peers.generator.values["LAMP 2"] == 0.5 and peers.blackbody.setpoint_K < 296.0
        assert not peers.camera.armed
        entry = read_journal(tmp_path / "a" / "journal.jsonl")[-1]
        assert entry["event"] == "made safe" and "found again" in entry["did"]["trigger"]


def test_generator_stays_silent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard's process tries, too; it sleeps 11 s between its attempts, which are not ours."""
    monkeypatch.setattr(
        guard_module, "_PROCESS",
        guard_module._PROCESS.replace("; sys.exit", "; import cldit.acquisition.guard as g; "
                                      "g._PAUSES_s = (0.0, 0.0); sys.exit"),
    )  # fmt: skip
    with PeerRig(camera=GigePeer((64, 48))) as peers:
        data = lossy(peers, last=10**6)
        rig = open_rig(data)
        with pytest.raises(RigError, match="the rig was not made safe") as caught:
            acquire(rig, PLAN, tmp_path / "a")
        said = [
            f"DG645 at {peers.generator.host}:{peers.generator.port}",
            "injector's output CD 5 V",
            "unplug the cable of",
            "the generator may still inject on a trigger",
            "the guard could not help either",
        ]
        assert all(text in str(caught.value) for text in said), caught.value
        # It received what makes it harmless, which it could not confirm.
        assert peers.generator.values["LAMP 2"] == 0.5 and not peers.generator.injects("CD")
        assert peers.blackbody.setpoint_K < 296.0 and not peers.camera.armed
        assert "NOT SAFE" in (tmp_path / "a" / "guard.log").read_text()
        entry = read_journal(tmp_path / "a" / "journal.jsonl")[-1]
        assert entry["event"] == "unsafe" and said[0] in entry["problems"][0]
        assert set(entry["did"]) == {"background", "camera"}
        peers.generator.replies.heal()
        assert rig.make_safe().problems == [] and not peers.generator.injects("CD")
        rig.close()


def test_black_body_loses_its_answers_for_a_while(tmp_path: Path) -> None:
    """Longer than the driver asks again: the run ends, and the set point is the safe one."""
    with PeerRig(camera=GigePeer((64, 48))) as peers:
        data = peers.rig_data()
        data["background"]["settings"]["answer_s"] = 1.0

        def hot(progress: Any) -> None:
            replies = peers.blackbody.replies
            if peers.blackbody.setpoint_K > 400.0 and not replies.struck:
                replies.spoil(Fault.DROP, replies.sent + 1, last=replies.sent + 3)

        with open_rig(data) as rig, pytest.raises(RigError, match="no answer at register"):
            acquire(rig, PLAN, tmp_path / "a", progress=hot)
        assert peers.blackbody.replies.struck == 3 and peers.blackbody.setpoint_K < 296.0
        entry = read_journal(tmp_path / "a" / "journal.jsonl")[-1]
        assert entry["event"] == "made safe" and "set point 295.0 K" in entry["did"]["background"]
