"""Cache of computed sprays, by the scene's spray and the code that computed it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from filelock import FileLock

from cldit.errors import SprayError
from cldit.io.content import code_digest, digest
from cldit.io.files import make_folder
from cldit.scene.checks import Section
from cldit.spray.result import Spray
from cldit.spray.spray_file import read_spray, write_spray


def cached_spray(spec: Section, folder: Path | None, make: Callable[[], Spray]) -> Spray:
    """Result of `make`, or the spray in `folder` that the same code computed for the same `spec`.

    Two processes that need the same spray compute it once: the second waits. A damaged file is
    computed again; a read-only folder costs only the time. None: no cache.
    """
    if folder is None:
        return make()
    key = digest(
        spec.model_dump(mode="json", exclude={"scatter"}), code_digest("spray"), version("CoolProp")
    )
    path = folder / "sprays" / f"{key}.npz"
    try:
        make_folder(path.parent)
    except OSError:
        return make()
    with FileLock(path.with_suffix(".lock")):
        if path.is_file():
            try:
                return read_spray(path)
            except SprayError:
                path.unlink()
        spray = make()
        with suppress(OSError):
            write_spray(path, spray)
    return spray
