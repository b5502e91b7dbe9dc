"""CPU seconds of a command in kernels, compilation, imports and host code; launches, waits, bytes.

`python -m tests.bench device_cost -- run gdi --pixels 1000` runs a command of cldit with pyopencl's
calls timed. The queue is emptied before and after each launch, so that all CPU seconds in between
are the kernel's, those of its first compilation included: run a command twice. What other threads
of the host do meanwhile counts too. With `--as-gpu=132` before the `--`, devices are reported as
GPUs of 132 compute units, so that the code for GPUs runs; they are then checked before first use.
Without a command, the runs of `RUNS` are measured, and their costs printed as a table.
"""

from __future__ import annotations

import builtins
import importlib
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pyopencl as cl

TOP = 12  # kernels, and lines of code, that are listed
_GPU = "--as-gpu="
_OWN = str(Path(__file__).parents[2] / "cldit")
_BELOW = str(Path(_OWN) / "gpu")
RUNS = {  # options of this measurement, and commands of cldit
    "as a GPU: gdi-cone, 100 x 100, 1 K": (
        f"{_GPU}132",
        "run gdi-cone --pixels 100 --accuracy 1 --trace-only",
    ),
    "gdi-cone, 100 x 100, 1 K": ("", "run gdi-cone --pixels 100 --accuracy 1 --trace-only"),
    "gdi, 1000 x 1000": ("", "run gdi --pixels 1000"),
    "empty": ("", "run empty --quick --trace-only"),
}
PRINTED = ("launches", "waits", "MB up", "MB down", "imports", "kernels", "host", "host units")


class Costs:
    """CPU seconds by part, of which inner ones do not count in outer ones, and counts."""

    def __init__(self) -> None:
        self.core_s: defaultdict[str, float] = defaultdict(float)
        self.kernels_s: defaultdict[str, float] = defaultdict(float)
        self.counts: Counter[str] = Counter()
        self.callers: Counter[tuple[str, str]] = Counter()  # by the name of the count
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
        self._count("waits", 1)
        return function(*args)

    def _count(self, name: str, amount: int) -> None:
        """Counts by name, and by the last line of cldit outside cldit/gpu."""
        self.counts[name] += amount
        frame: FrameType | None = sys._getframe(1)
        while frame is not None and (
            not frame.f_code.co_filename.startswith(_OWN)
            or frame.f_code.co_filename.startswith(_BELOW)
        ):
            frame = frame.f_back
        if frame is not None and amount:
            path = Path(frame.f_code.co_filename).relative_to(_OWN)
            self.callers[name, f"{path}:{frame.f_lineno}"] += amount

    def _launched(self, function: Any, queue: Any, kernel: Any, *args: Any, **kwargs: Any) -> Any:
        before = self.core_s["kernels"]
        self._empty(queue)
        with self.part("kernels"):
            event = function(queue, kernel, *args, **kwargs)
            event.wait()
        self._count("launches", 1)
        self.kernels_s[kernel.function_name] += self.core_s["kernels"] - before
        return event

    def _empty(self, queue: Any) -> None:
        with self.part("kernels"):  # fills of buffers
            cl.enqueue_barrier(queue).wait()

    def _copied(self, function: Any, queue: Any, target: Any, *args: Any, **kwargs: Any) -> Any:
        if isinstance(target, np.ndarray):
            self._count("bytes down", target.nbytes)
            self._count("waits", int(kwargs.get("is_blocking", True)))
        elif isinstance(args[0], np.ndarray):
            self._count("bytes up", args[0].nbytes)
            self._count("waits", int(kwargs.get("is_blocking", True)))
        return function(queue, target, *args, **kwargs)

    def _filled(self, function: Any, *args: Any, **kwargs: Any) -> Any:
        content = kwargs.get("hostbuf")
        self._count("bytes up", 0 if content is None else content.nbytes)
        return function(*args, **kwargs)


def unit_s() -> float:
    """CPU seconds of a fixed work in NumPy and Python here: the median of three times."""
    x, spent = np.linspace(0.0, 1.0, 1_000_000), []
    for _ in range(3):
        start = time.thread_time()
        for _ in range(5):
            (np.exp(-x) * x + np.sqrt(x)).sum()
        sum(number & 7 for number in range(400_000))
        spent.append(time.thread_time() - start)
    return sorted(spent)[1]


def lines(costs: Costs, core_s: float) -> list[str]:
    """Costs of a command that took so many CPU seconds in all."""
    parts = {**costs.core_s, "host": core_s - sum(costs.core_s.values())}
    out = [f"{name:14}{spent:10.2f} core-s{spent / core_s:8.1%}" for name, spent in parts.items()]
    out += [f"{'all':14}{core_s:10.2f} core-s"]
    out += [f"{'host units':14}{parts['host'] / unit_s():10.0f}", ""]
    out += [f"{name:14}{costs.counts[name]:10d}" for name in ("launches", "waits")]
    out += [f"MB {way:11}{costs.counts[f'bytes {way}'] / 1e6:10.1f}" for way in ("up", "down")]
    kernels = sorted(costs.kernels_s.items(), key=itemgetter(1), reverse=True)[:TOP]
    out += ["", *(f"{name:20}{spent:10.2f} core-s" for name, spent in kernels)]
    for name in ("launches", "waits", "bytes up", "bytes down"):
        some = Counter({line: n for (what, line), n in costs.callers.items() if what == name})
        out += ["", name, *(f"{count:12d}  {line}" for line, count in some.most_common(TOP))]
    return out


def as_gpu(units: int) -> None:
    """Reports each device as a GPU of so many compute units. It is PoCL, which is trusted."""
    from cldit.gpu import device
    from cldit.run import trusted

    describe = device._describe
    fake: dict[str, Any] = {"kind": "gpu", "compute_units": units}
    vars(device)["_describe"] = lambda *args: replace(describe(*args), **fake)
    vars(trusted)["tested"] = lambda _: True


def table() -> list[str]:
    """Costs of `RUNS`, each by a process of its own, whose programs and tables are there."""
    out = ["| run | " + " | ".join(PRINTED) + " |", "| --- " * (1 + len(PRINTED)) + "|"]
    # Installed packages have bytecode, so these have it too, whatever the caller's environment.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    for name, (option, command) in RUNS.items():
        with tempfile.TemporaryDirectory() as folder:
            environment["PYTHONPYCACHEPREFIX"] = f"{folder}/bytecode"
            for number in range(2):
                whole = [*option.split(), "--", *command.split(), "--out", f"{folder}/{number}"]
                done = subprocess.run(
                    [sys.executable, "-m", "tests.bench", "device_cost", *whole],
                    capture_output=True, text=True, check=True, env=environment,
                )  # fmt: skip
        known = {line[:14].strip(): line[14:].split() for line in done.stdout.splitlines()}
        values = [known.get(each, ["0"])[0] for each in PRINTED]
        out.append(f"| {name} | {' | '.join(values)} |")
    return out


def main() -> None:
    """Runs the command after `--`, and prints its costs; without a command, those of `RUNS`."""
    command = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    if not command:
        print("\n".join(table()))
        return
    costs = Costs()
    costs.core_s["imports"] = time.process_time()  # of Python, numpy and pyopencl
    costs.install()
    with costs.part("imports"):
        from cldit.cli import main as cldit
    for option in sys.argv[: sys.argv.index("--")]:
        if option.startswith(_GPU):
            as_gpu(int(option.removeprefix(_GPU)))
    try:
        cldit(command, standalone_mode=False)
    finally:
        print("\n".join(lines(costs, time.process_time())))
