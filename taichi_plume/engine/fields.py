"""Fields: flat arrays of numbers or vectors, in NumPy's memory on a CPU and in the device's memory elsewhere."""

from collections.abc import Sequence
from math import prod
from typing import Any, TypeAlias

import numpy as np

from taichi_plume.engine.library import impl, taichi
from taichi_plume.engine.process import EngineError

KINDS = {
    taichi.f16: np.float16,
    taichi.f32: np.float32,
    taichi.f64: np.float64,
    taichi.i16: np.int16,
    taichi.i32: np.int32,
    taichi.u8: np.uint8,
    taichi.u32: np.uint32,
}


LANES = 8
"""Cells that a loop computes in one vector instruction (f32 in 256 bits)."""
SLACK = 4 * LANES
"""Entries behind the memory of a field, which vectorised loops may read."""
FEW_NUMBERS = 48
"""Numbers up to which a few launches take less time than waiting for the device."""


def on_cpu() -> bool:
    """Return whether kernels run on the CPU."""
    return taichi.cfg.arch in (taichi.x64, taichi.arm64)


class Layout:
    """Shape of fields and the order of their axes in memory; fields with the same layout share index arithmetic."""

    def __init__(self, shape: Sequence[int], first_axis_contiguous: bool = False):
        self.shape = tuple(int(n) for n in shape)
        self.first_axis_contiguous = first_axis_contiguous
        steps = [
            prod(self.shape[:d] if first_axis_contiguous else self.shape[d + 1 :]) for d in range(len(shape))
        ]
        self.steps = tuple(steps)
        """Distance in memory between neighbours along each axis, in entries."""
        self.length = prod(self.shape)


class ArrayField:
    """Field of numbers, or of vectors of n numbers, over a layout. Inside kernels, ``field[I]``.

    Vectors lie side by side in memory or, over a layout with a contiguous first axis, their components lie apart, so
    that loops along this axis are vectorised. On the host ``values`` is an array with the field's shape, and a last
    axis over the components of vectors: on a CPU the memory itself, elsewhere a copy.
    """

    def __init__(self, dtype: Any, layout: Layout, n: int = 0):
        self.dtype, self.layout, self.n = dtype, layout, n
        self.shape = layout.shape
        self.apart = n > 0 and layout.first_axis_contiguous
        self._count = layout.length * (n if self.apart else 1)
        beside = n if not self.apart else 0  # components that lie side by side
        self._memory = (self._count + SLACK, beside) if beside else (self._count + SLACK,)
        self.flat: np.ndarray | None = None
        if on_cpu():
            self.flat = np.zeros(self._memory, KINDS[dtype])[: self._count]
        else:
            length = self._memory[0]
            self._device = (
                taichi.Vector.ndarray(n, dtype, length) if beside else taichi.ndarray(dtype, length)
            )
            self._device.fill(0)
            self._program = impl.get_runtime().prog
            self._line = self._as_line()

    def _as_line(self) -> "ArrayField":
        """Return the memory as a field with one axis, whose kernels fit fields of any shape."""
        line = object.__new__(ArrayField)
        vars(line).update(vars(self), layout=Layout((self._count,)), shape=(self._count,), apart=False)
        line.n = 0 if self.apart else self.n
        return line

    @property
    def device(self) -> Any:
        """Memory of the device. Raises EngineError if Taichi was restarted, which frees this memory."""
        if impl.get_runtime().prog is not self._program:
            raise EngineError
        return self._device

    def _shaped(self, flat: np.ndarray) -> np.ndarray:
        """Return the view of the memory, or of a copy of it, that has the field's shape."""
        if self.apart or (self.layout.first_axis_contiguous and len(self.shape) > 1):
            turned = flat.reshape((*((self.n,) if self.apart else ()), *self.shape[::-1]))
            return turned.transpose()
        return flat.reshape((*self.shape, *flat.shape[1:]))

    @property
    def values(self) -> np.ndarray:
        """Values of the field: a view of its memory on a CPU, a copy elsewhere."""
        return self._shaped(self.device.to_numpy()[: self._count] if self.flat is None else self.flat)

    def to_numpy(self) -> np.ndarray:
        """Return a copy of the values."""
        return np.array(self.values, order="C")

    def from_numpy(self, values: Any) -> None:
        """Set the values: an array of the field's shape, or one number."""
        if self.flat is not None:
            self._shaped(self.flat)[...] = values
            return
        flat = np.zeros(self._memory, KINDS[self.dtype])
        self._shaped(flat[: self._count])[...] = values
        if self._count * max(1, self._line.n) <= FEW_NUMBERS and flat.itemsize >= 4:
            from taichi_plume.engine.uploads import upload  # which imports this module

            upload(self._line, flat[: self._count])
        else:
            self.device.from_numpy(flat)

    def fill(self, value: float) -> None:
        """Set all values to a number."""
        if self.flat is not None:
            self.flat[...] = value
        else:
            self.device.fill(KINDS[self.dtype](value).item())

    def copy_from(self, other: "ArrayField") -> None:
        """Set the values to those of another field of the same kind and layout."""
        if self.flat is None:
            self.device.copy_from(other.device)
        else:
            self.flat[...] = other.flat

    def __getitem__(self, index: Any) -> Any:
        value = self.values[() if index is None else index]
        return value.item() if not isinstance(value, np.ndarray) else value

    def __setitem__(self, index: Any, value: Any) -> None:
        if index is None:
            self.from_numpy(value)
            return
        values = self.values
        values[index] = value
        if self.flat is None:
            self.from_numpy(values)


Field: TypeAlias = Any
"""Field in annotations: its type is opaque to type checkers, as kernels index it by vectors."""


def field(dtype: Any, shape: int | Sequence[int] = (), order: str | None = None) -> Field:
    """Return a new field of zeros; order "kji" stores the first axis contiguously."""
    shape = (shape,) if isinstance(shape, int | np.integer) else tuple(shape)
    return ArrayField(dtype, Layout(shape, order is not None and order != "".join(sorted(order))))


def filled(values: Any, dtype: Any = None) -> Field:
    """Return a new field of these numbers, by default of i32 for whole numbers and flags, of f32 for others. An empty
    list becomes a single zero, as a device has no memory of length 0.
    """
    return _filled(np.asarray(values), dtype, 0)


def filled_vectors(rows: Any, dtype: Any = None) -> Field:
    """Return a new field of vectors, the last axis of `rows`; types as for `filled`. Without rows, (0, n), the field
    has a single vector of zeros.
    """
    rows = np.asarray(rows)
    return _filled(rows, dtype, rows.shape[-1])


def _filled(values: np.ndarray, dtype: Any, n: int) -> Field:
    if values.ndim > 0 and len(values) == 0:
        values = np.zeros((1, *values.shape[1:]), values.dtype)
    dtype = dtype or (taichi.i32 if values.dtype.kind in "biu" else taichi.f32)
    result = ArrayField(dtype, Layout(values.shape[:-1] if n else values.shape), n)
    result.from_numpy(values)
    return result


def vector_field(n: int, dtype: Any, shape: int | Sequence[int] = (), order: str | None = None) -> Field:
    """Return a new field of vectors of n numbers."""
    shape = (shape,) if isinstance(shape, int | np.integer) else tuple(shape)
    return ArrayField(dtype, Layout(shape, order is not None and order != "".join(sorted(order))), n)
