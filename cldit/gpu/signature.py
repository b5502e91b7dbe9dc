"""Names and types of a kernel's arguments, and the check of what a launch gives for them."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl

from cldit.errors import KernelError

Real = type[np.generic]  # the type that kernels call real
Arguments = Sequence[tuple[str, str]]  # name and type in OpenCL C of each argument in order

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
    """An argument of a kernel.

    kind: type in OpenCL C. dtype: type of one number. width: numbers in a vector. buffer: True if
    it points to memory.
    """

    name: str
    kind: str
    dtype: type[np.generic]
    width: int
    buffer: bool

    @classmethod
    def of(cls, kernel: str, name: str, kind: str, real: Real) -> "Argument":
        """The argument of this name and type; `real` is the type of that name in the program."""
        match = _TYPE.fullmatch(kind.replace(" ", ""))
        dtype = None if match is None else {**_SCALARS, "real": real}.get(match[1])
        if match is None or dtype is None:
            raise KernelError(
                f"kernel {kernel}: argument {name} is of type {kind}; allowed: "
                f"{', '.join([*_SCALARS, 'real'])}, vectors of them, and pointers to them"
            )
        return cls(name, kind, dtype, int(match[2] or 1), bool(match[3]))

    def value(self, value: Any) -> Any:
        """The value to set: `value`, where a Python number gets the argument's type.

        Raises TypeError if it does not fit.
        """
        expected, actual = np.dtype(self.dtype), getattr(value, "dtype", type(value).__name__)
        if self.buffer:
            if not isinstance(value, cl.MemoryObject):
                raise TypeError(f"is a {actual}; expected: a buffer, {self.kind}")
            if getattr(value, "dtype", self.dtype) is not self.dtype:
                raise TypeError(
                    f"is a buffer of {np.dtype(actual)}; expected: {expected}, {self.kind}"
                )
            return value
        if self.width > 1:
            if actual != self.dtype or value.shape != (self.width,):
                shape, vector = np.shape(value), f"an array of {self.width} {expected}"
                raise TypeError(f"is {actual} {shape}; expected: {vector}, {self.kind}")
            return value
        if type(value) is self.dtype:
            return value
        is_integer = issubclass(self.dtype, np.integer)
        if type(value) is int or (type(value) is float and not is_integer):
            with suppress(OverflowError):
                out = self.dtype(value)
                if not is_integer or int(out) == value:
                    return out
            raise TypeError(f"is {value}; expected: {expected}, {self.kind}")
        raise TypeError(f"is a {type(value).__name__}; expected: {expected}, {self.kind}")


@dataclass(frozen=True)
class Signature:
    """Arguments of a kernel in order, and the largest group that the kernel can have."""

    kernel: str
    arguments: tuple[Argument, ...]
    largest_group: int

    @classmethod
    def of(cls, kernel: Any, arguments: Arguments, device: Any, real: Real) -> "Signature":
        """The signature of pyopencl's kernel, which has these arguments, on its device."""
        name, limit = kernel.function_name, cl.kernel_work_group_info.WORK_GROUP_SIZE
        return cls(
            name,
            tuple(Argument.of(name, *name_and_type, real) for name_and_type in arguments),
            int(kernel.get_work_group_info(limit, device)),
        )

    def place(self, name: str) -> int:
        """Number of the argument of this name."""
        for number, argument in enumerate(self.arguments):
            if argument.name == name:
                return number
        raise KernelError(f"kernel {self.kernel}: has no argument {name}; {self._takes()}")

    def values(self, values: Mapping[str, Any]) -> list[Any]:
        """Values of the arguments in order; raises KernelError if one is missing, unknown, or of
        the wrong type."""
        names = [argument.name for argument in self.arguments]
        if values.keys() != set(names):
            missing = [name for name in names if name not in values]
            unknown = [name for name in values if name not in names]
            faults = [f"misses {', '.join(missing)}"] if missing else []
            faults += [f"has no argument {', '.join(unknown)}"] if unknown else []
            raise KernelError(f"kernel {self.kernel}: {' and '.join(faults)}; {self._takes()}")
        out = []
        for argument in self.arguments:
            try:
                out.append(argument.value(values[argument.name]))
            except TypeError as error:
                raise KernelError(
                    f"kernel {self.kernel}: argument {argument.name}: {error}"
                ) from error
        return out

    def _takes(self) -> str:
        return "it takes " + ", ".join(
            f"{argument.kind} {argument.name}" for argument in self.arguments
        )
