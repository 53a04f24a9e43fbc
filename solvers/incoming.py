"""What the air that comes in through openings carries."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.transfer import uploader
from taichi_plume.solvers.patches import Patch


class Incoming:
    """A quantity q of the air outside, per face cell of the domain. fields: per axis, over its two faces."""

    def __init__(self, grid: Grid):
        """To be begun by its owner."""
        shape = grid.shape
        self.fields: list[Any] = [
            ti.field(ti.f32, tuple(2 if a == d else n for a, n in enumerate(shape))) for d in range(grid.dim)
        ]
        self._put = uploader(*self.fields)

    def begin(self, openings: Sequence[tuple[Patch, float]]) -> None:
        """Openings and q of the air that comes in through them; 0 beside them."""
        values = [np.zeros(field.shape) for field in self.fields]
        for patch, q in openings:
            np.moveaxis(values[patch.axis], patch.axis, 0)[patch.side][patch.covered] = q
        self._put(*values)
