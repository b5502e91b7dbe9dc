"""Acquisition as a bluesky device: the RunEngine steps through it, cldit's runner records it.

RunEngine()(all_shots(Shots("rig.yaml", "plan.yaml", "shots")))

Each `trigger` lets the runner continue to its next saved shot, with a change of background if due;
journal, guard, retakes and resuming are those of `cldit acquire`. `unstage` leaves the rig safe.
"""

from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp

from cldit.acquisition.sequence import SavedShot
from cldit.acquisition.storage import shot_path
from cldit.api.scripting import AnyPlan, open_rig

_UNITS = {"shot": "", "kind": "", "file": "", "background_before_K": "K", "background_after_K": "K"}


class _Status:
    """`bluesky.protocols.Status` of a task in a thread."""

    def __init__(self, future: Future[Any]) -> None:
        self._future, self.exception = future, future.exception

    done = property(lambda self: self._future.done())
    success = property(lambda self: self.done and self.exception() is None)

    def add_callback(self, callback: Callable[[Any], None]) -> None:
        self._future.add_done_callback(lambda _: callback(self))


class Shots:
    """Missing shots of a folder; rig, plan, folder as for `cldit.open_rig` and its `acquire`."""

    parent = None

    def __init__(self, rig: Any, plan: AnyPlan, folder: str | Path, name: str = "dit") -> None:
        self._rig, self._plan, self._folder, self.name = rig, plan, Path(folder), name

    def stage(self) -> list[Any]:
        """Starts the acquisition's thread."""
        self._stop, self._worker, self._shots = Event(), ThreadPoolExecutor(1), self._run()
        return [self]

    def _run(self) -> Generator[SavedShot, None, None]:
        with open_rig(self._rig) as rig:
            yield from rig.acquire(self._plan, self._folder, should_stop=self._stop.is_set)

    def trigger(self) -> _Status:
        """Lets the runner continue to its next saved shot."""
        self._taken = self._worker.submit(next, self._shots, None)
        return _Status(self._taken)

    def saved(self) -> SavedShot | None:
        """Waits for the triggered shot; None if there are no more."""
        return self._taken.result()

    def read(self) -> dict[str, Any]:
        """Last shot, as data for bluesky."""
        if (saved := self.saved()) is None:
            raise RuntimeError(f"{self._folder}: there are no more shots to read")
        values = {**saved.meta, "file": str(shot_path(self._folder, saved.shot.id))}
        when = 1e-9 * saved.meta["host_timestamp_ns"]
        return {f"{self.name}_{k}": {"value": values[k], "timestamp": when} for k in _UNITS}

    def describe(self) -> dict[str, Any]:
        """Types and units of the data of `read`."""
        common = {"source": f"cldit:{self._folder}", "shape": []}
        kinds = {k: {"dtype": "number" if u else "string", "units": u} for k, u in _UNITS.items()}
        return {f"{self.name}_{key}": common | kind for key, kind in kinds.items()}

    def unstage(self) -> list[Any]:
        """Ends the acquisition after the present shot."""
        self._stop.set()
        with self._worker:
            self._worker.submit(self._shots.close).result()
        return [self]


def all_shots(shots: Shots, md: dict[str, Any] | None = None) -> Iterator[Any]:
    """Bluesky plan: one run, an event for each of `shots`; a pause repeats nothing.

    md: for the run's start document.
    """

    def steps() -> Iterator[Any]:
        while True:
            yield from bps.checkpoint()
            yield from bps.trigger(shots, wait=True)
            if shots.saved() is None:
                return
            yield from bps.create()
            yield from bps.read(shots)
            yield from bps.save()

    run = bpp.run_wrapper(steps(), md={"plan_name": "all_shots", **(md or {})})
    yield from bpp.rewindable_wrapper(bpp.stage_wrapper(run, [shots]), False)
