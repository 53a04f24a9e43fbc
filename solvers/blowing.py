"""Targets of an opening that blows, computed on a GPU.

A step sends the speed and the weights of planes of turbulence as arguments of a kernel; planes go to the GPU by blocks.
"""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.solvers.inflow import PLANES_AT_ONCE, Fluctuations

BLOCK = 32
"""Planes of turbulence that go to the GPU at a time."""


class Blowing:
    """Velocities of a jet on the n faces in its window, for the targets of its side of the domain.

    faces: (n, dim), indices in `target`; flow: (n, dim), velocities over the mean speed; noise: turbulence, if any.
    """

    def __init__(self, target: Field, faces: np.ndarray, flow: np.ndarray, noise: Fluctuations | None):
        self.target, self.noise, self.varies = target, noise, noise is not None
        self.count, self.dim = faces.shape
        self.faces, self.flow = ti.filled_vectors(faces), ti.filled_vectors(flow, ti.f32)
        rows = BLOCK if self.varies else 1
        self._planes = ti.vector_field(self.dim, ti.f32, (rows, 2, self.count))
        self._known = (0, 0, 0)  # number of the second box of waves, first plane, and the end of the planes

    def add(self, speed: float, deviation: float, dt: float) -> None:
        """Add the velocities at a mean speed and a deviation of turbulence [m/s], which advances by dt [s]."""
        first, shares = 0, [0.0] * (2 * PLANES_AT_ONCE)
        if self.noise is not None and speed != 0.0:
            number, place, planes, boxes = self.noise.move(speed, dt)
            known, begin, end = self._known
            if number != known or place < begin or place + PLANES_AT_ONCE > end:
                begin = self._fetch(number, place)
            first, shares = place - begin, [deviation * plane * box for plane in planes for box in boxes]
        self._add(first, speed, shares)

    def _fetch(self, number: int, begin: int) -> int:
        """Send the planes from `begin` on to the GPU, as far as they belong to the same boxes of waves."""
        assert self.noise is not None
        count = min(BLOCK, self.noise.planes_until(number) - begin)
        rows = np.zeros((*self._planes.shape, self.dim), np.float32)
        for row, place in zip(rows, range(begin, begin + count), strict=False):
            row[...] = [plane.T.reshape(-1, self.dim) for plane in self.noise.pair(number, place)]
        self._planes.from_numpy(rows)
        self._known = number, begin, begin + count
        return begin

    @ti.kernel
    def _add(self, first: ti.i32, speed: float, shares: ti.types.vector(2 * PLANES_AT_ONCE, ti.f32)):  # pyright: ignore
        for n in range(self.count):
            velocity = speed * self.flow[n]
            if ti.static(self.varies):
                for k in ti.static(range(PLANES_AT_ONCE)):
                    for box in ti.static(range(2)):
                        velocity += shares[2 * k + box] * self._planes[first + k, box, n]
            face = self.faces[n]
            for d in ti.static(range(self.dim)):
                self.target[face][d] = self.target[face][d] + velocity[d]
