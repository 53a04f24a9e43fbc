"""Tables of a solver: constant fields that are filled once."""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.transfer import uploader


class Tables:
    """Collection of the constant fields of a solver and its parts, filled together in a single launch by `upload`."""

    def __init__(self):
        self._fields: list[Field] = []
        self._values: list[np.ndarray] = []

    def put(self, field: Field, values: np.ndarray) -> Field:
        """Register values, of the field's shape, that `upload` will write to the field; return the field."""
        self._fields.append(field)
        self._values.append(np.asarray(values))
        return field

    def listed(self, values: np.ndarray) -> Field:
        """Return a new field for numbers (n,) or rows (n, dim), i32 or f32, that `upload` will fill. If n is 0, the
        field has one zero, as Taichi has no empty fields.
        """
        dtype = ti.i32 if np.issubdtype(values.dtype, np.integer) else ti.f32
        n = max(1, len(values))
        field = ti.field(dtype, n) if values.ndim == 1 else ti.vector_field(values.shape[1], dtype, n)
        return self.put(field, values if len(values) else np.zeros((1, *values.shape[1:])))

    def upload(self) -> None:
        """Write the registered values to their fields."""
        uploader(*self._fields)(*self._values)
        self._fields, self._values = [], []
