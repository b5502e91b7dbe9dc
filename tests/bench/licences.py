"""Page docs/licences.md: SPDX licences of what `pip install` brings, from installed metadata.

python -m tests.bench licences > docs/licences.md
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from cldit.show.page import Page, Table

_PROJECT = Path(__file__).parents[2] / "pyproject.toml"
_TITLE = "Licences"
OF_DEVELOPERS = ("dev", "docs", "peers")  # extras that no user installs

# Packages without `License-Expression` in their metadata, by their licence files.
BY_FILE = {
    "contourpy": "BSD-3-Clause",
    "coolprop": "MIT",
    "cycler": "BSD-3-Clause",
    "fonttools": "MIT",
    "h5netcdf": "BSD-3-Clause",
    "hdf5plugin": "MIT",
    "imagecodecs": "BSD-3-Clause",
    "imageio-ffmpeg": "BSD-2-Clause",
    "kiwisolver": "BSD-3-Clause",
    "markdown-it-py": "MIT",
    "matplotlib": "LicenseRef-Matplotlib",
    "mdurl": "MIT",
    "numba": "BSD-2-Clause",
    "pocl-binary-distribution": "MIT",
    "pygobject": "LGPL-2.1-or-later",
    "pymodbus": "BSD-3-Clause",
    "pyserial": "BSD-3-Clause",
    "pyvisa": "MIT",
    "pyvisa-py": "MIT",
    "pyyaml": "MIT",
    "rich": "MIT",
    "scipy": "BSD-3-Clause",
    "tifffile": "BSD-3-Clause",
    "tzdata": "Apache-2.0",
    "viva-genicam": "MIT",
    "vtk": "BSD-3-Clause",
}
NOTES = {
    "matplotlib": "has the licence of Python (PSF) with other names",
    "pocl-binary-distribution": "contains LLVM (Apache-2.0 WITH LLVM-exception) and hwloc",
    "scipy": "contains libgfortran (GPL-3.0-or-later WITH GCC-exception-3.1)",
    "hdf5plugin": "contains filters with licences of their own",
    "imagecodecs": "contains codecs with licences of their own, listed in the package",
    "imageio-ffmpeg": "contains the program FFmpeg, GPL-3.0-or-later, which cldit starts",
}
_INTRODUCTION = """\
Which licences come with an installation? cldit is MIT. The table has the SPDX expression of each
package that `pip install ".[pocl]"` brings, and of each package that an extra names. Only the
extras `tdms` and `film` bring something that is LGPL or GPL without a choice. Made on
{date} by `python -m tests.bench licences` from the metadata of the installed versions; packages
without an SPDX expression there are marked *, by their licence file. Others: needed by other
packages.
"""


def project() -> dict[str, list[str]]:
    """Requirements by extra; those of cldit itself under an empty name."""
    data = tomllib.loads(_PROJECT.read_text(encoding="utf-8"))["project"]
    return {"": data["dependencies"], **data["optional-dependencies"]}


def names(requirements: Iterable[str]) -> set[str]:
    return {canonicalize_name(Requirement(text).name) for text in requirements}


def by_use() -> dict[str, str]:
    """Use of each package: the installation, the extras that name it, or empty if it is needed."""
    wanted = project()
    found = dict.fromkeys(_closure([*wanted[""], *wanted["pocl"]]), "")
    found |= dict.fromkeys(names(wanted.pop("")), "cldit")
    for extra, texts in wanted.items():
        if extra in OF_DEVELOPERS:
            continue
        for name in names(texts) - names(project()[""]):
            found[name] = f"{found[name]}, `{extra}`" if found.get(name) else f"`{extra}`"
    return found


def _closure(requirements: list[str]) -> set[str]:
    seen: set[tuple[str, str]] = set()
    waiting = [(Requirement(text), "") for text in requirements]
    while waiting:
        needed, extra = waiting.pop()
        if needed.marker is not None and not needed.marker.evaluate({"extra": extra}):
            continue
        for each in ("", *needed.extras):
            name = canonicalize_name(needed.name)
            if (name, each) not in seen:
                seen.add((name, each))
                texts = distribution(name).requires or ()
                waiting += [(Requirement(text), each) for text in texts]
    return {name for name, _ in seen}


def licence(name: str) -> str:
    """SPDX expression of a package. Raises KeyError if its licence is not known."""
    try:
        stated = distribution(name).metadata.get_all("License-Expression")
    except PackageNotFoundError:
        stated = None
    return stated[0] if stated else f"{BY_FILE[name]} *"


def licences_page(date: str) -> str:
    """Page in Markdown."""
    rows = [[name, licence(name), use or "others"] for name, use in sorted(by_use().items())]
    notes = "; ".join(f"{name} {note}" for name, note in sorted(NOTES.items()))
    table = Table(("package", "licence", "installed by"), rows)
    return Page(_TITLE, [_INTRODUCTION.strip().format(date=date), table, f"{notes}."]).markdown()


def main() -> None:
    """Prints the page."""
    print(licences_page(f"{datetime.now(UTC):%Y-%m-%d}"), end="")
