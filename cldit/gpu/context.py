"""Open OpenCL devices: the owner of contexts, queues and programs, and their lifetime.

`OpenDevices` opens each device once and keeps it, so that a process of many runs pays once.
`Lease.close` gives a device up; it is released when its last lease is closed or forgotten. Threads
may share a device: each has its own queue (`Context.queue`) and kernel objects (`Program`), because
arguments that were set stay with a kernel object. The threads of OpenCL do not survive a fork, and
the first call in the child would hang: a forked process therefore refuses devices that its parent
opened, and refuses to open others.
"""

import ctypes
import os
import threading
import weakref
from collections.abc import Callable
from typing import Any

import pyopencl as cl

from cldit.errors import DeviceError

_FORKED = (
    "this process is a fork of one that had used OpenCL, whose threads do not survive a fork; "
    "start workers afresh: multiprocessing.get_context('spawn').Pool(), or ProcessPoolExecutor("
    "mp_context=multiprocessing.get_context('spawn')); allowed: 'spawn', 'forkserver', threads"
)
_CLOSED = "this device was closed; open it again: cldit.opencl_device()"


class Context:
    """Context of one device, a queue for each thread, and the programs built in the context.

    version: the driver's, with the processor that it builds for. programs: by source and options;
    to load one from the driver's cache takes 0.05 s. lock: held while a program is built.
    """

    def __init__(self, handle: Any, version: str) -> None:
        self.handle, self.version = handle, version
        self.opencl = cl.Context([handle])
        self.programs: dict[tuple[str, ...], Any] = {}
        self.lock = threading.RLock()
        self._thread = threading.local()

    @property
    def queue(self) -> Any:
        """The in-order queue of this thread."""
        try:
            return self._thread.queue
        except AttributeError:
            self._thread.queue = cl.CommandQueue(self.opencl)
            return self._thread.queue

    def leave_to_parent(self) -> None:
        """Keeps the objects alive in a forked child, where releasing them would hang."""
        objects = (self.handle, self.opencl, self.programs, self._thread.__dict__)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(objects))


class Lease:
    """Use of a context until `close`."""

    def __init__(self, owner: "OpenDevices", context: Context) -> None:
        self._owner = owner
        self._context: Context | None = context

    @property
    def context(self) -> Context:
        """The context; raises DeviceError if it was closed, or in a fork of its process."""
        self._owner.check_process()
        if self._context is None:
            raise DeviceError(_CLOSED)
        return self._context

    def close(self) -> None:
        """Gives the context up, once; other leases of it stay valid."""
        context, self._context = self._context, None
        if context is not None:
            self._owner.forget(context)


class OpenDevices:
    """Devices that are open in one process, each once under all of its names.

    A device is kept until `Lease.close`, a part of one only as long as its lease.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: int | None = None
        self._kept: dict[int, Context] = {}
        self._versions: dict[int, str] = {}
        self._alive: weakref.WeakSet[Context] = weakref.WeakSet()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._forked)

    def check_process(self) -> None:
        """Records that this process uses OpenCL; raises DeviceError in a fork of one that did."""
        process = os.getpid()
        if self._process != process:
            if self._process is not None:
                raise DeviceError(_FORKED)
            self._process = process

    def lease(self, handle: Any, *, keep: bool, prepare: Callable[[], str]) -> Lease:
        """Leases the context of pyopencl's device, which is opened if need be.

        Args:
            handle: pyopencl's device.
            keep: keeps the context when no lease is left.
            prepare: returns `Context.version`; called before the device is first opened.
        """
        self.check_process()
        with self._lock:
            number = int(handle.int_ptr)
            alive = {int(leased.handle.int_ptr): leased for leased in self._alive}
            context = alive.get(number)
            if context is None:
                version = self._versions.get(number) or prepare()
                context = Context(handle, version)
                self._alive.add(context)
            if keep:
                self._kept[number], self._versions[number] = context, context.version
        return Lease(self, context)

    def forget(self, context: Context) -> None:
        """Keeps a context no longer than its leases."""
        with self._lock:
            self._kept.pop(int(context.handle.int_ptr), None)

    def _forked(self) -> None:
        self._lock = threading.Lock()  # in case a thread of the parent held it
        for context in list(self._alive):
            context.leave_to_parent()
