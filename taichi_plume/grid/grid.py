"""Staggered (MAC) grid: shape, spacing, ghost layers, allocation of fields.

Cell I covers [(I - ghost) dx, (I - ghost + 1) dx]. A face field of axis d holds at index I the value on the lower
d-face of cell I. Fields store axis 0 contiguously, where the domain is usually longest.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import ArrayField, Field, Layout
from taichi_plume.grid.kernels import Template, launch
from taichi_plume.grid.sweeps import sweep


def centers(cells: Sequence[int], edge: float) -> np.ndarray:
    """Return the centres (*cells, dim) [m] of cells of edge `edge` [m]; cells: their number along each axis."""
    axes = [(np.arange(n) + 0.5) * edge for n in cells]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def block_mean(values: np.ndarray, n: int | tuple[int, ...]) -> np.ndarray:
    """Return the mean over blocks of n entries per axis (n: one number or one per axis); n must divide each length."""
    blocks = (n,) * values.ndim if isinstance(n, int) else n
    split = values.reshape(
        [m for length, b in zip(values.shape, blocks, strict=True) for m in (length // b, b)]
    )
    return split.mean(axis=tuple(range(1, split.ndim, 2)))


@ti.func
def _toward(field: Template, goal: Template, I, share, _):
    return (1.0 - share) * field[I] + share * goal[I]


@dataclass(frozen=True)
class Grid:
    """Staggered grid: `shape` cubic cells of edge `dx` [m], `ghost` layers; in 2-D cells are columns of `depth` [m]."""

    shape: tuple[int, ...]
    dx: float
    depth: float = 1.0
    ghost: int = 3
    periodic: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        if not self.periodic:
            object.__setattr__(self, "periodic", (False,) * self.dim)

    @staticmethod
    def of(domain: Any, periodic: tuple[bool, ...] = ()) -> "Grid":
        """Return the grid of a scenario's domain, which has `shape`, `spacing` and `depth`."""
        return Grid(domain.shape, domain.spacing, domain.depth, periodic=periodic)

    @cached_property
    def _layouts(self) -> dict[tuple[int, ...], Layout]:
        """Layouts of the grid's fields by shape."""
        return {}

    def layout(self, shape: tuple[int, ...]) -> Layout:
        """Return the layout of the grid's fields of a shape, axis 0 contiguous."""
        return self._layouts.setdefault(shape, Layout(shape, first_axis_contiguous=True))

    @property
    def dim(self) -> int:
        """Dimension of the grid, 2 or 3."""
        return len(self.shape)

    @property
    def extent(self) -> tuple[float, ...]:
        """Size of the domain along each axis [m]."""
        return tuple(n * self.dx for n in self.shape)

    @property
    def padded(self) -> tuple[int, ...]:
        """Number of cells along each axis, ghost layers included."""
        return tuple(n + 2 * self.ghost for n in self.shape)

    @property
    def cell_volume(self) -> float:
        """Volume of a cell [m³]; in 2-D, of its column through the slab."""
        return self.dx**self.dim * (self.depth if self.dim == 2 else 1.0)

    @property
    def cells(self) -> tuple[tuple[int, int], ...]:
        """Padded index of the first inner cell, and the end of the inner cells, per axis."""
        return tuple((self.ghost, self.ghost + n) for n in self.shape)

    def faces(self, d: int) -> tuple[tuple[int, int], ...]:
        """Return (first, end) per axis of the faces across d: of inner cells, with the domain's upper faces."""
        return tuple((begin, end + (a == d)) for a, (begin, end) in enumerate(self.cells))

    def field(self, shape: tuple[int, ...] = (), dtype: object = ti.f32) -> Field:
        """Return a new scalar field over the padded grid (or `shape`), axis 0 contiguous."""
        return ArrayField(dtype, self.layout(shape or self.padded))

    def filled(self, values: np.ndarray) -> Field:
        """Return a new scalar field with these values, axis 0 contiguous."""
        field = self.field(values.shape)
        field.from_numpy(values)
        return field

    def vector_field(self, shape: tuple[int, ...]) -> Field:
        """Return a new field of vectors (dim,) over `shape`, with the memory layout of `field`."""
        return ArrayField(ti.f32, self.layout(shape), self.dim)

    def faces_field(self) -> tuple[Field, ...]:
        """Return a new scalar field over the faces of each axis, as a tuple."""
        return tuple(self.field() for _ in self.shape)

    def inner(self, padded: np.ndarray) -> np.ndarray:
        """Return the view of a padded array without its ghost layers."""
        return padded[self._window(0)]

    def pad(self, inner: np.ndarray, axes: Sequence[int] | None = None) -> np.ndarray:
        """Return `inner` with ghost layers that repeat the edge, or wrap round on periodic axes.

        axes: axes of the domain that the first axes of `inner` are; by default all.
        """
        for n, axis in enumerate(range(self.dim) if axes is None else axes):
            width = [(self.ghost, self.ghost) if a == n else (0, 0) for a in range(inner.ndim)]
            inner = np.pad(inner, width, mode="wrap" if self.periodic[axis] else "edge")
        return inner

    def pad_faces(self, faces: np.ndarray, d: int) -> np.ndarray:
        """Return face values of axis d, one more than cells along d, padded by ghost layers as `pad` does."""
        if self.periodic[d]:
            return self.pad(np.delete(faces, -1, axis=d))  # the last face is the first face again
        for axis, wrap in enumerate(self.periodic):
            width = [(0, 0)] * self.dim
            width[axis] = (self.ghost, self.ghost - (axis == d))
            faces = np.pad(faces, width, mode="wrap" if wrap else "edge")
        return faces

    def read(self, field: Field, margin: int = 0) -> np.ndarray:
        """Return the inner values of a padded field, and `margin` ghost layers, as an array; faster than `to_numpy`.

        The array has the grid's shape, larger by twice the margin; axis 0 is contiguous.
        """
        return field.values[self._window(margin)].copy(order="F")

    def write(self, field: Field, values: np.ndarray, margin: int = 0) -> None:
        """Set the inner values of a padded field and `margin` ghost layers; other ghost layers stay unchanged."""
        field[self._window(margin)] = values

    def _window(self, margin: int) -> tuple[slice, ...]:
        """Return the index of a padded array's inner values with `margin` ghost layers."""
        return tuple(slice(begin - margin, end + margin) for begin, end in self.cells)

    def blending(self, fields: Sequence[Field], goals: Sequence[Field]) -> Callable[[float], None]:
        """Return a function that moves `fields` by a fraction towards `goals`, ghost layers included; 1 is exact."""
        everywhere = [(0, n) for n in self.padded]
        passes = [sweep(partial(_toward, f, g), f, everywhere) for f, g in zip(fields, goals, strict=True)]
        return launch(*passes)

    def largest_outflow(self, faces: Sequence[np.ndarray]) -> float:
        """Return the largest outflow of a cell over its volume [1/s]; faces: velocities [m/s] on each axis's faces."""
        out = sum(
            np.maximum(np.delete(u, 0, axis=d), 0.0) - np.minimum(np.delete(u, -1, axis=d), 0.0)
            for d, u in enumerate(faces)
        )
        return float(np.max(out)) / self.dx

    def centers(self) -> np.ndarray:
        """Return the centres of all cells [m], (*shape, dim)."""
        return centers(self.shape, self.dx)
