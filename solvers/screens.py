"""Flow resistance inside the domain; screens (honeycombs, perforated sheets) as porous slabs (Darcy-Forchheimer).

A Darcy-Forchheimer slab of thickness l takes dp/rho = (a + b |u|) u from air that passes with u; the resistance to air
along the slab is `transverse` times as large. The slab is a layer of whole cells. For the normal velocity its faces
share the pressure drop as in the trapezoidal rule, so that the whole drop is exact; for tangential velocities |u| is
the sum of the parts. Every face solves u + h (a + b |u|) u = u* on its own, which is stable for any step.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.screens import Screen


class Resistance(Protocol):
    """Protocol of forces on the air in the domain by screens, moving obstacles, robots."""

    cells: int
    """Approximate number of faces that `apply` visits."""

    def advance(self, t: float, dt: float) -> None:
        """Prepare the force for the step from time t to t + dt [s]."""
        ...

    def fastest(self, t: float) -> float:
        """Return the largest velocity component [m/s] that the resistance gives to the air soon after t [s]."""
        ...

    def apply(self, u: Field, dt: Field) -> None:
        """ti.func: set u = (u + dt r v)/(1 + dt r) on faces, with rate r [1/s] and velocity v [m/s] of the body."""
        ...


@ti.func
def slowed(u, linear, square):
    """Return the solution v of v + (linear + square |v|) v = u, computed without cancellation."""
    b = 1.0 + linear
    return 2.0 * u / (b + ti.sqrt(b * b + 4.0 * square * ti.abs(u)))


class ScreenResistance:
    """Flow resistance of a screen (porous slab); satisfies `Resistance`.

    fractions: per axis, positive on faces whose velocity is solved for, on the padded grid. viscosity: kinematic
    [m²/s].
    """

    def __init__(self, screen: Screen, grid: Grid, fractions: Sequence[np.ndarray], viscosity: float):
        self.dim, self.dx = grid.dim, grid.dx
        self.axis = screen.normal
        self.across = [d for d in range(grid.dim) if d != self.axis]
        layers = max(1, round(screen.thickness / grid.dx))
        self.thickness = layers * grid.dx
        n = grid.shape[self.axis]
        first = int(np.clip(round(screen.at / grid.dx - layers / 2), 1, max(1, n - 1 - layers)))
        cells = self._cells(screen, grid, first, layers)
        behind = np.roll(cells, 1, axis=self.axis)
        share = (0.5 * cells + 0.5 * behind) / layers * (fractions[self.axis] > 0)
        held = [(cells | np.roll(cells, 1, axis=d)) & (fractions[d] > 0) for d in range(grid.dim)]
        held[self.axis] = share > 0
        self.counts = [int(faces.sum()) for faces in held]
        self.cells = sum(self.counts)
        self.faces = [ti.filled_vectors(np.argwhere(faces)) for faces in held]
        self.share = ti.filled(share[share > 0])
        self.a, self.b = map(ti.filled, screen.losses(viscosity))
        self.transverse = ti.filled(screen.transverse)

    @staticmethod
    def _cells(screen: Screen, grid: Grid, first: int, layers: int) -> np.ndarray:
        """Return a mask on the padded grid of the slab's cells: `layers` layers from `first` on."""
        center, half = map(np.array, screen.rectangle(grid.extent))
        places = np.delete(grid.centers(), screen.normal, axis=-1) - center
        if screen.is_disc(grid.dim):
            covered = np.linalg.norm(places, axis=-1) <= half[0]
        else:
            covered = (np.abs(places) <= half * (1 + 1e-6)).all(axis=-1)
        layer = np.arange(grid.shape[screen.normal])
        inside = (layer >= first) & (layer < first + layers)
        covered &= inside.reshape([-1 if d == screen.normal else 1 for d in range(grid.dim)])
        return np.pad(covered, grid.ghost)

    def advance(self, t: float, dt: float) -> None:
        """Do nothing: the resistance of a screen is constant."""

    def fastest(self, t: float) -> float:
        return 0.0

    @ti.func
    def apply(self, u: Template, dt):
        A = ti.Vector.unit(self.dim, self.axis, ti.i32)
        a, b, transverse = self.a[None], self.b[None], self.transverse[None]
        for n in range(self.counts[self.axis]):
            I = self.faces[self.axis][n]
            h = dt * self.share[n] / self.dx
            u[self.axis][I] = slowed(u[self.axis][I], h * a, h * b)
        for d in ti.static(self.across):
            D = ti.Vector.unit(self.dim, d, ti.i32)
            for n in range(self.counts[d]):
                I = self.faces[d][n]
                through = 0.0
                for side in ti.static((0, 1)):
                    J = I + side * A
                    through += 0.25 * (ti.abs(u[self.axis][J]) + ti.abs(u[self.axis][J - D]))
                h = dt * transverse / self.thickness
                u[d][I] = slowed(u[d][I], h * (a + b * through), h * b)
