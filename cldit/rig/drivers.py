"""Drivers by name: the entry points of the group `cldit.drivers`.

A driver is a callable `factory(settings, context)` that returns a device; any installed package
can contain drivers. A driver checks its settings with `check_settings`.
"""

import difflib
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from cldit.errors import SceneError
from cldit.io.extras import install_line
from cldit.rig.clock import Clock
from cldit.scene.checks import Section, describe

GROUP = "cldit.drivers"

S = TypeVar("S", bound=Section)


@dataclass(frozen=True)
class RigContext:
    """The rig around a driver.

    clock: the rig's time. bench: the simulated optical bench that simulated devices share, None
    on a real rig. folder: start of relative paths in settings. seed: of simulations.
    """

    clock: Clock
    bench: object | None
    folder: Path
    seed: int


@dataclass(frozen=True)
class DriverAbout:
    """Description of a driver for `cldit devices`, the constant `ABOUT` of its module.

    kind: bench, or one of `cldit.rig.protocols.KINDS`. needs: modules that it imports when it
    connects; install: the command that installs them. tested: the instruments it was tried on, in
    words.
    """

    kind: str
    instrument: str
    tested: str
    needs: tuple[str, ...] = ()
    install: str = field(default_factory=lambda: install_line("rig"))

    def missing(self) -> list[str]:
        """The modules that are not installed."""
        return [name for name in self.needs if not _is_installed(name)]


def _is_installed(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ImportError:  # its parent package is missing, or (GObject) its description
        return False


Factory = Callable[[dict[str, Any], RigContext], Any]


def check_settings(model: type[S], settings: dict[str, Any], folder: Path | None = None) -> S:
    """Converts settings to the driver's own frozen data, of type `model`.

    `folder`: start of relative paths of files that are read, as `context.folder`; None: the working
    directory.

    Raises:
        SceneError: one line for each key that is unknown, missing or not allowed.
    """
    try:
        return model.model_validate(settings, context={"folder": folder})
    except ValidationError as error:
        raise SceneError(describe(model, error.errors())) from error


def installed_drivers() -> dict[str, EntryPoint]:
    """All installed drivers, by name."""
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP))}


def describe_drivers() -> dict[str, DriverAbout]:
    """Descriptions of all installed drivers, by name."""
    descriptions: dict[str, DriverAbout] = {}
    for name, entry in installed_drivers().items():
        try:
            about = getattr(import_module(entry.module), "ABOUT", None)
        except ImportError as error:
            about = DriverAbout("?", entry.value, f"cannot be loaded: {error}")
        if not isinstance(about, DriverAbout):
            about = DriverAbout("?", entry.value, "has no description")
        descriptions[name] = about
    return descriptions


def load_driver(name: str) -> Factory:
    """The factory of a driver.

    Raises:
        SceneError: there is no such driver, it cannot be imported, or a module that it needs is
            missing; the message does not begin with a path.
    """
    installed = installed_drivers()
    if name not in installed:
        close = difflib.get_close_matches(name, installed, n=1)
        hint = f"; did you mean {close[0]}?" if close else ";"
        raise SceneError(
            f"driver: {name!r} is not installed{hint} "
            f"allowed: {', '.join(installed) or 'none (reinstall cldit)'}"
        )
    entry = installed[name]
    try:
        factory: Factory = entry.load()
        about = getattr(import_module(entry.module), "ABOUT", None)
        if isinstance(about, DriverAbout):
            if missing := about.missing():
                raise SceneError(
                    f"driver: {name!r} needs {', '.join(missing)}, which this Python does not "
                    f"have; {about.install}"
                )
            # Here, by one thread: modules that import each other, first imported by the threads
            # that connect the instruments, can wait for each other.
            for module in about.needs:
                import_module(module)
    except (ImportError, AttributeError) as error:
        raise SceneError(
            f"driver: {name!r} ({entry.value}) cannot be loaded: {error}; "
            "install the modules that it needs"
        ) from error
    return factory
