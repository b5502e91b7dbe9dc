"""A run: one scene traced and evaluated, what came of it, and its folder."""

from cldit.io.caches import default_cache
from cldit.prepare.stages import Say, Stage, StageLine
from cldit.run.cache import RunCache
from cldit.run.folder import open_run, with_stages
from cldit.run.result import Run, RunInfo
from cldit.run.simulate import reevaluated, simulate

__all__ = [
    "Run",
    "RunCache",
    "RunInfo",
    "Say",
    "Stage",
    "StageLine",
    "default_cache",
    "open_run",
    "reevaluated",
    "simulate",
    "with_stages",
]
