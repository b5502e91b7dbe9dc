"""Errors for users. Each message names the path, the value and the allowed values."""

import re

_MOST = 80  # letters of a value in a message
_FILE_NAME = 255  # letters; a longer word is no part of a path
_VALUES = re.compile(
    rf"(?<!\w)(?:'[^'\n]{{{_MOST},}}'|\"[^\"\n]{{{_MOST},}}\"|\[[^\[\]\n]{{{_MOST},}}\])(?!\w)"
    rf"|[^\s/\\]{{{_FILE_NAME + 1},}}"
)


class ClditError(Exception):
    """Base of every error that cldit raises on purpose; the CLI prints it without a traceback.

    Quoted values of its message, lists and words longer than a file's name are cut to 80 letters.
    """

    def __init__(self, *parts: object) -> None:
        super().__init__(*(_VALUES.sub(_cut, one) if isinstance(one, str) else one
                           for one in parts))  # fmt: skip


def _cut(value: re.Match[str]) -> str:
    end = value[0][-1] if value[0][0] in "'\"[" else ""
    return f"{value[0][: _MOST - 3]}...{end}"


class FileError(ClditError, OSError):
    """A file cannot be read or written; the message names it and says why."""


class DiskFull(FileError):
    """The disk has no room for a file."""


class SceneError(ClditError, ValueError):
    """A scene, rig or plan file has a value that is not allowed."""


class SprayError(ClditError, ValueError):
    """A spray source (grid file, CFD case) is missing something or holds impossible values."""


class NoFuel(SprayError):
    """A time of a case contains no fuel: neither liquid nor vapour."""


class EmptyCloud(SprayError):
    """The cloud of a case has no parcel at a time."""


class NotAtThisTime(SprayError):
    """A time of a case lacks a field or a cloud; other times may have it."""


class MediumError(ClditError, ValueError):
    """The octree cannot hold the spray as asked."""


class DeviceError(ClditError, RuntimeError):
    """No usable OpenCL device, or the device refused a request."""


class KernelError(ClditError, RuntimeError):
    """A kernel did not assemble or build."""


class TransportError(ClditError, RuntimeError):
    """The transport solution cannot be trusted (not converged, not closed, not finite)."""


class NotConvergedError(TransportError):
    """The scattered source does not converge to its tolerance at this precision."""


class EvaluationError(ClditError, ValueError):
    """The images cannot be evaluated (too few backgrounds, missing shots)."""


class RunFolderError(ClditError, ValueError):
    """A run or acquisition folder is incomplete, damaged, or belongs to something else."""


class Stopped(RunFolderError):
    """The user has stopped an acquisition; the same call resumes it."""


class OpticsError(ClditError, ValueError):
    """An optical property is requested outside its data, or a table of one is invalid."""


class DropletError(OpticsError):
    """A droplet, or its refractive index, is outside the range of the solver."""


class StudyError(ClditError, ValueError):
    """A study or a grid of scenes cannot be computed, or its folder belongs to another."""


def reason(error: BaseException) -> str:
    """Text of an error, without a file that the caller names too; its kind if it has none, as
    MemoryError.
    """
    text = str(error) or type(error).__name__
    inner = re.search(r": cannot be read \((.*)\)$", text, re.DOTALL)
    return inner[1] if inner and isinstance(error, FileError) else text
