"""Extension of velocities to the closed faces of cut cells, for the convection of the air beside oblique surfaces.

Where a surface cuts the cells, air along the surface passes closed faces. With the velocity 0 on closed faces the
surface would take the momentum of that air, as a stair does. For convection the closed faces therefore get the velocity
beside the surface: inflow equals outflow, and friction alone takes momentum (see `surfaces`).

Only beside plane surfaces: on curved surfaces and at edges the boundary layers separate, but with air that slips they
do not (a cylinder of 8 cells at Re 10,000 had a drag coefficient of 0.2; with 0 on the closed faces it has 1.15, about
the measured value). Beside surfaces along the axes no air passes closed faces.
"""

from collections.abc import Callable
from functools import partial
from itertools import combinations_with_replacement, product
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter, uniform_filter

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template, each, together

REACH = 3  # cells that the convection schemes reach
PLANE = 0.994  # share of the sum of squares of the normals' components along one direction within REACH
ALONG = 0.999  # share above which that direction counts as one of the axes
FAR = 1000  # lower bound of a squared distance


def oblique_planes(vectors: np.ndarray, cells: np.ndarray, grid: Grid) -> np.ndarray:
    """Return whether all surface within REACH of each cell is plane and oblique to all axes, bool (n,).

    cells: padded indices (n, dim). vectors: area vectors, (*padded, dim). Opposite sides of a sheet count as one plane.
    """
    vectors = vectors.copy()
    for a, (begin, end) in enumerate(grid.cells):
        if not grid.periodic[a]:  # faces of the domain are open or closed as a whole: no direction
            along = np.moveaxis(vectors, a, 0)
            along[: begin + 1] = along[end - 1 :] = 0.0
    dim, size = vectors.shape[-1], np.maximum(np.linalg.norm(vectors, axis=-1), 1e-6)
    squares = np.empty((len(cells), dim, dim))
    for i, j in combinations_with_replacement(range(dim), 2):
        mean = uniform_filter(vectors[..., i] * vectors[..., j] / size, 2 * REACH + 1, mode="nearest")
        squares[:, i, j] = squares[:, j, i] = mean[tuple(cells.T)]
    squares /= np.maximum(np.trace(squares, axis1=1, axis2=2), 1e-12)[:, None, None]
    plane = np.linalg.eigvalsh(squares)[:, -1] > PLANE
    return plane & (np.diagonal(squares, axis1=1, axis2=2).max(axis=1, initial=0.0) < ALONG)


class Extension:
    """Extension of velocities to the closed faces near an oblique plane surface: the mean, by area, over the nearest
    faces with a part of the surface. There is no extension where the viscous layer is resolved (see `Surfaces.slip`).
    """

    def __init__(self, surfaces: Any, convex: np.ndarray, area: list[np.ndarray]):
        """surfaces: `Surfaces`; convex: mask of the faces in `surfaces` beside a convex surface, bool (n,); area:
        padded area fractions of the faces.
        """
        self.surfaces, self.grid = surfaces, surfaces.grid
        self._count: list[int] = []  # closed faces of each axis
        self._beside_count: list[int] = []
        fields: list[list[Field]] = []  # per axis
        slips = oblique_planes(surfaces.vectors, np.concatenate(surfaces.faces), self.grid) & ~convex
        parts = np.split(slips, np.cumsum([len(faces) for faces in surfaces.faces])[:-1])
        for d in range(self.grid.dim):
            face, end, source, weight = self._sources(d, area[d], parts[d])
            beside, source = np.unique(source, return_inverse=True)
            self._count.append(len(face))
            self._beside_count.append(len(beside))
            per_face = (end, source, weight, beside, np.zeros(len(beside)))
            fields.append([ti.filled_vectors(face), *map(ti.filled, per_face)])
        # face; end of its part of source and weight; source: number of a face in beside; beside: faces in `surfaces`,
        # and slip, their velocity [m/s]
        self._face, self._end, self._source, self._weight, self._beside, self._slip = zip(
            *fields, strict=True
        )
        self.cells = sum(self._count)

    def _sources(self, d: int, area: np.ndarray, slips: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the closed faces of axis d (n, dim) to extend to, periodic ghost layers included; the end (n,) of each
        face's part of the other two arrays; indices of its source faces in `surfaces`; and the weights of these.

        slips: mask of the faces in `surfaces` at which air slips, bool.
        """
        grid, listed = self.grid, self.surfaces.faces[d]
        if not slips.any():
            none = np.zeros(0, int)
            return listed[:0], none, none, np.zeros(0)
        number, solved = np.full(grid.padded, -1), np.ones(grid.padded, bool)
        number[tuple(listed.T)] = np.arange(len(listed))
        for a, (begin, end) in enumerate(grid.cells):
            if grid.periodic[a]:
                within = np.take(number, np.arange(begin, end), axis=a)
                width = [(grid.ghost, grid.ghost) if b == a else (0, 0) for b in range(grid.dim)]
                number = np.pad(within, width, mode="wrap")
            else:  # boundary faces are prescribed or open
                along = np.moveaxis(solved, a, 0)
                along[: begin + (a == d)], along[end:] = False, False
        near = maximum_filter(np.where(number >= 0, slips[number], False), 2 * REACH + 1, mode="constant")
        face = np.argwhere(solved & near & (area == 0.0))
        steps = np.array([step for step in product(range(-REACH, REACH + 1), repeat=grid.dim) if any(step)])
        away = (steps**2).sum(axis=-1)
        steps, away = steps[away <= REACH**2], away[away <= REACH**2]
        places = face[:, None] + steps
        inside = ((places >= 0) & (places < grid.padded)).all(axis=-1)
        places = tuple(np.moveaxis(np.clip(places, 0, np.array(grid.padded) - 1), -1, 0))
        far = np.where(inside & (number[places] >= 0), away, FAR)
        nearest = (far < FAR) & (far == far.min(axis=1, keepdims=True, initial=FAR))
        weight = np.where(nearest, area[places], 0.0)
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-6)
        used = nearest & slips[number[places]]
        has_source = used.any(axis=1)
        return face[has_source], np.cumsum(used[has_source].sum(axis=1)), number[places][used], weight[used]

    def setting(self) -> list[Pass]:
        """Return the passes that set the velocities on closed faces, ghosts included, from those on open faces."""
        slipping = [each(partial(self._slip_at, d), count) for d, count in enumerate(self._beside_count)]
        return [*together(slipping), *self._on_closed(self._extend)]

    def clearing(self) -> list[Pass]:
        """Return the passes that reset the velocities on closed faces to 0."""
        return self._on_closed(self._clear)

    def _on_closed(self, at: Callable) -> list[Pass]:
        return together([each(partial(at, d), count) for d, count in enumerate(self._count)])

    @ti.func
    def _slip_at(self, d: Template, k, a, b):
        self._slip[d][k] = self.surfaces.slip(d, self._beside[d][k])

    @ti.func
    def _extend(self, d: Template, k, a, b):
        total = 0.0
        for m in range(ti.select(k > 0, self._end[d][ti.max(k - 1, 0)], 0), self._end[d][k]):
            total += self._weight[d][m] * self._slip[d][self._source[d][m]]
        self.surfaces.m.u[d][self._face[d][k]] = total

    @ti.func
    def _clear(self, d: Template, k, a, b):
        self.surfaces.m.u[d][self._face[d][k]] = 0.0
