"""Transfer of arrays to and from many fields at once, and parameters that kernels read at run time.

On the CPU fields are copied in place. Elsewhere every `from_numpy`, `to_numpy` and `fill` of another field compiles its
own kernel (0.1 s without a cache, 0.03 s with a cache). Here a component compiles a single kernel for all its fields,
in its constructor, and nothing later.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from math import prod
from typing import TYPE_CHECKING

import numpy as np
import taichi as ti

from taichi_plume.grid.kernels import Field, Template
from taichi_plume.grid.memory import KINDS, views


class _Layout:
    """Layout of fields, one after the other, in a flat array of f32 (i32 and u32 by their bits) and one of f64."""

    def __init__(self, fields: Sequence[Field]):
        self.vectors = tuple(isinstance(field, ti.MatrixField) for field in fields)
        self.widths = tuple(
            field.n if vector else 1 for field, vector in zip(fields, self.vectors, strict=True)
        )
        self.shapes = tuple(
            (*field.shape, n) if vector else field.shape
            for field, n, vector in zip(fields, self.widths, self.vectors, strict=True)
        )
        self.dtypes = tuple(KINDS[field.dtype] for field in fields)
        self.begins: tuple[int, ...] = ()
        length = {False: 0, True: 0}
        for shape, dtype in zip(self.shapes, self.dtypes, strict=True):
            self.begins += (length[dtype is np.float64],)
            length[dtype is np.float64] += prod(shape)
        self.single = np.zeros(max(1, length[False]), np.float32)
        self.double = np.zeros(max(1, length[True]))

    def part(self, f: int) -> np.ndarray:
        """Return the part of the flat arrays that belongs to field f, as a view with the field's shape and type."""
        flat = self.double if self.dtypes[f] is np.float64 else self.single.view(self.dtypes[f])
        return flat[self.begins[f] : self.begins[f] + prod(self.shapes[f])].reshape(self.shapes[f])


def alike(fields: Sequence[Field]) -> tuple[tuple[int, ...], ...]:
    """Return the indices of the fields of each shape: one loop per shape compiles much faster than one per field."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for f, field in enumerate(fields):
        groups.setdefault(tuple(field.shape), []).append(f)
    return tuple(tuple(group) for group in groups.values())


@ti.func
def _place(I: Template, shape: Template):
    """Return the flat position of entry I in an array of this shape, last axis fastest."""
    place = 0
    for d in ti.static(range(len(shape))):
        place = place * shape[d] + I[d]
    return place


def uploader(*fields: Field) -> Callable[..., None]:
    """Return a function ``put(*arrays)`` that sets these fields, whole and in this order.

    An array has the field's shape (and a last axis over the components of a vector field), or is one number for all.
    """
    copier = cache(partial(_copier, fields))

    def upload(*arrays: np.ndarray | float) -> None:
        if len(arrays) != len(fields):
            raise TypeError(f"{len(fields)} fields, {len(arrays)} arrays")
        places = views(fields)
        if places is None:
            copier()[0](*arrays)
            return
        for place, array in zip(places, arrays, strict=True):
            place[...] = array

    return upload


def reader(*fields: Field) -> Callable[[], list[np.ndarray]]:
    """Return a function that returns the fields' values, one array per field, shaped as for `uploader`."""
    copier = cache(partial(_copier, fields))

    def read() -> list[np.ndarray]:
        places = views(fields)
        if places is None:
            return copier()[1]()
        return [np.array(place, order="C") for place in places]

    return read


def _copier(fields: Sequence[Field]) -> tuple[Callable[..., None], Callable[[], list[np.ndarray]]]:
    """Return functions that upload and read the fields, each by one launch of a kernel compiled when first used."""
    layout = _Layout(fields)
    groups, widths, begins, vectors = alike(fields), layout.widths, layout.begins, layout.vectors
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

    @ti.func
    def keep(f: Template, value, at, single: Template, double: Template):
        if ti.static(dtypes[f] == ti.f64):
            double[at] = value
        elif ti.static(dtypes[f] == ti.f32):
            single[at] = value
        else:
            single[at] = ti.bit_cast(value, ti.f32)

    @ti.kernel
    def copy(
        to_fields: Template,
        single: ti.types.ndarray(dtype=ti.f32, ndim=1),  # type: ignore[valid-type]
        double: ti.types.ndarray(dtype=ti.f64, ndim=1),  # type: ignore[valid-type]
    ):
        for same in ti.static(groups):
            for I in ti.grouped(fields[same[0]]):
                place = _place(I, fields[same[0]].shape)
                for f in ti.static(same):
                    for k in ti.static(range(widths[f])):
                        at = begins[f] + place * widths[f] + k
                        if ti.static(to_fields and vectors[f]):
                            fields[f][I][k] = entry(f, at, single, double)
                        elif ti.static(to_fields):
                            fields[f][I] = entry(f, at, single, double)
                        elif ti.static(vectors[f]):
                            keep(f, fields[f][I][k], at, single, double)
                        else:
                            keep(f, fields[f][I], at, single, double)

    def upload(*arrays: np.ndarray | float) -> None:
        for f, array in enumerate(arrays):
            layout.part(f)[...] = array
        copy(True, layout.single, layout.double)

    def read() -> list[np.ndarray]:
        copy(False, layout.single, layout.double)
        return [layout.part(f).copy() for f in range(len(fields))]

    return upload, read


class Numbers:
    """Scalar parameters (f32) that kernels read at run time, so that new values need no new kernel.

    ``n = Numbers("viscosity", "schmidt")`` creates the fields, ``n.set(viscosity=1.56e-5, schmidt=0.7)`` sets them in a
    launch per call. A kernel reads ``n.viscosity[None]``, the host ``n["viscosity"]``.
    """

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Field: ...

    def __init__(self, *names: str):
        self._values = dict.fromkeys(names, 0.0)
        fields = {name: ti.field(ti.f32, ()) for name in names}
        vars(self).update(fields)
        self._upload = uploader(*fields.values())

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, **values: float) -> None:
        """Set the given parameters, by name. Raises KeyError for an unknown name."""
        unknown = values.keys() - self._values.keys()
        if unknown:
            raise KeyError(*sorted(unknown))
        self._values |= {name: float(value) for name, value in values.items()}
        self._upload(*self._values.values())
