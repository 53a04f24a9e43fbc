"""Arrays to and from fields, many at once, and the numbers that kernels read when they run.

On the CPU they are copied in place. Elsewhere every `from_numpy`, `to_numpy` and `fill` of another field compiles a
kernel of its own (0.1 s without a cache, 0.03 s with one); here a component compiles one for all of its fields, when it
is built. After that nothing here compiles.
"""

from collections.abc import Callable, Sequence
from math import prod
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.kernels import Template
from taichi_plume.grid.memory import KINDS, views


class _Layout:
    """Where fields lie, one after the other, in a flat array of f32 (of i32 and u32 by their bits) and one of f64."""

    def __init__(self, fields: Sequence[Any]):
        self.fields = tuple(fields)
        self.widths = tuple(getattr(field, "n", 1) for field in fields)
        self.vectors = tuple(isinstance(field, ti.MatrixField) for field in fields)
        self.shapes = tuple(
            (*field.shape, n) if vector else field.shape
            for field, n, vector in zip(fields, self.widths, self.vectors, strict=True)
        )
        self.dtypes = tuple(KINDS[field.dtype] for field in fields)
        self.alike = alike(fields)
        self.begins: tuple[int, ...] = ()
        length = {False: 0, True: 0}
        for shape, dtype in zip(self.shapes, self.dtypes, strict=True):
            self.begins += (length[dtype is np.float64],)
            length[dtype is np.float64] += prod(shape)
        self.single = np.zeros(max(1, length[False]), np.float32)
        self.double = np.zeros(max(1, length[True]))

    def part(self, f: int) -> np.ndarray:
        """The place of field f in the flat arrays, a view of the field's shape and kind of number."""
        flat = self.double if self.dtypes[f] is np.float64 else self.single.view(self.dtypes[f])
        return flat[self.begins[f] : self.begins[f] + prod(self.shapes[f])].reshape(self.shapes[f])


def alike(fields: Sequence[Any]) -> tuple[tuple[int, ...], ...]:
    """Numbers of the fields of each shape: one loop for all of them compiles in a fraction of the time of one each."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for f, field in enumerate(fields):
        groups.setdefault(tuple(field.shape), []).append(f)
    return tuple(tuple(group) for group in groups.values())


@ti.func
def _place(I: Template, shape: Template):
    """Number of entry I in an array of that shape, last axis fastest."""
    place = 0
    for d in ti.static(range(len(shape))):
        place = place * shape[d] + I[d]
    return place


def uploader(*fields: Any) -> Callable[..., None]:
    """A function ``put(*arrays)`` that sets the fields, whole and in this order.

    An array has the field's shape (and a last axis over the components of a vector field), or is one number for all.
    """
    launched: list[Callable[..., None]] = []

    def upload(*arrays: Any) -> None:
        if len(arrays) != len(fields):
            raise TypeError(f"{len(fields)} fields, {len(arrays)} arrays")
        places = views(fields)
        if places is None:
            launched[:] = launched or [_uploading(fields)]
            launched[0](*arrays)
            return
        for place, array in zip(places, arrays, strict=True):
            place[...] = array

    return upload


def reader(*fields: Any) -> Callable[[], list[np.ndarray]]:
    """A function that reads the fields: an array of each, shaped as those that `uploader` takes."""
    launched: list[Callable[[], list[np.ndarray]]] = []

    def read() -> list[np.ndarray]:
        places = views(fields)
        if places is None:
            launched[:] = launched or [_reading(fields)]
            return launched[0]()
        return [np.array(place, order="C") for place in places]

    return read


def _uploading(fields: Sequence[Any]) -> Callable[..., None]:
    """As `uploader`, in one launch."""
    layout = _Layout(fields)
    widths, begins, vectors = layout.widths, layout.begins, layout.vectors
    dtypes = tuple(field.dtype for field in fields)

    @ti.func
    def entry(f: Template, at, single: Template, double: Template):
        value = ti.cast(0, dtypes[f])
        if ti.static(dtypes[f] == ti.f64):
            value = double[at]
        elif ti.static(dtypes[f] == ti.f32):
            value = single[at]
        else:
            value = ti.bit_cast(single[at], dtypes[f])
        return value

    @ti.kernel
    def put(single: ti.types.ndarray(dtype=ti.f32, ndim=1), double: ti.types.ndarray(dtype=ti.f64, ndim=1)):
        for same in ti.static(layout.alike):
            for I in ti.grouped(fields[same[0]]):
                place = _place(I, fields[same[0]].shape)
                for f in ti.static(same):
                    for k in ti.static(range(widths[f])):
                        value = entry(f, begins[f] + place * widths[f] + k, single, double)
                        if ti.static(not vectors[f]):
                            fields[f][I] = value
                        else:
                            fields[f][I][k] = value

    def upload(*arrays: Any) -> None:
        for f, array in enumerate(arrays):
            layout.part(f)[...] = array
        put(layout.single, layout.double)

    return upload


def _reading(fields: Sequence[Any]) -> Callable[[], list[np.ndarray]]:
    """As `reader`, in one launch."""
    layout = _Layout(fields)
    widths, begins, vectors = layout.widths, layout.begins, layout.vectors
    dtypes = tuple(field.dtype for field in fields)

    @ti.func
    def keep(f: Template, value, at, single: Template, double: Template):
        if ti.static(dtypes[f] == ti.f64):
            double[at] = value
        elif ti.static(dtypes[f] == ti.f32):
            single[at] = value
        else:
            single[at] = ti.bit_cast(value, ti.f32)

    @ti.kernel
    def get(single: ti.types.ndarray(dtype=ti.f32, ndim=1), double: ti.types.ndarray(dtype=ti.f64, ndim=1)):
        for same in ti.static(layout.alike):
            for I in ti.grouped(fields[same[0]]):
                place = _place(I, fields[same[0]].shape)
                for f in ti.static(same):
                    for k in ti.static(range(widths[f])):
                        at = begins[f] + place * widths[f] + k
                        if ti.static(not vectors[f]):
                            keep(f, fields[f][I], at, single, double)
                        else:
                            keep(f, fields[f][I][k], at, single, double)

    def read() -> list[np.ndarray]:
        get(layout.single, layout.double)
        return [layout.part(f).copy() for f in range(len(fields))]

    return read


class Numbers:
    """Numbers that kernels read when they run, so that other values need no other kernel; all f32.

    ``n = Numbers("viscosity", "schmidt")`` makes them, ``n.set(viscosity=1.56e-5, schmidt=0.7)`` sets them (all that
    change in one call: a launch), a kernel reads ``n.viscosity[None]``, the host ``n["viscosity"]``.
    """

    def __init__(self, *names: str):
        self._values = dict.fromkeys(names, 0.0)
        for name in names:
            setattr(self, name, ti.field(ti.f32, ()))
        self._upload = uploader(*(getattr(self, name) for name in names))

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, **values: float) -> None:
        """Set some of the numbers, or all."""
        unknown = values.keys() - self._values.keys()
        if unknown:
            raise KeyError(*sorted(unknown))
        self._values |= {name: float(value) for name, value in values.items()}
        self._upload(*self._values.values())
