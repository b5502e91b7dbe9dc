"""vtk data sets as numpy arrays; the only module that imports vtk, and only when it is called."""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.case import Column
from cldit.cfd.element_mesh import ElementMesh, PolyhedronFaces
from cldit.cfd.size import check_room
from cldit.cfd.vtk.head import vtk_size
from cldit.errors import SprayError
from cldit.progress import Watch, silent

_MOST = 8  # fields that are reckoned with where all are read


def load_vtk(
    file: Path,
    kind: str = "vtkDataSet",
    *,
    cell_fields: Sequence[str] | None = None,
    watch: Watch = silent,
) -> Any:
    """The data set in a .vtu, .vtp or binary legacy .vtk file.

    Args:
        file: its suffix tells what is expected in it.
        kind: of the data set, a class of vtk's.
        cell_fields: those that are read, where the format lets others be left out; None is all.
        watch: told how far vtk is.

    Raises:
        SprayError: vtk is not installed; the file is damaged, truncated, not of this kind, or does
            not fit into memory.
        KeyboardInterrupt: Ctrl-C was pressed; vtk stops where it is.
    """
    reader = _reader(file)
    check_room(file, vtk_size(file, fields=_MOST if cell_fields is None else len(cell_fields)))
    with _messages(file, reader), _observed(file, reader, watch):
        if cell_fields is not None and file.suffix != ".vtk":
            reader.UpdateInformation()
            selection = reader.GetCellDataArraySelection()
            selection.DisableAllArrays()
            for name in cell_fields:
                selection.EnableArray(name)
        reader.Update()
    data = reader.GetOutput()
    if data is None or not data.IsA(kind):
        found = "nothing" if data is None else data.GetClassName()
        raise SprayError(f"{file}: holds {found}, expected {kind}")
    return data


def cell_names(file: Path) -> list[str]:
    """Names of the cell arrays in a file; of .vtu and .vtp the head alone is read.

    Raises:
        SprayError: as for `load_vtk`.
    """
    if file.suffix == ".vtk":
        return sorted(cell_columns(file, load_vtk(file)))
    reader = _reader(file)
    with _messages(file, reader):
        reader.UpdateInformation()
    selection = reader.GetCellDataArraySelection()
    return sorted(selection.GetArrayName(i) for i in range(selection.GetNumberOfArrays()))


def _reader(file: Path) -> Any:
    try:
        from vtkmodules.vtkCommonCore import vtkObject  # noqa: F401, what follows needs it
        from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader
    except ImportError as error:
        raise SprayError(
            f'{file}: reading it needs vtk; install it with: pip install "cldit[cfd]"'
        ) from error
    readers: dict[str, Any] = {
        ".vtu": vtkXMLUnstructuredGridReader,
        ".vtp": vtkXMLPolyDataReader,
        ".vtk": vtkGenericDataObjectReader,
    }
    if file.suffix == ".vtk":
        with file.open("rb") as stream:
            if re.search(rb"\n\s*ASCII\s*\n", stream.read(1000)):
                raise SprayError(
                    f"{file}: is legacy VTK in ascii, whose truncation vtk does not notice; "
                    "write it in binary or as .vtu"
                )
    reader = readers[file.suffix]()
    reader.SetFileName(str(file))
    return reader


@contextmanager
def _messages(file: Path, reader: Any) -> Iterator[None]:
    """vtk reports what is wrong with a file only as text in its output window: raised behind."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    before, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(before)
    text: Any = window.GetOutput()
    if isinstance(text, bytes):  # where the message quotes a damaged file
        text = text.decode("latin-1")
    said = re.search(r"(?:ERROR|Warning):[^\n]*\n([^\n]*)", text)
    if said or reader.GetErrorCode():
        reason = ascii(said.group(1)).strip("'\"") if said else f"vtk error {reader.GetErrorCode()}"
        raise SprayError(f"{file}: is damaged or truncated ({reason})")


@contextmanager
def _observed(file: Path, reader: Any, watch: Watch) -> Iterator[None]:
    """Passes vtk's progress on, and Ctrl-C to vtk.

    vtk ends the process where an observer raises KeyboardInterrupt, so it is raised behind.
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
    before = signal.signal(signal.SIGINT, lambda *_: pressed.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if pressed.is_set():
            raise KeyboardInterrupt


def time_value(data: Any) -> float | None:
    """The `TimeValue` that foamToVTK adds, if there is one."""
    values = data.GetFieldData().GetArray("TimeValue")
    return None if values is None or not values.GetNumberOfValues() else values.GetValue(0)


def cell_columns(file: Path, data: Any) -> dict[str, Column]:
    """Numeric cell arrays of `data` by name, as vtk holds them; `file` is named by errors."""
    return _columns(file, data.GetCellData(), "cell field")


def point_columns(file: Path, data: Any) -> tuple[Column, dict[str, Column]]:
    """Positions (N, 3), and numeric point arrays of `data` by name; `file` is named by errors."""
    return (
        Column(f"{file}: points", _points(data).astype(np.float64)),
        _columns(file, data.GetPointData(), "point field"),
    )


def _numpy(array: Any) -> Any:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    return convert(array)


def _points(data: Any) -> Any:
    if not data.GetNumberOfPoints():
        return np.empty((0, 3))
    return _numpy(data.GetPoints().GetData())


def _columns(file: Path, data: Any, kind: str) -> dict[str, Column]:
    arrays = [data.GetArray(index) for index in range(data.GetNumberOfArrays())]
    return {
        array.GetName(): Column(f"{file}: {kind} {array.GetName()}", _numpy(array))
        for array in arrays
        if array is not None and array.GetName()
    }


def vtk_mesh(file: Path, grid: Any) -> ElementMesh:
    """The mesh of an unstructured `grid` of linear cells and polyhedra, on vtk's own arrays.

    Errors name `file`.

    Raises:
        SprayError: the grid has a cell of another type, or none.
    """
    count = grid.GetNumberOfCells()
    if count == 0:
        raise SprayError(f"{file}: the mesh has no cell")
    if grid.IsHomogeneous():
        kinds = np.broadcast_to(np.uint8(grid.GetCellType(0)), count)
    else:
        try:
            types = grid.GetCellTypes()
        except TypeError:  # vtk before 9.6, where the name means another list
            types = grid.GetCellTypesArray()
        kinds = _numpy(types)
    cells = grid.GetCells()
    faces, own = grid.GetPolyhedronFaces(), grid.GetPolyhedronFaceLocations()
    return ElementMesh(
        points_m=_points(grid),
        kinds=kinds,
        offsets=_numpy(cells.GetOffsetsArray()),
        nodes=_numpy(cells.GetConnectivityArray()),
        source=str(file),
        faces=None
        if faces is None or own is None or not own.GetNumberOfCells()
        else PolyhedronFaces(
            corners=_numpy(faces.GetConnectivityArray()),
            start=_numpy(faces.GetOffsetsArray()),
            faces=_numpy(own.GetConnectivityArray()),
            first=_numpy(own.GetOffsetsArray()),
        ),
    )
