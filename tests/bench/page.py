"""Command line of a measurement that writes a page of docs/benchmarks."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from cldit.bench.case import changed
from cldit.bench.report import Part, write_part
from cldit.gpu.device import Device, open_device
from cldit.run import default_cache
from cldit.scene import Scene, load_scene
from tests.bench.case import Case

FOLDER = Path(__file__).parents[2] / "docs" / "benchmarks"
UNLISTED = Path("build/benchmarks")  # of a page whose table another page has


@dataclass(frozen=True)
class Given:
    """Options of a measurement."""

    options: argparse.Namespace

    @cached_property
    def device(self) -> Device:
        """Device that is measured."""
        return open_device(self.options.device)

    @cached_property
    def scene(self) -> Scene:
        """Scene that is measured."""
        return load_scene(self.options.scene)

    @property
    def cache(self) -> Path:
        """Folder of tables."""
        return default_cache()

    def case(self) -> Case:
        """Scene with isotropic scattering, ready to be traced."""
        fixed = {"phase": "isotropic", "method": "source", "order": None, "accuracy_K": 0.1}
        return Case.of(changed(self.scene, transport=fixed), self.device, cache=self.cache)

    def say(self, line: str) -> None:
        """Prints a line of progress."""
        print(line, file=sys.stderr, flush=True)

    def save(self, part: Part) -> None:
        """Writes a page as far as it is measured."""
        command = " ".join(sys.argv)
        print(write_part(part, self.options.out, command=command, device=self.device))


def write_measured(
    measure: Callable[[Given], Part],
    options: Callable[[argparse.ArgumentParser], object] = lambda parser: None,
    *,
    folder: Path = FOLDER,
) -> None:
    """Measures what the command line asks for, and writes the page."""
    parser = argparse.ArgumentParser(prog=sys.argv[0], description=measure.__doc__)
    parser.add_argument("--scene", default="gdi-cone", help="a shipped name or a YAML file")
    parser.add_argument("--device", help="index or name of an OpenCL device")
    parser.add_argument("--out", type=Path, default=folder, help="folder of the page")
    options(parser)
    given = Given(parser.parse_args())
    given.save(measure(given))
