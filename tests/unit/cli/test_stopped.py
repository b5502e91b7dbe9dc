"""The exit status of an acquisition that was stopped is that of the help."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from cldit.acquisition.progress import Progress
from cldit.acquisition.storage import JOURNAL
from cldit.cli import main
from cldit.cli.acquire import RecordingBar
from cldit.cli.program import Exit
from tests.journals import read_journal


def test_ctrl_c(tiny_rig: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After the first shot; the rig is made safe."""
    rig, plan, out = tmp_path / "rig.yaml", tmp_path / "plan.yaml", tmp_path / "shots"
    rig.write_text(yaml.safe_dump(tiny_rig), encoding="utf-8")
    plan.write_text("backgrounds_K: [440.0]\nshots: 3\n", encoding="utf-8")

    def press(bar: RecordingBar, progress: Progress) -> None:
        if progress.done == 1:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(RecordingBar, "watch", press)
    result = CliRunner().invoke(main, ["acquire", str(rig), str(plan), "--out", str(out)])
    assert result.exit_code == Exit.STOPPED
    assert "not complete; run the same command again" in result.stderr
    assert [entry["event"] for entry in read_journal(out / JOURNAL)][-1] == "made safe"
