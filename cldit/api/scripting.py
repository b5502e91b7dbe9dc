"""The rig for scripts.

with cldit.open_rig("rig.yaml") as rig:
    for saved in rig.acquire("plan.yaml", "shots"):
        print(saved.shot.id, saved.image.mean())
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cldit.acquisition.dry_runs import DryRun, dry_run
from cldit.acquisition.plan import Plan, load_plan, parse_plan
from cldit.acquisition.progress import Progress
from cldit.acquisition.runner import iterate
from cldit.acquisition.sequence import Record
from cldit.acquisition.shot import SavedShot
from cldit.rig.clock import Clock, StopCheck
from cldit.rig.load import Rig
from cldit.rig.load import open_rig as _open_rig

AnyPlan = Plan | str | Path | dict[str, Any]


@dataclass(frozen=True)
class ScriptRig(Rig):
    """Rig for plans. Leaving the `with` block makes it safe and closes it."""

    def acquire(
        self,
        plan: AnyPlan,
        folder: str | Path,
        *,
        progress: Callable[[Progress], None] | None = None,
        should_stop: StopCheck | None = None,
    ) -> Generator[SavedShot, None, Record]:
        """Yields the missing shots of a plan, each after it is on the disk.

        Ctrl-C, resuming and the journal are those of `cldit.acquisition.acquire`. Leaving the loop
        early ends the acquisition after the present shot.

        Args:
            plan: a plan, or the path of one.
            folder: folder of the shots.
            progress, should_stop: as in `cldit.acquisition.acquire`.

        Returns:
            The record, as the generator's return value.

        Raises:
            SceneError: the plan is invalid.
            ClditError: as `cldit.acquisition.acquire`.
        """
        return iterate(self, _plan(plan), Path(folder), progress=progress, should_stop=should_stop)

    def dry_run(self, plan: AnyPlan, folder: str | Path) -> DryRun:
        """Checks a `plan` into a `folder` as `cldit.acquisition.dry_run`.

        Args:
            plan: a plan, or the path of plan.yaml.
            folder: folder of the shots.

        Returns:
            Time, disk space, and the problems that forbid the acquisition.
        """
        return dry_run(self, _plan(plan), Path(folder))


def _plan(plan: AnyPlan) -> Plan:
    if isinstance(plan, Plan):
        return plan
    return parse_plan(plan) if isinstance(plan, dict) else load_plan(Path(plan))


def open_rig(file: str | Path | dict[str, Any], *, clock: Clock | None = None) -> ScriptRig:
    """Opens the instruments of a rig file; leaving the `with` block makes them safe.

    Args:
        file: rig.yaml, or its content.
        clock: another clock than the system's, as in tests.

    Returns:
        The rig, whose `acquire` takes a plan.

    Raises:
        SceneError: names every invalid key and every missing driver.
    """
    rig = _open_rig(file, clock=clock)
    return ScriptRig(rig.camera, rig.background, rig.trigger, rig.clock, rig.file)
