"""Optional packages: checked before work begins, named with the command that installs them."""

import sys
from importlib import import_module
from importlib.metadata import requires
from pathlib import Path
from typing import Any

from cldit.errors import ClditError


def install_line(extra: str) -> str:
    """Command that installs the packages of an `extra` of this installation, wherever it is from.

    Raises LookupError if there is no such extra.
    """
    marker = f'extra == "{extra}"'
    requirements = [
        requirement.partition(";")
        for requirement in requires("cldit") or ()
        if marker in requirement
    ]
    if not requirements:
        raise LookupError(f"{extra}: no extra of cldit")
    python = Path(sys.executable)
    if python.is_relative_to(Path.cwd()):
        python = python.relative_to(Path.cwd())
    packages = " ".join(f'"{name.strip()}"' for name, _, _ in requirements)
    command = f'"{python}"' if " " in str(python) else str(python)
    return f"{command} -m pip install {packages}"


def needed(
    module: str, *, extra: str, needed_by: str, error: type[ClditError] = ClditError, hint: str = ""
) -> Any:
    """Imports an optional module; raises `error` with its install line if it is missing.

    needed_by: begins the message: the file or the work. hint: ends it.
    """
    try:
        return import_module(module)
    except ImportError as cause:
        package = module.partition(".")[0].removesuffix("modules")  # vtkmodules are vtk's
        message = f"{needed_by} needs {package}; install it with: {install_line(extra)}{hint}"
        raise error(message) from cause
