"""The errors that users meet. Each message says what was found, where, and what is allowed."""


class ClditError(Exception):
    """Base of every error that cldit raises on purpose; the CLI prints it without a traceback."""


class FileError(ClditError, OSError):
    """A file cannot be read or written; the message names it and says why."""


class DiskFull(FileError):
    """There is no room for what is to be written."""


class SceneError(ClditError, ValueError):
    """A scene, rig or plan file holds something that is not allowed."""


class SprayError(ClditError, ValueError):
    """A spray source (grid file, CFD case) is missing something or holds impossible values."""


class NoFuel(SprayError):
    """A time of a case says that there is no fuel in it: neither liquid nor vapour."""


class EmptyCloud(SprayError):
    """A time of a case says that its cloud holds no parcel."""


class NotAtThisTime(SprayError):
    """A time of a case lacks a field or a cloud; other times may have it."""


class MediumError(ClditError, ValueError):
    """The octree cannot hold the spray as asked."""


class DeviceError(ClditError, RuntimeError):
    """No usable OpenCL device, or the device refused what was asked of it."""


class KernelError(ClditError, RuntimeError):
    """A kernel did not assemble or build."""


class TransportError(ClditError, RuntimeError):
    """The transport solution cannot be trusted (not converged, not closed, not finite)."""


class NotConvergedError(TransportError):
    """The scattered source cannot be had to the wanted accuracy at this precision."""


class EvaluationError(ClditError, ValueError):
    """The images cannot be evaluated (too few backgrounds, missing shots)."""


class RunFolderError(ClditError, ValueError):
    """A run or acquisition folder is incomplete, damaged, or belongs to something else."""


class Stopped(RunFolderError):
    """The user has stopped an acquisition; the same call goes on."""


class OpticsError(ClditError, ValueError):
    """An optical property is asked for outside its data, or a table of one is impossible."""


class DropletError(OpticsError):
    """A droplet, or its refractive index, is outside what can be solved."""


class StudyError(ClditError, ValueError):
    """A study or a grid of scenes is not what can be computed, or its folder holds another."""
