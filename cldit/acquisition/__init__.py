"""Plan -> runner -> record."""

from cldit.acquisition.plan import Plan, load_plan, parse_plan, plan_from_scene
from cldit.acquisition.progress import Progress
from cldit.acquisition.record import Acquisition, Picture, open_acquisition
from cldit.acquisition.runner import Record, acquire

__all__ = [
    "Acquisition",
    "Picture",
    "Plan",
    "Progress",
    "Record",
    "acquire",
    "load_plan",
    "open_acquisition",
    "parse_plan",
    "plan_from_scene",
]
