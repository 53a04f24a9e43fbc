"""Transfer of arrays to and from several fields, and parameters that kernels read at run time."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field


def uploader(*fields: Field) -> Callable[..., None]:
    """Return a function ``put(*arrays)`` that sets these fields, whole and in this order.

    An array has the field's shape (and a last axis over the components of a vector field), or is one number for all.
    """

    def upload(*arrays: np.ndarray | float) -> None:
        if len(arrays) != len(fields):
            raise TypeError(f"{len(fields)} fields, {len(arrays)} arrays")
        for field, array in zip(fields, arrays, strict=True):
            field.from_numpy(array)

    return upload


def reader(*fields: Field) -> Callable[[], list[np.ndarray]]:
    """Return a function that returns the fields' values, one array per field, shaped as for `uploader`."""
    return lambda: [field.to_numpy() for field in fields]


class Numbers:
    """Scalar parameters (f32) that kernels read at run time, so that new values need no new kernel.

    ``n = Numbers("viscosity", "schmidt")`` creates the fields, ``n.set(viscosity=1.56e-5, schmidt=0.7)`` sets them.
    A kernel reads ``n.viscosity[None]``, the host ``n["viscosity"]``.
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
