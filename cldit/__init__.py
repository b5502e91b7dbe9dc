"""cldit: differential infrared thermography of fuel sprays, simulated, acquired, evaluated."""

import warnings
from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from cldit.io.presented import Presented as _Presented

if TYPE_CHECKING:
    from cldit.api.evaluated import evaluate as evaluate
    from cldit.api.exporting import export as export
    from cldit.api.planning import plan as plan
    from cldit.api.planning import separate as separate
    from cldit.api.progress_bars import progress_bar as progress_bar
    from cldit.api.repeat import repeat as repeat
    from cldit.api.scripting import open_rig as open_rig
    from cldit.api.series import run_series as run_series
    from cldit.api.simulation import simulate as simulate
    from cldit.api.viewing import view as view
    from cldit.cfd.importing import import_case as import_case
    from cldit.comparison import compare as compare
    from cldit.gpu.device import list_devices as list_devices
    from cldit.run import Run as Run
    from cldit.run import open_run as open_run
    from cldit.run.trusted import open_device
    from cldit.scene import Scene as Scene
    from cldit.scene import load_scene as load_scene
    from cldit.scene import shipped_scenes as shipped_scenes
    from cldit.show.figures.plot import plot as plot
    from cldit.study.dataset import open_study as open_study
    from cldit.study.fit import fit as fit
    from cldit.study.sweep import run_sweep

    opencl_device, sweep = open_device, run_sweep

__version__ = version("cldit")

# Loaded when asked for: a script that opens a rig needs neither OpenCL nor matplotlib.
_HOMES = {
    "Run": "cldit.run:Run",
    "Scene": "cldit.scene:Scene",
    "compare": "cldit.comparison:compare",
    "evaluate": "cldit.api.evaluated:evaluate",
    "export": "cldit.api.exporting:export",
    "fit": "cldit.study.fit:fit",
    "import_case": "cldit.cfd.importing:import_case",
    "list_devices": "cldit.gpu.device:list_devices",
    "load_scene": "cldit.scene:load_scene",
    "open_rig": "cldit.api.scripting:open_rig",
    "open_run": "cldit.run:open_run",
    "open_study": "cldit.study.dataset:open_study",
    "opencl_device": "cldit.run.trusted:open_device",
    "plan": "cldit.api.planning:plan",
    "plot": "cldit.show.figures.plot:plot",
    "progress_bar": "cldit.api.progress_bars:progress_bar",
    "repeat": "cldit.api.repeat:repeat",
    "run_series": "cldit.api.series:run_series",
    "separate": "cldit.api.planning:separate",
    "shipped_scenes": "cldit.scene:shipped_scenes",
    "simulate": "cldit.api.simulation:simulate",
    "sweep": "cldit.study.sweep:run_sweep",
    "view": "cldit.api.viewing:view",
}
# Names of 0.1, which leave with 0.4.
_RENAMED = {
    "dump_scene": ("cldit.scene:dump_scene", "Scene.to_yaml"),
    "open_device": ("cldit.run.trusted:open_device", "opencl_device"),
    "parse_scene": ("cldit.scene:parse_scene", "Scene.from_dict"),
    "run_experiment": ("cldit.api.experiment:run_experiment", "simulate(.., record=True)"),
}

__all__ = ["__version__", *sorted(_HOMES)]


def _figures() -> Any:
    return import_module("cldit.show.figures.plot")


_Presented.load_figures = _figures


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if name in _RENAMED:
        home, successor = _RENAMED[name]
        warnings.warn(f"cldit.{name} is cldit.{successor} now", DeprecationWarning, stacklevel=2)
    if home is None:
        raise AttributeError(f"module 'cldit' has no attribute {name!r}")
    module, _, attribute = home.partition(":")
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted(__all__)
