"""Every notebook of the docs runs from first to last cell, and is stored with its results."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.extras import needs

pytestmark = needs("nbclient", "nbformat", extra="dev")

_HERE = re.compile(r"/(?:tmp|home|root|work|Users)/")
_BOOKS = sorted((Path(__file__).parents[2] / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.slow
@pytest.mark.parametrize("path", _BOOKS, ids=lambda path: path.stem)
def test_notebook(path: Path, tmp_path: Path) -> None:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    book = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(book, timeout=600, kernel_name="python3", resources=where).execute()
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    assert code[-1].outputs  # it ends with something to see


def test_notebooks_are_stored_with_their_results() -> None:
    """As `jupyter execute --inplace` leaves them: run in order, without errors or paths of here."""
    nbformat = pytest.importorskip("nbformat")
    assert len(_BOOKS) == 7
    for path in _BOOKS:
        cells = [each for each in nbformat.read(path, as_version=4).cells if "outputs" in each]
        assert [each.execution_count for each in cells] == [*range(1, len(cells) + 1)], path.name
        assert cells[-1].outputs, path.name
        for one in (output for cell in cells for output in cell.outputs):
            assert one.output_type != "error" and one.get("name") != "stderr", path.name
        text = path.read_text(encoding="utf-8")
        assert not _HERE.search(text) and len(text) < 400_000, path.name
