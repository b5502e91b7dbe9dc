"""cldit: differential infrared thermography of fuel sprays, simulated, acquired, evaluated."""

from importlib.metadata import version

__version__ = version("cldit")


from cldit.experiment import run_experiment
from cldit.gpu.device import list_devices, open_device
from cldit.run import Run, open_run, simulate
from cldit.scene import Scene, dump_scene, load_scene, parse_scene, shipped_scenes
from cldit.scripting import open_rig
from cldit.study.dataset import open_study

__all__ = [
    "Run",
    "Scene",
    "__version__",
    "dump_scene",
    "list_devices",
    "load_scene",
    "open_device",
    "open_rig",
    "open_run",
    "open_study",
    "parse_scene",
    "run_experiment",
    "shipped_scenes",
    "simulate",
]
