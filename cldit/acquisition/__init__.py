"""Plan -> runner -> record."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cldit.acquisition.dry_runs import DryRun as DryRun
    from cldit.acquisition.dry_runs import dry_run as dry_run
    from cldit.acquisition.plan import Plan as Plan
    from cldit.acquisition.plan import load_plan as load_plan
    from cldit.acquisition.plan import parse_plan as parse_plan
    from cldit.acquisition.plan import plan_from_scene as plan_from_scene
    from cldit.acquisition.progress import Progress as Progress
    from cldit.acquisition.record import Acquisition as Acquisition
    from cldit.acquisition.record import Picture as Picture
    from cldit.acquisition.record import open_acquisition as open_acquisition
    from cldit.acquisition.runner import acquire as acquire
    from cldit.acquisition.runner import iterate as iterate
    from cldit.acquisition.sequence import Record as Record
    from cldit.acquisition.shot import SavedShot as SavedShot

# Loaded when asked for: a trace needs the progress alone.
_HOMES = {
    "cldit.acquisition.dry_runs": ("DryRun", "dry_run"),
    "cldit.acquisition.plan": ("Plan", "load_plan", "parse_plan", "plan_from_scene"),
    "cldit.acquisition.progress": ("Progress",),
    "cldit.acquisition.record": ("Acquisition", "Picture", "open_acquisition"),
    "cldit.acquisition.runner": ("acquire", "iterate"),
    "cldit.acquisition.sequence": ("Record",),
    "cldit.acquisition.shot": ("SavedShot",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [*sorted(_HOME_OF)]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'cldit.acquisition' has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)
