"""cldit: differential infrared thermography of fuel sprays, simulated, acquired, evaluated."""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cldit.api.evaluated import evaluate as evaluate
    from cldit.api.experiment import run_experiment as run_experiment
    from cldit.api.progress_bars import progress_bar as progress_bar
    from cldit.api.repeat import repeat as repeat
    from cldit.api.scripting import open_rig as open_rig
    from cldit.api.series import run_series as run_series
    from cldit.comparison import compare as compare
    from cldit.gpu.device import list_devices as list_devices
    from cldit.run import Run as Run
    from cldit.run import open_run as open_run
    from cldit.run import simulate as simulate
    from cldit.run.trusted import open_device as open_device
    from cldit.scene import Scene as Scene
    from cldit.scene import dump_scene as dump_scene
    from cldit.scene import load_scene as load_scene
    from cldit.scene import parse_scene as parse_scene
    from cldit.scene import shipped_scenes as shipped_scenes
    from cldit.show.figures.plot import plot as plot
    from cldit.study.dataset import open_study as open_study

__version__ = version("cldit")

# Loaded when asked for: a script that opens a rig needs neither OpenCL nor matplotlib.
_HOMES = {
    "cldit.comparison": ("compare",),
    "cldit.api.repeat": ("repeat",),
    "cldit.api.evaluated": ("evaluate",),
    "cldit.api.experiment": ("run_experiment",),
    "cldit.gpu.device": ("list_devices",),
    "cldit.api.progress_bars": ("progress_bar",),
    "cldit.show.figures.plot": ("plot",),
    "cldit.run": ("Run", "open_run", "simulate"),
    "cldit.run.trusted": ("open_device",),
    "cldit.scene": ("Scene", "dump_scene", "load_scene", "parse_scene", "shipped_scenes"),
    "cldit.api.scripting": ("open_rig",),
    "cldit.api.series": ("run_series",),
    "cldit.study.dataset": ("open_study",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", *sorted(_HOME_OF)]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'cldit' has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
