"""Names and types of a kernel's arguments, and the check of what a launch gives for them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl

from cldit.errors import KernelError

_SCALARS: dict[str, type[np.generic]] = {
    "char": np.int8,
    "uchar": np.uint8,
    "short": np.int16,
    "ushort": np.uint16,
    "int": np.int32,
    "uint": np.uint32,
    "long": np.int64,
    "ulong": np.uint64,
    "float": np.float32,
    "double": np.float64,
}
_TYPE = re.compile(r"([a-z]+?)(2|3|4|8|16)?(\*?)")


@dataclass(frozen=True)
class Argument:
    """kind: its type in OpenCL C. dtype: of one of its numbers. width: numbers of a vector. buffer:
    whether it points to memory."""

    name: str
    kind: str
    dtype: type[np.generic]
    width: int
    buffer: bool

    @classmethod
    def of(cls, kernel: str, name: str, kind: str, real: type[np.generic]) -> Argument:
        """The argument of this name and type of a kernel; `real` is what that type is here.

        Raises:
            KernelError: cldit cannot set an argument of the type.
        """
        match = _TYPE.fullmatch(kind.replace(" ", ""))
        dtype = None if match is None else {**_SCALARS, "real": real}.get(match[1])
        if match is None or dtype is None:
            raise KernelError(
                f"kernel {kernel}: argument {name} is of type {kind}; allowed: "
                f"{', '.join([*_SCALARS, 'real'])}, vectors of them, and pointers to them"
            )
        return cls(name, kind, dtype, int(match[2] or 1), bool(match[3]))

    def value(self, given: Any) -> Any:
        """What to set for it: the same, or a Python number in the argument's type.

        Raises:
            TypeError: it does not fit; the message says what is expected.
        """
        if self.buffer:
            if not isinstance(given, cl.MemoryObject):
                raise TypeError(f"is a {type(given).__name__}; expected is a buffer, {self.kind}")
            held = getattr(given, "dtype", self.dtype)
            if held is not self.dtype:
                raise TypeError(
                    f"is a buffer of {np.dtype(held)}; expected is {np.dtype(self.dtype)}, "
                    f"{self.kind}"
                )
            return given
        if self.width > 1:
            if getattr(given, "dtype", None) != self.dtype or given.shape != (self.width,):
                found = f"{getattr(given, 'dtype', type(given).__name__)} {np.shape(given)}"
                raise TypeError(
                    f"is {found}; expected is an array of {self.width} {np.dtype(self.dtype)}, "
                    f"{self.kind}"
                )
            return given
        if type(given) is self.dtype:
            return given
        whole = issubclass(self.dtype, np.integer)
        if type(given) is int or (type(given) is float and not whole):
            try:
                out = self.dtype(given)
            except OverflowError:
                out = None
            if out is None or (whole and int(out) != given):
                raise TypeError(f"is {given}; expected is {np.dtype(self.dtype)}, {self.kind}")
            return out
        raise TypeError(
            f"is a {type(given).__name__}; expected is {np.dtype(self.dtype)}, {self.kind}"
        )


@dataclass(frozen=True)
class Signature:
    """A kernel's arguments in their order, and the most work-items of a group that it can have."""

    kernel: str
    arguments: tuple[Argument, ...]
    largest_group: int

    @classmethod
    def of(
        cls,
        kernel: Any,
        arguments: Iterable[tuple[str, str]],
        device: Any,
        real: type[np.generic],
    ) -> Signature:
        """The signature of pyopencl's kernel on pyopencl's device, with arguments of these names
        and types; raises as `Argument.of`."""
        name, limit = kernel.function_name, cl.kernel_work_group_info.WORK_GROUP_SIZE
        return cls(
            name,
            tuple(Argument.of(name, *each, real) for each in arguments),
            int(kernel.get_work_group_info(limit, device)),
        )

    def place(self, name: str) -> int:
        """Number of an argument.

        Raises:
            KernelError: there is none of this name.
        """
        for number, argument in enumerate(self.arguments):
            if argument.name == name:
                return number
        raise KernelError(f"kernel {self.kernel}: has no argument {name}; {self._takes()}")

    def values(self, given: Mapping[str, Any]) -> list[Any]:
        """In order, as the kernel takes them.

        Raises:
            KernelError: one is missing, not known, or of another type; the message names the
                kernel, the argument and what is expected.
        """
        names = [argument.name for argument in self.arguments]
        if given.keys() != set(names):
            missing = [name for name in names if name not in given]
            unknown = [name for name in given if name not in names]
            said = f"misses {', '.join(missing)}" if missing else ""
            said += " and " if missing and unknown else ""
            said += f"has no argument {', '.join(unknown)}" if unknown else ""
            raise KernelError(f"kernel {self.kernel}: {said}; {self._takes()}")
        out = []
        for argument in self.arguments:
            try:
                out.append(argument.value(given[argument.name]))
            except TypeError as error:
                raise KernelError(
                    f"kernel {self.kernel}: argument {argument.name}: {error}"
                ) from error
        return out

    def _takes(self) -> str:
        return "it takes " + ", ".join(f"{one.kind} {one.name}" for one in self.arguments)
