"""Plan -> runner -> record."""

from cldit.acquisition.dry_run import DryRun, dry_run
from cldit.acquisition.plan import Plan, load_plan, parse_plan, plan_from_scene
from cldit.acquisition.progress import Progress
from cldit.acquisition.record import Acquisition, Picture, open_acquisition
from cldit.acquisition.runner import acquire, iterate
from cldit.acquisition.sequence import Record, SavedShot

__all__ = [
    "Acquisition",
    "DryRun",
    "Picture",
    "Plan",
    "Progress",
    "Record",
    "SavedShot",
    "acquire",
    "dry_run",
    "iterate",
    "load_plan",
    "open_acquisition",
    "parse_plan",
    "plan_from_scene",
]
