"""Rigs of which a test replaces parts, and what is asked of them afterwards."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from cldit.rig.load import Rig, open_rig
from cldit.rig.protocols import Safety
from tests.journals import read_journal


class Wrapped:
    """An instrument of which a test replaces some methods, and that remembers being made safe."""

    def __init__(self, inner: Any, **methods: Callable[..., Any]) -> None:
        self.inner = inner
        self.made_safe = 0
        self.__dict__.update(methods)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def make_safe(self) -> Safety:
        self.made_safe += 1
        result: Safety = self.inner.make_safe()
        return result


def wrapped(data: dict[str, Any], **devices: Callable[[Any], dict[str, Any]]) -> Rig:
    """A rig whose devices are all wrapped; `devices` gives the methods to replace in one."""
    rig = open_rig(data)
    changed: dict[str, Any] = {
        name: Wrapped(device, **(devices[name](device) if name in devices else {}))
        for name, device in rig.devices.items()
    }
    return replace(rig, **changed)


def pulses(data: dict[str, Any]) -> list[dict[str, Any]]:
    log = Path(data["trigger"]["settings"]["pulse_log"])
    return [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []


def events(folder: Path) -> list[str]:
    return [entry["event"] for entry in read_journal(folder / "journal.jsonl")]


def assert_safe(rig: Rig) -> None:
    for device in rig.devices.values():
        assert isinstance(device, Wrapped) and device.made_safe >= 1
    assert rig.trigger.read_configuration()["inhibited"]
    assert rig.background.read_configuration()["setpoint_K"] == 295.0
