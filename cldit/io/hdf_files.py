"""Other files that an HDF5 file refers to: they must be there, whole, and regular.

HDF5 reads zeros where the source of a virtual data set is missing or too short, and waits for ever
for a pipe. Names are searched as HDF5 does (H5F_prefix_open_file in its source).
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cldit.errors import FileError
from cldit.io.files import check_regular

_ITSELF = "."
_BLOCK = "%b"  # in names of sources: a number, from 0 as far as there are files
_DEEPEST = 20  # files in a chain of sources or links; a longer one is taken for a circle


def check_links(
    path: Path, file: Any, *, complete: bool, _seen: set[Path] | None = None
) -> set[Path]:
    """Checks all external links of an open file and of the files that they lead to, which are
    returned; these must exist if `complete`. Raises FileError, which names the file.
    """
    visited = {path.resolve()} if _seen is None else _seen
    targets: set[Path] = set()
    for name, link in _external(file, set()):
        target = _search(path, link.filename, "HDF5_EXT_PREFIX")
        if target is None and complete:
            raise FileError(
                f"{path}: {name}: is a link to {path.parent / link.filename}, which is missing"
            )
        if target is None or target.resolve() in visited:
            continue
        check_regular(target)
        if len(visited) > _DEEPEST:
            raise FileError(f"{path}: more than {_DEEPEST} files are linked one to the other")
        visited.add(target.resolve())
        with _opened(path, name, target) as linked:
            targets |= {target} | check_links(target, linked, complete=complete, _seen=visited)
    return targets


def check_sources(path: Path, data: Any, *, complete: bool = True, _depth: int = 0) -> set[Path]:
    """Checks that all values of a data set of an open file are in files that exist, and returns
    these. Raises FileError, which names the missing file, the source that is too short, or, if it
    must be `complete`, the number of chunks that were never written.
    """
    names = [os.fsdecode(name) for name, *_ in data.external or ()]
    sources = {_source_file(path, name, "HDF5_EXTFILE_PREFIX", data.name) for name in names}
    if not data.is_virtual:
        if complete and data.chunks is not None and data.size:
            chunk_count = int(np.prod(-(-np.array(data.shape) // np.array(data.chunks))))
            check_chunks(f"{path}: {data.name}", chunk_count, data.id.get_num_chunks())
        elif complete and data.size and not names and not data.id.get_storage_size():
            raise FileError(f"{path}: {data.name}: was never written, and would be read as zeros")
        return sources
    if _depth > _DEEPEST:
        raise FileError(f"{path}: {data.name}: is a virtual data set of itself")
    for source in data.virtual_sources():
        where = path
        if source.file_name != _ITSELF:
            name = source.file_name.replace(_BLOCK, "0")
            where = _source_file(path, name, "HDF5_VDS_PREFIX", data.name)
            sources.add(where)
        with _opened(path, data.name, where) as file:
            part = file.get(source.dset_name.replace(_BLOCK, "0"))
            if part is None:
                raise FileError(
                    f"{path}: {data.name}: {where} has no {source.dset_name}, its source"
                )
            _check_extent(path, data.name, where, part, source)
            sources |= check_sources(where, part, complete=complete, _depth=_depth + 1)
    return sources


def check_chunks(where: str, chunk_count: int, written: int) -> None:
    """Raises FileError if chunks of an array were never written; they would be read as zeros."""
    if written < chunk_count:
        raise FileError(
            f"{where}: {chunk_count - written} of {chunk_count} chunks are missing, and "
            "would be read as zeros"
        )


def _check_extent(path: Path, name: str, where: Path, part: Any, source: Any) -> None:
    """Raises FileError if a source has fewer values than are taken from it."""
    import h5py

    space = source.src_space
    try:
        if space.get_select_type() == h5py.h5s.SEL_ALL:  # of any shape
            needed: tuple[int, ...] = (int(source.vspace.get_select_npoints()),)
            short = part.size < needed[0]
        else:
            needed = tuple(int(bound) + 1 for bound in space.get_select_bounds()[1])
            short = len(needed) != part.ndim or bool(np.any(np.greater(needed, part.shape)))
    except (ValueError, RuntimeError):  # unlimited, or empty
        return
    if short:
        raise FileError(
            f"{path}: {name}: its source {where} has the shape {part.shape}, expected at least "
            f"{needed}; it is incomplete"
        )


def _opened(path: Path, name: str, target: Path) -> Any:
    """Another file that `name` in a file refers to."""
    import h5py

    try:
        return h5py.File(target, "r")
    except OSError as error:
        raise FileError(f"{path}: {name}: {target} cannot be read ({error})") from error


def _external(group: Any, visited: set[Any]) -> Iterator[tuple[str, Any]]:
    """External links in a group and those below, with their names."""
    import h5py

    visited.add(group.id)
    for key in group:
        link = group.get(key, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            yield f"{group.name.rstrip('/')}/{key}", link
        elif isinstance(link, h5py.HardLink):
            item = group.get(key)
            if isinstance(item, h5py.Group) and item.id not in visited:
                yield from _external(item, visited)


def _source_file(path: Path, name: str, prefix: str, data: str) -> Path:
    """A regular file that is a source of a data set; raises FileError if it is missing."""
    source = _search(path, name, prefix)
    if source is None:
        raise FileError(
            f"{path}: {data}: its source {path.parent / name} is missing, and would be read as "
            "zeros"
        )
    check_regular(source)
    return source


def _search(path: Path, name: str, prefix: str) -> Path | None:
    """The file that HDF5 opens under a name in a file; None if there is none."""
    stated_path = Path(name)
    below = Path(stated_path.name) if stated_path.is_absolute() else stated_path
    file_folder = path.absolute().parent
    prefixes = os.environ.get(prefix, "").replace("${ORIGIN}", str(file_folder))
    folders = [part for part in prefixes.split(":") if part]
    places = [*(Path(folder) / below for folder in folders), file_folder / below, below]
    places.append(path.resolve().parent / below)
    if stated_path.is_absolute():
        places.insert(0, stated_path)
    return next((place for place in places if place.exists()), None)
