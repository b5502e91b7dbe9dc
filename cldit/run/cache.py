"""Runs cached by the content of their trace, so that no trace is computed twice."""

import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from filelock import FileLock

from cldit.errors import RunFolderError
from cldit.gpu.device import Device
from cldit.io.caches import default_cache
from cldit.io.files import make_folder, written
from cldit.prepare.stages import Say
from cldit.run.content import trace_key
from cldit.run.folder import open_run
from cldit.run.result import Run
from cldit.run.simulate import reevaluated, simulate
from cldit.scene import Scene
from cldit.scene.scatter import members_of
from cldit.spray.result import Spray

MOST_BYTES = 20_000_000_000  # runs not used for longest go first


@dataclass(frozen=True)
class RunCache:
    """Run folders in CACHE/runs, each under the digest of its trace.

    `computed` names the scenes that were traced, not found.
    """

    cache: Path = field(default_factory=default_cache)
    most_bytes: int = MOST_BYTES
    computed: list[str] = field(default_factory=list)

    def run(
        self,
        scene: Scene,
        *,
        device: Device | None = None,
        spray: Callable[[], Spray] | None = None,
        progress: Say | None = None,
    ) -> Run:
        """The scene's run: traced, or a cached trace for the scene's backgrounds and walls.

        Of two processes with the same trace, the second waits for the first.

        `spray` makes the scene's spray if it must be traced. Raises as `cldit.simulate`.
        """
        folder = self.cache / "runs" / trace_key(scene)
        make_folder(folder.parent)
        with FileLock(folder.with_suffix(".lock")):
            run = self._cached_run(folder)
            if run is None:
                run = self._traced(scene, folder, device, spray, progress)
                self.computed.append(scene.name)
                self._prune(folder)
        return reevaluated(run, scene)

    def _cached_run(self, folder: Path) -> Run | None:
        if not folder.is_dir():
            return None
        try:
            run = open_run(folder)
        except RunFolderError:  # damaged: made anew
            shutil.rmtree(folder)
            return None
        os.utime(folder)
        return run

    def _traced(
        self,
        scene: Scene,
        folder: Path,
        device: Device | None,
        spray: Callable[[], Spray] | None,
        progress: Say | None,
    ) -> Run:
        """Traces into a folder that appears complete or not at all."""
        part = folder.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)  # left by a killed process
        nominal_spray = None if spray is None or members_of(scene) > 1 else spray()
        try:
            run = simulate(
                scene, part, device=device, cache=self.cache, spray=nominal_spray, progress=progress
            )
            with written(folder):
                part.rename(folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
        return run

    def _prune(self, newest: Path) -> None:
        ages: list[tuple[float, int, Path]] = []
        for folder in newest.parent.iterdir():
            if folder.is_dir() and not folder.suffix:
                size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
                ages.append((folder.stat().st_mtime, size, folder))
        total = sum(size for _, size, _ in ages)
        for used, size, folder in sorted(ages):
            if total <= self.most_bytes or folder == newest or time.time() - used < 3600:
                break
            shutil.rmtree(folder, ignore_errors=True)
            total -= size
