"""Cache of computed sprays, by the scene's spray and the code that computed it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from importlib.metadata import version
from pathlib import Path

from filelock import FileLock

from cldit.errors import SprayError
from cldit.io.content import code_digest, digest
from cldit.io.files import make_folder
from cldit.scene.spray import LagrangianSpray
from cldit.spray.result import Spray
from cldit.spray.spray_file import read_spray, write_spray

_together: ContextVar[tuple[float, ...]] = ContextVar("times of a series", default=())


@contextmanager
def times_together(times_s: Sequence[float]) -> Iterator[None]:
    """Within it, a computed spray at one of these times is integrated once for all of them."""
    token = _together.set(tuple(sorted(set(times_s))))
    try:
        yield
    finally:
        _together.reset(token)


def cached_spray(
    spec: LagrangianSpray,
    folder: Path | None,
    make: Callable[[tuple[float, ...]], Iterator[Spray]],
) -> Spray:
    """Spray at the time of `spec`, by `make` for increasing times, or from `folder`, where the same
    code put it for the same `spec`.

    Two processes that need the same spray compute it once: the second waits. A damaged file is
    computed again; a read-only folder costs only the time. None: no cache.
    """
    asked = spec.time_s
    if folder is None:
        return next(make((asked,)))
    times = _together.get() if asked in _together.get() else (asked,)
    files = {time_s: _file(spec, time_s, folder) for time_s in times}
    try:
        make_folder(files[asked].parent)
    except OSError:
        return next(make((asked,)))
    with FileLock(_file(spec, 0.0, folder).with_suffix(".lock")):
        if files[asked].is_file():
            try:
                return read_spray(files[asked])
            except SprayError:
                files[asked].unlink()
        lacking = tuple(time_s for time_s in times if not files[time_s].is_file())
        requested: Spray | None = None
        try:
            for time_s, spray in zip(lacking, make(lacking), strict=True):
                requested = spray if time_s == asked else requested
                with suppress(OSError):
                    write_spray(files[time_s], spray)
        except SprayError:
            if requested is None:
                raise  # else it concerns a later time, and is raised there
    assert requested is not None
    return requested


def _file(spec: LagrangianSpray, time_s: float, folder: Path) -> Path:
    chosen = spec.model_copy(update={"time_s": time_s}).model_dump(mode="json", exclude={"scatter"})
    key = digest(chosen, code_digest("spray", "kernels"), version("CoolProp"))
    return folder / "sprays" / f"{key}.npz"
