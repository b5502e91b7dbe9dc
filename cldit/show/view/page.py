"""The page as one HTML file: template, styles, scripts and data, all inside."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cldit.dit.maps import Reason
from cldit.io.files import write_text
from cldit.scene.delays import delay_text
from cldit.show.view.item import Item
from cldit.show.view.packing import packed

# In the order in which one builds on the other.
_WORKER = (
    "quantities",
    "middle",
    "unpack",
    "planck",
    "boundary",
    "lines",
    "traced",
    "measurement",
    "grid",
    "difference",
    "colour",
    "worker",
)
_PAGE = (
    "data",
    "quantities",
    "axes",
    "figure",
    "profile",
    "saving",
    "middle",
    "sliders",
    "jobs",
    "cursor",
    "readout",
    "page",
)
# Even in lightness, or told apart without red and green; in matplotlib's names.
_SEQUENTIAL = {
    "cividis": "cividis (same for the colour-blind)",
    "viridis": "viridis",
    "gray": "grey (for print)",
    "gray_r": "grey, dark is high",
    "inferno": "inferno",
}
_DIVERGING = {"RdBu_r": "blue to red", "PuOr_r": "purple to orange"}


@lru_cache(maxsize=1)
def _pages() -> Environment:
    return Environment(
        loader=PackageLoader("cldit.show.view", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )


def page_html(items: Sequence[Item]) -> str:
    """The whole page.

    Args:
        items: what it shows, the first first; at least one.
    """
    heads: list[dict[str, Any]] = []
    blobs: list[tuple[int, str, str]] = []
    for number, item in enumerate(items):
        arrays = {name: packed(array) for name, array in item.arrays.items()}
        heads.append({**item.head, "arrays": {name: one.head for name, one in arrays.items()}})
        blobs += [(number, name, one.text) for name, one in arrays.items()]
    for head, name in zip(heads, _apart(heads), strict=True):
        head["name"] = name
    data = {
        "items": heads,
        "reasons": {int(reason): reason.text for reason in Reason},
        "thin": int(Reason.EMISSIVITY_TOO_LOW),
        "colours": {name: _colours(name) for name in (*_SEQUENTIAL, *_DIVERGING)},
        "sequential": list(_SEQUENTIAL.items()),
        "diverging": list(_DIVERGING.items()),
    }
    names = list(dict.fromkeys(str(item.head["name"]) for item in items))
    title = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    return _pages().get_template("page.html").render(
        title=title,
        about=heads[0]["about"],
        made=f"Made by cldit {version('cldit')}. Nothing on this page is sent anywhere.",
        style=Markup(_source("page.css")),
        data=Markup(json.dumps(data).replace("<", "\\u003c")),
        worker=Markup("\n".join(_source(f"script/{name}.js") for name in _WORKER)),
        script=Markup("\n".join(_source(f"script/{name}.js") for name in _PAGE)),
        blobs=blobs,
    )  # fmt: skip


def save_page(path: Path, items: Sequence[Item]) -> None:
    """Writes the page of `items` to `path`; the file appears whole or not at all.

    Raises:
        DiskFull, FileError: as `cldit.io.files.written`.
    """
    write_text(path, page_html(items))


def _apart(heads: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names that differ: with the time where it tells items apart, and else with a number."""
    names = [str(head["name"]) for head in heads]
    times = [head["time_s"] for head in heads]
    for number, (name, time_s) in enumerate(zip(list(names), times, strict=True)):
        alike = [at for at, head in enumerate(heads) if head["name"] == name]
        if len(alike) == 1:
            continue
        told = time_s is not None and [times[at] for at in alike].count(time_s) == 1
        more = delay_text(time_s) if told else f"{alike.index(number) + 1} of {len(alike)}"
        names[number] = f"{name}, {more}"
    return names


def _source(name: str) -> str:
    """A file beside this one, as it is."""
    pages = _pages()
    assert pages.loader is not None
    return pages.loader.get_source(pages, name)[0]


def _colours(name: str) -> list[int]:
    """256 RGB triples in one list."""
    from matplotlib import colormaps

    return [int(one) for one in colormaps[name](range(256), bytes=True)[:, :3].reshape(-1)]
