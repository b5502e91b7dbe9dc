"""Templates of study pages, until these are written by `cldit.show.page`."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from cldit.show.page import Figure

Picture = Figure

_PAGES = Environment(
    loader=PackageLoader("cldit.show.report", ""),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)
_PAGES.filters["b64"] = lambda data: b64encode(data).decode("ascii")


def render(template: str, **values: Any) -> str:
    """HTML of a template beside this file; values are plain text and get escaped."""
    return _PAGES.get_template(template).render(values)
