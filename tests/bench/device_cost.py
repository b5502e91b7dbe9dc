"""CPU seconds of a command in kernels, compilation, imports and host code; launches, waits, bytes.

`python -m tests.bench device_cost -- run gdi --pixels 1000` runs a command of cldit with pyopencl's
calls timed. The queue is emptied before and after each launch, so that all CPU seconds in between
are the kernel's, those of its first compilation included: run a command twice. What other threads
of the host do meanwhile counts too.
"""

from __future__ import annotations

import builtins
import importlib
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from typing import Any

import numpy as np
import pyopencl as cl

TOP = 12  # kernels that are listed


class Costs:
    """CPU seconds by part, of which inner ones do not count in outer ones, and counts."""

    def __init__(self) -> None:
        self.core_s: defaultdict[str, float] = defaultdict(float)
        self.kernels_s: defaultdict[str, float] = defaultdict(float)
        self.counts: Counter[str] = Counter()
        self._open: list[float] = []  # CPU seconds of inner parts

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Adds the CPU seconds of a part."""
        start = time.process_time()
        self._open.append(0.0)
        try:
            yield
        finally:
            spent, inner = time.process_time() - start, self._open.pop()
            self.core_s[name] += spent - inner
            if self._open:
                self._open[-1] += spent

    def hook(self, owner: Any, name: str, around: Callable[..., Any]) -> None:
        """Replaces a function by `around(function, *args, **kwargs)`."""
        inner = getattr(owner, name)
        setattr(owner, name, lambda *args, **kwargs: around(inner, *args, **kwargs))

    def install(self) -> None:
        """Hooks imports and pyopencl."""
        self.hook(builtins, "__import__", self._imported)
        self.hook(importlib, "import_module", self._imported)
        self.hook(cl, "enqueue_nd_range_kernel", self._launched)
        self.hook(cl, "enqueue_copy", self._copied)
        self.hook(cl.Program, "build", self._built)
        self.hook(cl.CommandQueue, "finish", self._waited)
        from cldit.gpu.buffers import Numbers

        self.hook(Numbers, "__init__", self._filled)

    def _imported(self, function: Any, *args: Any, **kwargs: Any) -> Any:
        if args[0] in sys.modules:
            return function(*args, **kwargs)
        with self.part("imports"):
            return function(*args, **kwargs)

    def _built(self, function: Any, *args: Any, **kwargs: Any) -> Any:
        with self.part("compilation"):
            return function(*args, **kwargs)

    def _waited(self, function: Any, *args: Any) -> Any:
        self.counts["waits"] += 1
        return function(*args)

    def _launched(self, function: Any, queue: Any, kernel: Any, *args: Any, **kwargs: Any) -> Any:
        before = self.core_s["kernels"]
        self._empty(queue)
        with self.part("kernels"):
            event = function(queue, kernel, *args, **kwargs)
            event.wait()
        self.counts["launches"] += 1
        self.kernels_s[kernel.function_name] += self.core_s["kernels"] - before
        return event

    def _empty(self, queue: Any) -> None:
        with self.part("kernels"):  # fills of buffers
            cl.enqueue_barrier(queue).wait()

    def _copied(self, function: Any, queue: Any, target: Any, *args: Any, **kwargs: Any) -> Any:
        if isinstance(target, np.ndarray):
            self.counts["bytes down"] += target.nbytes
            self.counts["waits"] += 1
        elif isinstance(args[0], np.ndarray):
            self.counts["bytes up"] += args[0].nbytes
            self.counts["waits"] += bool(kwargs.get("is_blocking", True))
        return function(queue, target, *args, **kwargs)

    def _filled(self, function: Any, *args: Any, **kwargs: Any) -> Any:
        content = kwargs.get("hostbuf")
        self.counts["bytes up"] += 0 if content is None else content.nbytes
        return function(*args, **kwargs)


def lines(costs: Costs, core_s: float) -> list[str]:
    """Costs of a command that took so many CPU seconds in all."""
    parts = {**costs.core_s, "host": core_s - sum(costs.core_s.values())}
    out = [f"{name:14}{spent:10.2f} core-s{spent / core_s:8.1%}" for name, spent in parts.items()]
    out += [f"{'all':14}{core_s:10.2f} core-s", ""]
    out += [f"{name:14}{costs.counts[name]:10d}" for name in ("launches", "waits")]
    out += [f"MB {way:11}{costs.counts[f'bytes {way}'] / 1e6:10.1f}" for way in ("up", "down")]
    kernels = sorted(costs.kernels_s.items(), key=itemgetter(1), reverse=True)[:TOP]
    return [*out, "", *(f"{name:20}{spent:10.2f} core-s" for name, spent in kernels)]


def main() -> None:
    """Runs the command after `--`, and prints its costs."""
    command = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    if not command:
        sys.exit("no command; allowed: python -m tests.bench device_cost -- run gdi ...")
    costs = Costs()
    costs.core_s["imports"] = time.process_time()  # of Python, numpy and pyopencl
    costs.install()
    with costs.part("imports"):
        from cldit.cli import main as cldit
    try:
        cldit(command, standalone_mode=False)
    finally:
        print("\n".join(lines(costs, time.process_time())))
