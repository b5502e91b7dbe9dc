"""Files of several data sets or several times: .vtkhdf, by vtk's reader.

vtk reads them through HDF5. h5py checks first that they are whole, and how large they are.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cldit.cfd.hdf.arrays import arrays_in, bytes_of, nodes_in, open_hdf
from cldit.cfd.inputs import AT_ONCE, WHILE_READING, Size, module, regular
from cldit.errors import SprayError

COMPOSITE = (".vtkhdf",)


def composite_reader(file: Path) -> Any:
    """Creates vtk's reader of a file, after a check of the file."""
    _check(regular(file))
    for name in ("vtkmodules", "vtkmodules.vtkCommonExecutionModel"):  # the reader needs the second
        module(name, file)
    reader: Any = module("vtkmodules.vtkIOHDF", file).vtkHDFReader()
    reader.SetFileName(str(file))
    return reader


def _check(file: Path) -> None:
    """Reads every array once, which finds wrong checksums and truncation."""
    with open_hdf(file) as root:
        if "VTKHDF" not in root:
            raise SprayError(f"{file}: no group VTKHDF in it: not VTK's HDF format")
        for array in arrays_in(root):
            if not array.shape:
                array[()]
                continue
            for start in range(0, len(array), AT_ONCE):
                array[start : start + AT_ONCE]
        for group in nodes_in(root):
            if hasattr(group, "keys") and "Steps" in group:
                _check_steps(file, group)


def _check_steps(file: Path, group: Any) -> None:
    """Refuses times that do not rise, among which vtk takes a wrong one, and arrays with rows that
    no step refers to, as where offsets are wrong.
    """
    steps = group["Steps"]
    times = np.asarray(steps["Values"][()]).reshape(-1) if "Values" in steps else np.empty(0)
    if not np.all(np.diff(times) > 0.0):
        shown = f"times {times[:5].tolist()} of the steps do not rise"
        raise SprayError(f"{file}: {steps.name}/Values: {shown}; export it again, in their order")
    for data, number in (("CellData", "NumberOfCells"), ("PointData", "NumberOfPoints")):
        offsets = steps.get(f"{data}Offsets", {})
        if "WholeExtent" in group.attrs:  # an image has a step in a row
            start, stop, ends = np.array([0]), np.array([1]), np.array([0, 1])
        elif number in group and {"PartOffsets", "NumberOfParts"} <= set(steps):
            ends = np.concatenate([[0], np.cumsum(group[number][()])])
            start = np.asarray(steps["PartOffsets"][()]).reshape(-1)
            parts = np.asarray(steps["NumberOfParts"][()]).reshape(-1)
            stop = np.minimum(start + parts, len(ends) - 1)
        else:
            continue
        for name in offsets:
            begin = np.asarray(offsets[name][()]).reshape(-1)
            rows = np.zeros(len(group[data][name]) + 1, np.int64)
            np.add.at(rows, np.clip(begin, 0, len(rows) - 1), 1)
            np.add.at(rows, np.clip(begin + ends[stop] - ends[start], 0, len(rows) - 1), -1)
            if unused := int(np.count_nonzero(np.cumsum(rows)[:-1] == 0)):
                raise SprayError(
                    f"{file}: {group[data][name].name}: {unused} of {len(rows) - 1} rows belong to "
                    f"no step ({data}Offsets/{name}: {begin[:5].tolist()} for the steps "
                    f"{times[:5].tolist()}): its offsets are damaged; export it again"
                )


def composite_size(file: Path) -> Size:
    """Estimate for the data sets in a file from the shapes of its arrays."""
    with open_hdf(file) as root:
        arrays = arrays_in(root)
        stored = bytes_of(arrays)
        # of grids; poly data count their cells by kind, a level deeper
        counts = [array for array in arrays if array.name.endswith("/NumberOfCells")]
        cells = sum(int(np.sum(array[()])) for array in counts if "Types" in array.parent)
        counts = [array for array in arrays if array.name.endswith("/NumberOfPoints")]
        points = sum(int(np.sum(array[()])) for array in counts if "Types" not in array.parent)
    return Size(cells, points, WHILE_READING["hdf"] * stored)


def times_in(file: Path) -> tuple[float, ...]:
    """Times in a file itself; none if it has a single state."""
    with open_hdf(file) as root:
        values = [a[()] for a in arrays_in(root) if a.name.endswith("Steps/Values")]
    return tuple(sorted({float(time) for steps in values for time in np.ravel(steps)}))


def leaves(data: Any) -> list[tuple[str, Any]]:
    """Data sets of vtk's composite `data`, by name."""
    return list(_named(data, ""))


def _named(data: Any, name: str) -> Iterator[tuple[str, Any]]:
    if data is None:
        return
    if data.IsA("vtkPartitionedDataSet"):
        for number in range(data.GetNumberOfPartitions()):
            yield from _named(data.GetPartitionAsDataObject(number), name)
        return
    if data.IsA("vtkPartitionedDataSetCollection"):
        count, part = data.GetNumberOfPartitionedDataSets(), data.GetPartitionedDataSet
    elif data.IsA("vtkMultiBlockDataSet"):
        count, part = data.GetNumberOfBlocks(), data.GetBlock
    else:
        yield name, data
        return
    from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet

    for number in range(count):
        about = data.GetMetaData(number) if data.HasMetaData(number) else None
        block_name = about.Get(vtkCompositeDataSet.NAME()) if about is not None else None
        yield from _named(part(number), block_name or name)
