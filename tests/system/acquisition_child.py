"""Runs an acquisition that the tests kill: arguments RIG PLAN FOLDER [POINT NUMBER].

With POINT it kills itself with SIGKILL when that point is reached for the NUMBERth time, or NUMBER
milliseconds after its first progress; `ctrl_c` interrupts it. Lines of the black body's approach
are no points of their own, but for `torn_approach`.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import cldit.acquisition.journal as journal_module
import cldit.acquisition.sequence as sequence_module
from cldit.acquisition import acquire, load_plan, storage
from cldit.errors import ClditError
from cldit.io import files
from cldit.rig.load import Rig, open_rig

ACQUIRE_FAILED = 3


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def arm(point: str, number: int, rig: Rig) -> None:
    """Replaces what happens at `point` by death, the NUMBERth time."""
    count = 0

    def reached() -> bool:
        nonlocal count
        count += 1
        return count == number

    save_shot, write_text = storage.save_shot, files.write_text
    append, fire = journal_module.Journal.append, rig.trigger.fire
    replace = Path.replace

    if point == "journal_line":  # the journal has got its NUMBERth line of this process

        def dying_append(self: Any, *args: Any, **kwargs: Any) -> Any:
            entry = append(self, *args, **kwargs)
            if entry["event"] != "approaching" and reached():
                die()
            return entry

        journal_module.Journal.append = dying_append  # type: ignore[method-assign]
    elif point in ("torn_line", "torn_approach"):  # half of the line is written
        real_write = os.write

        def torn(handle: int, data: bytes) -> int:
            approaching = b'"approaching"' in data
            counts = data.startswith(b'{"seq"') and approaching == (point == "torn_approach")
            if counts and reached():
                real_write(handle, data[: len(data) // 2])
                die()
            return real_write(handle, data)

        os.write = torn  # type: ignore[assignment]
    elif point == "fire":  # `fired` is on the disk, the pulse is not out yet

        def dying_fire() -> None:
            if reached():
                die()
            fire()

        rig.trigger.fire = dying_fire  # type: ignore[method-assign]
    elif point == "fired":  # the pulse is out, the frame not read

        def fire_and_die() -> None:
            fire()
            if reached():
                die()

        rig.trigger.fire = fire_and_die  # type: ignore[method-assign]
    elif point == "ctrl_c":  # the pulse is out, the frame not read

        def fire_and_press() -> None:
            fire()
            if reached():
                os.kill(os.getpid(), signal.SIGINT)

        rig.trigger.fire = fire_and_press  # type: ignore[method-assign]
    elif point == "part":  # the picture is written, not renamed

        def dying_replace(self: Path, target: Any) -> Any:
            if self.name.endswith(".tif.part") and reached():
                die()
            return replace(self, target)

        Path.replace = dying_replace  # type: ignore[method-assign]
    elif point == "renamed":  # the picture is in its place, the journal does not know

        def dying_save(*args: Any, **kwargs: Any) -> str:
            digest = save_shot(*args, **kwargs)
            if reached():
                die()
            return digest

        sequence_module.save_shot = dying_save  # type: ignore[attr-defined]
    elif point == "folder":  # between the files that are written before the first shot

        def dying_text(path: Path, content: str) -> None:
            write_text(path, content)
            if reached():
                die()

        sequence_module.write_text = dying_text  # type: ignore[attr-defined]
    else:
        raise SystemExit(f"no such point: {point}")


def child(arguments: list[str], out: Path, err: Path, most_bytes: int | None) -> None:
    """The process: its output goes to two files; no file may grow beyond `most_bytes`."""
    for place, handle in ((out, 1), (err, 2)):
        os.dup2(os.open(place, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), handle)
    if most_bytes is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))
    sys.exit(main(arguments))


def main(arguments: list[str]) -> int:
    rig_path, plan_path, folder, *death = arguments
    rig = open_rig(rig_path)
    timer: threading.Timer | None = None
    if death[:1] == ["milliseconds"]:
        timer = threading.Timer(1e-3 * int(death[1]), die)
    elif death:
        arm(death[0], int(death[1]), rig)

    def progress(state: Any) -> None:
        if timer is not None and not timer.ident:
            timer.start()
        print(state.done, flush=True)

    try:
        with rig:
            record = acquire(rig, load_plan(plan_path), Path(folder), progress=progress)
    except ClditError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return ACQUIRE_FAILED
    print("complete" if record.complete else "stopped", record.lost_injections, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
