"""Open OpenCL devices: who owns context, queues and programs, and for how long.

`OpenDevices` opens each device once and keeps it, so that a process of many runs pays once for it;
`Lease.close` gives it up, and it is released when the last lease of it is closed or forgotten.
Threads may share a device: each has a queue of its own (`Context.queue`) and kernel objects of its
own (`Program`), since the arguments that are set stay with a kernel object. OpenCL's own threads
are not there after a fork, and its first call in the child then hangs. So a forked process refuses
what its parent opened, and refuses to open more.
"""

from __future__ import annotations

import ctypes
import os
import threading
import weakref
from collections.abc import Callable
from typing import Any

import pyopencl as cl

from cldit.errors import DeviceError

_FORKED = (
    "this process is a fork of one that had used OpenCL, whose threads are not there after a fork; "
    "start workers afresh: multiprocessing.get_context('spawn').Pool(), or ProcessPoolExecutor("
    "mp_context=multiprocessing.get_context('spawn')); allowed: 'spawn', 'forkserver', threads"
)
_CLOSED = "this device was closed; open it again: cldit.open_device()"


class Context:
    """One device's context, a queue for each thread, and the programs that were built in it.

    version: what the driver says, with the name of the processor that it builds for. programs: by
    source and options. Even one that the driver has on disk takes a twentieth of a second to load.
    lock: held while a program is looked for and built.
    """

    def __init__(self, handle: Any, version: str) -> None:
        self.handle, self.version = handle, version
        self.opencl = cl.Context([handle])
        self.programs: dict[tuple[str, ...], Any] = {}
        self.lock = threading.RLock()
        self._own = threading.local()

    @property
    def queue(self) -> Any:
        """The queue of this thread; what it has queued is done in order."""
        try:
            return self._own.queue
        except AttributeError:
            self._own.queue = cl.CommandQueue(self.opencl)
            return self._own.queue

    def leave_to_parent(self) -> None:
        """In a forked child: never released, as that would ask the parent's threads for it."""
        kept = (self.handle, self.opencl, self.programs, self._own.__dict__)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))


class Lease:
    """The use of a context, until `close`."""

    def __init__(self, owner: OpenDevices, context: Context) -> None:
        self._owner = owner
        self._context: Context | None = context

    @property
    def context(self) -> Context:
        """Raises:
        DeviceError: it was closed, or this process is a fork of the one that opened it.
        """
        self._owner.check_process()
        if self._context is None:
            raise DeviceError(_CLOSED)
        return self._context

    def close(self) -> None:
        """Gives the context up; other leases of it stay good. Does nothing the second time."""
        context, self._context = self._context, None
        if context is not None:
            self._owner.forget(context)


class OpenDevices:
    """The devices that are open in one process: each once, whatever it was asked for as.

    They are kept until `Lease.close`, parts of a device only as long as a lease of them.
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
        """Notes that this process uses OpenCL.

        Raises:
            DeviceError: it is a fork of one that did; the message says what to do instead.
        """
        process = os.getpid()
        if self._process != process:
            if self._process is not None:
                raise DeviceError(_FORKED)
            self._process = process

    def lease(self, handle: Any, *, keep: bool, prepare: Callable[[], str]) -> Lease:
        """A lease of the device's context, which is opened unless it is open.

        Args:
            handle: pyopencl's device.
            keep: also when no lease is left.
            prepare: returns `Context.version`; called before the device is first opened.

        Raises:
            DeviceError: see `check_process`.
            pyopencl.Error: it cannot be opened.
        """
        self.check_process()
        with self._lock:
            number = int(handle.int_ptr)
            alive = {int(one.handle.int_ptr): one for one in self._alive}
            context = alive.get(number)
            if context is None:
                version = self._versions.get(number) or prepare()
                context = Context(handle, version)
                self._alive.add(context)
            if keep:
                self._kept[number], self._versions[number] = context, context.version
        return Lease(self, context)

    def forget(self, context: Context) -> None:
        """Keeps it no longer than its leases."""
        with self._lock:
            self._kept.pop(int(context.handle.int_ptr), None)

    def _forked(self) -> None:
        self._lock = threading.Lock()  # a thread of the parent may have held it
        for context in list(self._alive):
            context.leave_to_parent()
