"""Fields: flat arrays of numbers or vectors, in NumPy's memory on a CPU and in the device's memory elsewhere."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate
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


def memory_is_shared() -> bool:
    """Return whether `shared_memory` is shared; on a CPU all fields have their own memory."""
    return not on_cpu()


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
    axis over the components of vectors: on a CPU the memory itself, elsewhere a copy. In shared memory on a device, see
    `shared_memory`, the field begins at entry `first` of the field `block`.
    """

    block: "ArrayField | None" = None
    first: int = 0

    def __init__(self, dtype: Any, layout: Layout, n: int = 0):
        self.dtype, self.layout, self.n = dtype, layout, n
        self.shape = layout.shape
        self.apart = n > 0 and layout.first_axis_contiguous
        self._count = layout.length * (n if self.apart else 1)
        beside = n if not self.apart else 0  # components that lie side by side
        self._memory = (self._count + SLACK, beside) if beside else (self._count + SLACK,)
        self.flat: np.ndarray | None = None
        waits = _waiting is not None and not layout.first_axis_contiguous and memory_is_shared()
        if on_cpu() or waits:
            self.flat = np.zeros(self._memory, KINDS[dtype])[: self._count]
        if waits:
            _waiting.append(self)
        elif self.flat is None:
            length = self._memory[0]
            self._device = (
                taichi.Vector.ndarray(n, dtype, length) if beside else taichi.ndarray(dtype, length)
            )
            self._device.fill(0)
            self._program = impl.get_runtime().prog
            self._line = self._as_line()

    def _move_to(self, block: "ArrayField", first: int) -> None:
        """Leave the values to shared memory on a device, which has them."""
        self.flat, self.block, self.first = None, block, first
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
        if self.flat is not None:
            return self._shaped(self.flat)
        if self.block is None:
            return self._shaped(self.device.to_numpy()[: self._count])
        from taichi_plume.engine.uploads import load  # which imports this module

        flat = np.empty((self._count, *self._memory[1:]), KINDS[self.dtype])
        load(self._line, flat)
        taichi.sync()
        return self._shaped(flat)

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
        from taichi_plume.engine.uploads import store, upload  # which imports this module

        if self._count * max(1, self._line.n) <= FEW_NUMBERS and flat.itemsize >= 4:
            upload(self._line, flat[: self._count])
        elif self.block is not None:
            store(self._line, flat[: self._count])
        else:
            self.device.from_numpy(flat)

    def fill(self, value: float) -> None:
        """Set all values to a number."""
        if self.flat is not None:
            self.flat[...] = value
        elif self.block is not None:
            self.from_numpy(value)
        else:
            self.device.fill(KINDS[self.dtype](value).item())

    def copy_from(self, other: "ArrayField") -> None:
        """Set the values to those of another field of the same kind and layout."""
        if self.flat is not None and other.flat is not None:
            self.flat[...] = other.flat
        elif all(field.flat is None and field.block is None for field in (self, other)):
            self.device.copy_from(other.device)
        else:
            self.from_numpy(other.values)

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


_waiting: list[ArrayField] | None = None
"""Fields in memory of the host that will share memory on a device; None outside of `shared_memory`."""


@contextmanager
def shared_memory() -> Iterator[None]:
    """Context, or decorator of functions, in which new fields of a type share memory on a device.

    Some devices give a kernel no more than 31 or 32 arrays, and each array costs time at each launch. Fields whose
    first axis is contiguous have their own memory.
    """
    global _waiting
    if _waiting is not None:  # in another such context
        yield
        return
    _waiting = []
    try:
        yield
        settle()
    finally:
        _waiting = None


@contextmanager
def own_memory() -> Iterator[None]:
    """Context in which new fields have their own memory, also within `shared_memory`."""
    global _waiting
    before, _waiting = _waiting, None
    try:
        yield
    finally:
        _waiting = before


def settle() -> None:
    """Give the new fields of `shared_memory` their place on the device, before kernels use them."""
    if not _waiting:
        return
    kinds: dict[Any, list[ArrayField]] = {}
    for field in _waiting:
        kinds.setdefault((field.dtype, field.n), []).append(field)
    _waiting.clear()
    for (dtype, n), fields in kinds.items():
        flats: list[Any] = [field.flat for field in fields]
        with own_memory():
            block = _filled(np.concatenate(flats), dtype, n)
        for field, first in zip(fields, accumulate(map(len, flats), initial=0), strict=False):
            field._move_to(block, first)


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
