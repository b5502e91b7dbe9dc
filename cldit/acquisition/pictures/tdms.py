"""TDMS of LabVIEW: channels with pixels row by row, their size in properties."""

import logging
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.pictures.source import NoDataSet, Source
from cldit.errors import EvaluationError
from cldit.io.extras import needed
from cldit.io.files import check_regular

_WIDE = ("width", "columns", "cols", "imagewidth")
_HIGH = ("height", "rows", "imageheight")


class Tdms:
    """Images of a channel, one after another, or of a group with a channel for each image.

    Properties of the channel, the group or the file have the size: `width` and `height`, or
    `columns` and `rows`.
    """

    def __init__(self, source: Source) -> None:
        self._file = _open(source)
        try:
            self._channels, properties = _chosen(self._file, source)
            wide, high = (_number(source, properties, names) for names in (_WIDE, _HIGH))
            self._shape = high, wide
            for channel in self._channels:
                if not len(channel) or len(channel) % (wide * high):
                    raise EvaluationError(
                        f"{source.text}: {len(channel)} values of {channel.name}; allowed: "
                        f"multiples of {wide} x {high}, its width and height"
                    )
            self._each = len(self._channels[0]) // (wide * high)
            self.unit = str(properties.get("unit_string", ""))
        except BaseException:
            self._file.close()
            raise

    def __len__(self) -> int:
        return self._each * len(self._channels)

    def read(self, number: int) -> NDArray[Any]:
        """Image `number`, (rows, columns)."""
        place, within = divmod(number, self._each)
        size = self._shape[0] * self._shape[1]
        values = self._channels[place][within * size : (within + 1) * size]
        return np.asarray(values).reshape(self._shape)

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


def read_line(source: Source) -> NDArray[np.float64]:
    """Reads the chosen numbers of a channel, (N,)."""
    with _open(source) as file:
        channels, _ = _chosen(file, source)
        if len(channels) != 1:
            raise EvaluationError(f"{source.text}: {len(channels)} channels; name one")
        return np.asarray(channels[0][:], float)[source.part]


def _open(source: Source) -> Any:
    nptdms = needed("nptdms", extra="tdms", needed_by=f"{source.path}: TDMS", error=EvaluationError)
    check_regular(source.path)
    import_module("nptdms.log").log_manager.set_level(logging.ERROR)  # damage is reported here
    file = nptdms.TdmsFile.open(source.path)
    if file.file_status.incomplete_final_segment:
        file.close()
        raise EvaluationError(f"{source.path}: its last segment is incomplete; it is cut off")
    return file


def _chosen(file: Any, source: Source) -> tuple[list[Any], dict[str, Any]]:
    """Channels of the named group, or one of them, and their properties."""
    groups = {group.name: group for group in file.groups()}
    name, _, inner = source.dataset.strip("/").partition("/")
    if not name and len(groups) == 1:
        name = next(iter(groups))
    channels = groups[name].channels() if name in groups else []
    channels = [channel for channel in channels if not inner or channel.name == inner]
    if not channels:
        raise NoDataSet(source, [f"/{channel}" for channel in groups])
    return channels, {**file.properties, **groups[name].properties, **channels[0].properties}


def _number(source: Source, properties: dict[str, Any], names: tuple[str, ...]) -> int:
    values = [value for key, value in properties.items() if key.lower().replace("_", "") in names]
    try:
        number = int(values[0])
        if number > 0:
            return number
    except (IndexError, TypeError, ValueError):
        pass
    raise EvaluationError(
        f"{source.text}: no size of its images in the properties "
        f"({', '.join(properties) or 'none'}); allowed: a number above 0 in one of "
        f"{', '.join(names)}"
    )
