"""vtk's readers: selection of fields, error messages, progress, and Ctrl-C."""

import re
import signal
import threading
from collections.abc import Callable, Iterator, Set
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cldit.cfd.inputs import check_room, module, regular
from cldit.cfd.vtk.composite import composite_reader, composite_size, leaves
from cldit.cfd.vtk.datasets import GHOSTS, as_unstructured, check_cells, dimension, named_arrays
from cldit.cfd.vtk.head import check_head, check_legacy, vtk_size
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.io.progress import Watch, silent

Choose = Callable[[Set[str], Set[str]], tuple[Set[str], Set[str]]]
"""Takes the names of a file's cell and point fields, and gives those that are to be read."""


@dataclass(frozen=True)
class Loaded:
    """Data set (vtk's) of a file, and the names of all its fields, read or not.

    name: name of the data set, if the file holds several.
    """

    file: Path
    data: Any
    cell_names: frozenset[str]
    point_names: frozenset[str]
    name: str = ""


def load_vtk(file: Path, *, choose: Choose | None = None, watch: Watch = silent) -> Loaded:
    """Reads the data set in a file of `DATA`, other than a composite.

    `choose` selects the fields that are read, if the format allows it; None is all. All fields of
    points and lines, which may be parcels, are read. Ctrl-C stops vtk and raises KeyboardInterrupt.
    """
    reader = _reader(regular(file))
    if file.suffix == ".vtk":
        check_legacy(file)
        check_room(file, vtk_size(file, fields=0))
        with _messages(file, reader), _observed(file, reader, watch):
            reader.Update()
    else:
        check_head(file)
        with _messages(file, reader):
            reader.UpdateInformation()
        cells, points = reader.GetCellDataArraySelection(), reader.GetPointDataArraySelection()
        available = _names(cells), _names(points)
        selected = available if choose is None else choose(*available)
        _select(cells, selected[0])
        _select(points, selected[1])
        count = sum(len(a & b) for a, b in zip(available, selected, strict=True))
        check_room(file, vtk_size(file, fields=count))
        with _messages(file, reader), _observed(file, reader, watch):
            reader.Update()
            missing_some = not (available[0] <= selected[0] and available[1] <= selected[1])
            if missing_some and dimension(reader.GetOutput()) in (0, 1):
                cells.EnableAllArrays()
                points.EnableAllArrays()
                reader.Update()
    data = reader.GetOutput()
    if data is None or not data.IsA("vtkDataSet"):
        kind = "nothing" if data is None else data.GetClassName()
        raise SprayError(f"{file}: contains {kind}, expected a data set")
    data = _checked(file, data)
    if file.suffix == ".vtk":
        available = _fields_of(data)
    return Loaded(file, data, *available)


def load_composite(
    file: Path, *, choose: Choose | None = None, time_s: float | None, watch: Watch = silent
) -> list[Loaded]:
    """Reads the data sets in a file of `COMPOSITE`, in order, at one of `times_in` or None."""
    check_room(file, composite_size(file))
    reader = composite_reader(file)
    with _messages(file, reader):
        reader.UpdateInformation()
    cells, points = reader.GetCellDataArraySelection(), reader.GetPointDataArraySelection()
    available = _names(cells), _names(points)
    cells.EnableAllArrays()
    # parcels have all of theirs, and may lie in the same file
    points.EnableAllArrays()
    if choose is not None:
        _select(cells, choose(*available)[0])
    with _messages(file, reader), _observed(file, reader, watch):
        if time_s is None:
            reader.Update()
        else:
            reader.UpdateTimeStep(time_s)
    data_sets = leaves(reader.GetOutputDataObject(0))
    if not data_sets:
        raise SprayError(f"{file}: no data set in it")
    parts = []
    for name, leaf in data_sets:
        data = _checked(file, leaf)
        in_cells, at_points = _fields_of(data)
        if dimension(data) == 3:  # any mesh of the file may have fields that were not read
            in_cells |= available[0]
        parts.append(Loaded(file, data, in_cells, at_points, name))
    return parts


def _fields_of(data: Any) -> tuple[frozenset[str], frozenset[str]]:
    """Names of the fields in cells and at points."""
    in_cells, at_points = named_arrays(data.GetCellData()), named_arrays(data.GetPointData())
    return frozenset(in_cells), frozenset(at_points)


def _checked(file: Path, data: Any) -> Any:
    """An unstructured grid or poly data, with cells whose points exist."""
    data = as_unstructured(data)
    check_cells(file, data)
    return data


def nothing(cells: Set[str], points: Set[str]) -> tuple[Set[str], Set[str]]:
    """Selects the arrays that mark ghosts, and no field."""
    return cells & {GHOSTS}, points & {GHOSTS}


def _names(selection: Any) -> frozenset[str]:
    return frozenset(map(selection.GetArrayName, range(selection.GetNumberOfArrays())))


def _select(selection: Any, names: Set[str]) -> None:
    selection.DisableAllArrays()
    for name in names:
        selection.EnableArray(name)


def _reader(file: Path) -> Any:
    for name in ("vtkmodules", "vtkmodules.vtkCommonCore"):  # the readers need the second
        module(name, file)
    from vtkmodules import vtkIOLegacy, vtkIOXML

    readers: dict[str, Any] = {
        ".vtu": vtkIOXML.vtkXMLUnstructuredGridReader,
        ".vtp": vtkIOXML.vtkXMLPolyDataReader,
        ".vti": vtkIOXML.vtkXMLImageDataReader,
        ".vtr": vtkIOXML.vtkXMLRectilinearGridReader,
        ".vts": vtkIOXML.vtkXMLStructuredGridReader,
        ".vtk": vtkIOLegacy.vtkGenericDataObjectReader,
    }
    if file.suffix == ".vtk":
        with open_regular(file) as stream:
            if re.search(rb"\n\s*ASCII\s*\n", stream.read(1000)):
                reason = "where vtk does not notice truncation; write it in binary or as .vtu"
                raise SprayError(f"{file}: is legacy VTK in ascii, {reason}")
    reader = readers[file.suffix]()
    reader.SetFileName(str(file))
    return reader


@contextmanager
def _messages(file: Path, reader: Any) -> Iterator[None]:
    """Raises vtk's messages as errors afterwards; vtk only prints them to its output window."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    previous, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(previous)
    messages: Any = window.GetOutput()
    if isinstance(messages, bytes):  # where the message quotes a damaged file
        messages = messages.decode("latin-1")
    note = re.search(r"(?:ERROR|Warning):[^\n]*\n([^\n]*)", messages)
    if note or reader.GetErrorCode():
        reason = ascii(note.group(1)).strip("'\"") if note else f"vtk error {reader.GetErrorCode()}"
        raise SprayError(f"{file}: is damaged or truncated ({reason})")


@contextmanager
def _observed(file: Path, reader: Any, watch: Watch) -> Iterator[None]:
    """Reports vtk's progress, and stops vtk at Ctrl-C.

    vtk ends the process if an observer raises KeyboardInterrupt, so it is raised afterwards.
    """
    pressed = threading.Event()

    def progressed(*_: object) -> None:
        watch(f"reading {file.name}", round(100 * reader.GetProgress()), 100)
        if pressed.is_set():
            reader.SetAbortExecute(1)

    reader.AddObserver("ProgressEvent", progressed)
    elsewhere = threading.current_thread() is not threading.main_thread()
    if elsewhere or signal.getsignal(signal.SIGINT) in (signal.SIG_IGN, None):
        yield  # Ctrl-C is not for this thread, or not for Python
        return
    handler = signal.signal(signal.SIGINT, lambda *_: pressed.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if pressed.is_set():
            raise KeyboardInterrupt
