"""Page of `cldit view` as one HTML file: template, styles, scripts and data."""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from matplotlib import colormaps

from cldit.dit.maps import Reason
from cldit.io.files import read_text, write_text
from cldit.scene.delays import delay_text
from cldit.show.figures.colours import HUE
from cldit.show.view.item import Item
from cldit.show.view.packing import packed

# In the order in which they depend on each other.
_WORKER = (
    "quantities",
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
    "quantities",
    "axes",
    "figure",
    "profile",
    "saving",
    "sliders",
    "jobs",
    "cursor",
    "readout",
    "link",
    "page",
)
# Even in lightness, or distinguishable without red and green; matplotlib's names.
_SEQUENTIAL = {
    "cividis": "cividis (same for the colour-blind)",
    "viridis": "viridis",
    "gray": "grey (for print)",
    "gray_r": "grey, dark is high",
    "inferno": "inferno",
    "plasma": "plasma",
    HUE.name: "hue, as in the paper (saturation: emissivity)",
}
_DIVERGING = {"RdBu_r": "blue to red", "PuOr_r": "purple to orange"}


def page_html(items: Sequence[Item]) -> str:
    """HTML of the page of `items` (one or more), in their order."""
    heads: list[dict[str, Any]] = []
    arrays: list[str] = []
    for number, item in enumerate(items):
        texts = {name: packed(array) for name, array in item.arrays.items()}
        heads.append({**item.head, "arrays": {name: head for name, (head, _) in texts.items()}})
        arrays += [
            f'<script type="text/plain" data-item="{number}" data-name="{escape(name)}">'
            f"{text}</script>"
            for name, (_, text) in texts.items()
        ]
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
    about = heads[0]["about"]
    return Template(_source("page.html")).substitute(
        title=escape(title),
        about=f"<p>{escape(about)}</p>" if about else "",
        made=f"Made by cldit {version('cldit')}. Nothing on this page is sent anywhere.",
        style=_source("page.css"),
        data=json.dumps(data).replace("<", "\\u003c"),
        worker="\n".join(_source(f"script/{name}.js") for name in _WORKER),
        script="\n".join(_source(f"script/{name}.js") for name in _PAGE),
        arrays="\n".join(arrays),
    )


def save_page(path: Path, items: Sequence[Item]) -> None:
    """Writes the page of `items` to `path`; the file appears whole or not at all.

    Args:
        path: .html file.
        items: runs and recordings, as of `view_items`.

    Raises:
        DiskFull, FileError: the file cannot be written.
    """
    write_text(path, page_html(items))


def _apart(heads: Sequence[Mapping[str, Any]]) -> list[str]:
    """Distinct names: with time of the spray, folder or number, the first that distinguishes."""
    names = [str(head["name"]) for head in heads]
    times = [head["time_s"] for head in heads]
    for number, (name, time_s) in enumerate(zip(list(names), times, strict=True)):
        alike = [at for at, head in enumerate(heads) if head["name"] == name]
        if len(alike) == 1:
            continue
        has_own_time = time_s is not None and [times[at] for at in alike].count(time_s) == 1
        folders = [_folder(heads[at]) for at in alike]
        suffix = folders[alike.index(number)]
        if len(set(folders)) < len(folders) or not suffix:
            suffix = f"{alike.index(number) + 1} of {len(alike)}"
        suffix = delay_text(time_s) if has_own_time else suffix
        names[number] = f"{name}, {suffix}"
    return names


def _folder(head: Mapping[str, Any]) -> str:
    """Name of the folder of an item."""
    place = Path(str(head["source"]))
    return (place.parent if head["kind"] == "run" else place).name


@cache
def _source(name: str) -> str:
    """Text of a file beside this one."""
    return read_text(Path(__file__).parent / name)


def _colours(name: str) -> list[int]:
    """256 RGB triples in one list."""
    table = HUE if name == HUE.name else colormaps[name]
    return [int(channel) for channel in table(np.arange(256), bytes=True)[:, :3].reshape(-1)]
