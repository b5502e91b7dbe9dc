"""cldit: differential infrared thermography of fuel sprays, simulated, acquired, evaluated."""

from importlib.metadata import version

__version__ = version("cldit")
