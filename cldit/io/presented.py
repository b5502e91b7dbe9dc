"""Results that show themselves in notebooks and scripts; labelled data sets.

Results are below the room `show` in the data flow and do not draw. `cldit/__init__.py`, above both,
sets the function that loads it when a figure of a result is requested.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

from cldit.io.extras import needed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Presented:
    """Base class of results with a figure and an HTML view.

    load_figures: returns the module with `plot` and `html_of`.
    """

    _FIGURE: ClassVar[str] = "maps"
    load_figures: ClassVar[Callable[[], Any]]

    def plot(self, what: str | None = None, **options: Any) -> "Figure":
        """Draws a figure of the result.

        Args:
            what: the kind of figure; `cldit.plot` lists those of each result. None: its first.
            options: as for `cldit.plot`.

        Raises:
            EvaluationError: the result has no such figure.
        """
        drawing = type(self).load_figures()
        figure: Figure = drawing.plot(self, what or self._FIGURE, **options)
        return figure

    def _repr_html_(self) -> str:
        return str(type(self).load_figures().html_of(self))


def xarray_module() -> Any:
    """The module `xarray`; ClditError if it is not installed."""
    return needed("xarray", extra="studies", needed_by="a labelled data set")
