"""Journal of an acquisition: one JSON object per line, on the disk before the next step."""

import json
import math
import os
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from cldit.errors import RunFolderError
from cldit.io.content import digest
from cldit.io.files import fsync_folder, open_regular, written
from cldit.io.plain_data import parse_json

Entry = dict[str, Any]

_NUMBER = (int, float)
_FIRST_YEAR, _LAST_YEAR = 1970, 2100  # 1970 of a computer whose clock was never set
_TYPES: dict[str, type | tuple[type, ...]] = {  # of what an entry may hold
    "shot": str,
    "attempt": int,
    "inject": bool,
    "reason": str,
    "sha256": str,
    "file_sha256": str,
    "check": str,
    "filter": str,
    "background_before_K": _NUMBER,
    "background_after_K": _NUMBER,
    "background_K": _NUMBER,
    "reading_K": _NUMBER,
    "elapsed_s": _NUMBER,
    "saturated_percent": _NUMBER,
}
_OF_SHOT = ("shot", "attempt")
_NEEDED = {  # by event; what is read later on
    "fired": (*_OF_SHOT, "inject"),
    "lost": (*_OF_SHOT, "inject"),
    "rejected": (*_OF_SHOT, "inject"),
    "saved": (*_OF_SHOT, "background_before_K", "background_after_K", "saturated_percent"),
}


def read_entries(path: Path) -> tuple[list[Entry], int, RunFolderError | None]:
    """Reads the entries before the first damaged one, with the bytes of all complete lines and the
    error of the damaged one. A last line torn by a kill is ignored. Raises RunFolderError if the
    file cannot be read.
    """
    data = b""
    if path.exists():
        try:
            with open_regular(path) as stream:
                data = stream.read()
        except OSError as error:
            raise RunFolderError(str(error)) from error
    complete = data.rfind(b"\n") + 1  # what follows the last newline was never finished
    entries: list[Entry] = []
    previous: Entry = {}
    for number, line in enumerate(data[:complete].splitlines()):
        problem, entry = parse_entry(line, number)
        if not problem and not ("check" in entry or "check" in previous):
            problem = _lacks(entry)
        elif not problem and entry.get("check") != _check(entry, previous):
            problem = _lacks(entry) or "differs from what was written"
        if problem:
            return entries, complete, _damaged(path, number, problem)
        entries.append(entry)
        previous = entry
    return entries, complete, None


def _check(entry: Entry, previous: Entry) -> str:
    """Digest of an entry and of the check of the one before; lines of 0.2.0 have none."""
    values = {name: value for name, value in entry.items() if name != "check"}
    return digest(values, previous.get("check", ""))


def parse_entry(line: bytes, number: int) -> tuple[str, Entry]:
    """Parses a `line` with the sequence number `number`, from 0: its error, empty if none, and the
    entry.
    """
    try:
        entry = parse_json(line)
    except ValueError as error:
        return f"is not JSON ({error})", {}
    if not isinstance(entry, dict) or entry.get("seq") != number:
        return f"does not carry the sequence number {number}", {}
    try:
        time = datetime.fromisoformat(entry["time"])
        entry["event"].lower()
    except (KeyError, TypeError, ValueError, AttributeError):
        return "has no time or no event", {}
    if time.tzinfo is None or not _FIRST_YEAR <= time.year <= _LAST_YEAR:
        return f"has the time {entry['time']}, without a zone or of another century", {}
    for name, kind in _TYPES.items():
        value = entry.get(name)
        boolean = isinstance(value, bool) and kind is not bool  # True is an int to Python
        if name in entry and (boolean or not isinstance(value, kind)):
            return f"holds {name}: {value!r}, which is of another type", {}
    return "", entry


def shot_times(entries: Sequence[Entry]) -> dict[str, tuple[float, float | None]]:
    """Time of each kept shot, and of the last stabilisation of its background if there was one, in
    seconds since 1970. Empty if the time of any shot is not later than that of the one before: the
    clock was set.
    """
    times: dict[str, tuple[float, float | None]] = {}
    stable_s: float | None = None
    last_s = -math.inf
    for entry in entries:
        if entry["event"] not in ("stable", "saved"):
            continue
        time_s = datetime.fromisoformat(entry["time"]).timestamp()
        if entry["event"] == "stable":
            stable_s = time_s
            continue
        if not time_s > last_s:
            return {}
        last_s = time_s
        times[entry["shot"]] = (time_s, stable_s)
    return times


def _lacks(entry: Entry) -> str:
    missing = [name for name in _NEEDED.get(entry["event"], ()) if name not in entry]
    return f"has no {' and no '.join(missing)}" if missing else ""


def _damaged(path: Path, number: int, problem: str) -> RunFolderError:
    return RunFolderError(
        f"{path}: line {number + 1} {problem}; the journal was edited or damaged: restore it, or "
        "acquire into another folder"
    )


class Journal:
    """Appends to the journal; an entry is synced before `append` returns, or with the next one.

    `room_bytes` is called when the disk is full, for the space that the error names. Raises
    RunFolderError if the file is damaged, or cannot be read or written.
    """

    def __init__(self, path: Path, room_bytes: Callable[[], int] = lambda: 0) -> None:
        self.path = path
        self._room_bytes = room_bytes
        self.entries, self._end, damage = read_entries(path)
        if damage is not None:
            raise damage
        with written(path):
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o644)
            os.ftruncate(self._file, self._end)  # of a line that a kill tore
            os.fsync(self._file)
            fsync_folder(path.parent)

    def append(self, event: str, *, time: str, sync: bool = True, **values: Any) -> Entry:
        """Adds one line with further `values` and returns it; `time` is wall time in ISO 8601.

        Without `sync`, for what the rest of the folder contains too, a power cut may remove the
        line, a kill does not. DiskFull and RunFolderError leave the journal unchanged.
        """
        entry: Entry = {"seq": len(self.entries), "time": time, "event": event, **values}
        entry["check"] = _check(entry, self.entries[-1] if self.entries else {})
        line = json.dumps(entry, allow_nan=False).encode() + b"\n"
        with written(self.path, needed_bytes=self._room_bytes()):
            try:
                os.lseek(self._file, self._end, os.SEEK_SET)
                done = 0
                while done < len(line):
                    done += os.write(self._file, line[done:])
                if sync:
                    os.fsync(self._file)
            except OSError:
                os.ftruncate(self._file, self._end)
                raise
        self._end += len(line)
        self.entries.append(entry)
        return entry

    def close(self) -> None:
        """Closes the file."""
        os.close(self._file)

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
