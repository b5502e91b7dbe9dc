"""Rigs of which a test replaces parts, and what is asked of them afterwards."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cldit.acquisition import Plan, Progress, Record, acquire, dry_run
from cldit.errors import ClditError
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


@dataclass(frozen=True)
class Mission:
    """A simulated rig by its file, a plan, and the folder of the acquisition."""

    data: dict[str, Any]
    plan: Plan
    folder: Path

    def rig(self, **devices: Callable[[Any], dict[str, Any]]) -> Rig:
        """The rig, wrapped."""
        return wrapped(self.data, **devices)

    def acquire(
        self,
        rig: Rig | None = None,
        plan: Plan | None = None,
        *,
        stop_after: int | None = None,
        **options: Any,
    ) -> Record:
        """Acquires, by default with a new rig; stops when so many shots are saved."""
        done = 0

        def count(progress: Progress) -> None:
            nonlocal done
            done = progress.done

        if stop_after is not None:
            options |= {"progress": count, "should_stop": lambda: done >= stop_after}
        return acquire(rig or open_rig(self.data), plan or self.plan, self.folder, **options)


def refusals(rig: Rig, plan: Plan, folder: Path) -> tuple[list[str], list[str]]:
    """Lines that the dry run and the acquisition give, each from a rig of its own."""
    lines: list[list[str]] = []
    for ask in (dry_run, acquire):
        try:
            found = ask(rig, plan, folder)
            lines.append(list(getattr(found, "problems", ())))
        except ClditError as error:
            lines.append(str(error).splitlines())
    return lines[0], lines[1]


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
