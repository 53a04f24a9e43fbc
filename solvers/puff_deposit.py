"""Deposit of puffs on the grid: the mean concentration of every cell, without loss of mass.

A puff gives each cell the integral of its Gaussian over the cell, a product of differences of error functions; gas
beyond a closed face is mirrored back. Excluded are cells of obstacles, cells behind the tangent plane of the surface
next to the puff, and cells that no straight row of air cells reaches; the other cells share their part.
"""

from math import sqrt
from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field, on_cpu
from taichi_plume.grid.cut_cells import Air
from taichi_plume.solvers.puff_list import FREE
from taichi_plume.solvers.transport import raised

REACH = 4.0  # standard deviations to either side within which cells receive gas
LEAST = 0.01  # air fraction of a cell below which the cell gets no gas of its own


@ti.func
def _below(z):
    """Return the fraction of a Gaussian below z standard deviations (Abramowitz & Stegun 7.1.26, error below 1e-7)."""
    x = ti.abs(z) * ti.static(sqrt(0.5))
    t = 1.0 / (1.0 + 0.3275911 * x)
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    upper = 0.5 * tail * ti.exp(-x * x)
    return ti.select(z < 0.0, upper, 1.0 - upper)


class Deposit:
    """Deposit of a solver's puffs in the cells of the grid. Field c: mean concentration of each cell [kg/m³].

    solver: `PuffSolver` with the puffs; c: field to fill, by default a new one; rest: field for rounding errors of c.
    """

    def __init__(self, solver: Any, air: Air, c: Field | None = None, rest: Field | None = None):
        self.solver, self.grid, self.dim = solver, solver.grid, solver.dim
        self.c: Field = self.grid.field() if c is None else c
        self.rest: Field = rest
        self.exact = rest is not None
        carrier = solver.wind.carrier
        self._area: Field = (carrier.area if carrier is not None else None) or ()
        room = np.where(air.solid | (air.room < LEAST), 0.0, air.room)
        self.room = self.grid.filled(self.grid.pad(room))
        # fractions of the present puff per axis and cell; on a GPU of a batch of puffs
        self._lanes = 1 if on_cpu() else 4096
        self._share: Field = ti.field(ti.f32, (self._lanes, self.dim, max(self.grid.shape)))

    def cells(self, t: float) -> np.ndarray:
        """Return the mean concentration of every cell [kg/m³], of the grid's shape, at the solver's time t [s]."""
        self._spread(t)
        return self.grid.read(self.c)

    @ti.kernel
    def _spread(self, t: float):
        for I in ti.grouped(ti.ndrange(*self.c.shape)):
            self.c[I] = 0.0
        for lane in range(self._lanes):
            count = self.solver.puffs.cells.alive()
            for turn in range((count + self._lanes - 1) // self._lanes):
                q = turn * self._lanes + lane
                if q < count:
                    self.add(lane, q, ti.sqrt(self.solver.puffs.now[self.solver.puffs.variance][q]), t)

    @ti.func
    def add(self, lane, q, deviation: float, t: float):
        """Deposit puff q, with this standard deviation [m], in the cells; return the fraction that the domain holds."""
        puffs = self.solver.puffs
        x = puffs.place(q)
        s = puffs.cells.size(deviation**2)
        first, size = ti.Vector.zero(ti.i32, self.dim), ti.Vector.zero(ti.i32, self.dim)
        dx = ti.static(self.grid.dx)
        below, above = self.solver.walls.closed(x, REACH * s, t)
        held = 1.0  # fraction in the domain, mirrored parts included
        cells = 1
        for d in ti.static(range(self.dim)):
            n = ti.static(self.grid.shape[d])
            first[d] = ti.math.clamp(ti.cast(ti.floor((x[d] - REACH * s) / dx), ti.i32), 0, n - 1)
            last = ti.math.clamp(ti.cast(ti.floor((x[d] + REACH * s) / dx), ti.i32), 0, n - 1)
            if ti.static(self.grid.periodic[d]):  # decided at compile time
                if x[d] < REACH * s or ti.static(self.grid.extent[d]) - x[d] < REACH * s:
                    first[d], last = 0, n - 1
            size[d] = last - first[d] + 1
            cells *= size[d]
            held *= self._along(lane, d, x, s, first[d], size[d], below[d], above[d])
        given, mass = ti.cast(0.0, ti.f64), puffs.now[puffs.mass][q] * held
        for turn in range(2):  # first the total that the cells would receive
            for m in range(cells):
                part = self._part(lane, q, x, first, size, m)
                if turn == 0:
                    given += ti.cast(part, ti.f64)
                elif part > 0.0:
                    I = self._cell(first, size, m)
                    share = ti.cast(part / given, ti.f32)
                    self._give(I, mass * share / (self.room[I] * self.grid.cell_volume))
        return ti.select(given > 0.0, held, 0.0)

    @ti.func
    def _give(self, I, more):
        if ti.static(self.exact):
            self.c[I], self.rest[I] = raised(self.c[I], self.rest[I], more, 1.0)
        else:
            self.c[I] += more

    @ti.func
    def _along(self, lane, d: ti.template(), x, s, first, size, below, above):  # type: ignore[valid-type]
        """Set a puff's fractions in cells along axis d, ends closed (1) or open (0); return its part in the domain."""
        L, dx = ti.static(self.grid.extent[d]), ti.static(self.grid.dx)
        for k in range(size):
            low, high = (first + k) * dx, (first + k + 1) * dx
            share = _below((high - x[d]) / s) - _below((low - x[d]) / s)
            if ti.static(self.grid.periodic[d]):
                share += _below((high - x[d] - L) / s) - _below((low - x[d] - L) / s)
                share += _below((high - x[d] + L) / s) - _below((low - x[d] + L) / s)
            else:
                share += below * (_below((high + x[d]) / s) - _below((low + x[d]) / s))
                share += above * (_below((high - 2.0 * L + x[d]) / s) - _below((low - 2.0 * L + x[d]) / s))
            self._share[lane, d, k] = share
        gone = (1.0 - below) * _below(-x[d] / s) + (1.0 - above) * _below((x[d] - L) / s)
        if ti.static(self.grid.periodic[d]):
            gone = 0.0
        return 1.0 - gone

    @ti.func
    def _cell(self, first, size, m):
        """Return the padded index of cell m in a puff's block of cells."""
        I, left = first, m
        for d in ti.static(range(self.dim)):
            I[d] = first[d] + left % size[d] + self.grid.ghost
            left = left // size[d]
        return I

    @ti.func
    def _part(self, lane, q, x, first, size, m):
        """Return the fraction of puff q in cell m of its block, before normalisation; 0 for cells out of its reach."""
        part, left, before = 1.0, m, 0.0
        away = self.solver.puffs.plane_distance(q)
        for d in ti.static(range(self.dim)):
            k = left % size[d]
            left = left // size[d]
            part *= self._share[lane, d, k]
            center = (first[d] + k + 0.5) * self.grid.dx
            before += self.solver.puffs.plane_normal(q, d) * (center - x[d])
        I = self._cell(first, size, m)
        room = self.room[I]
        if ti.static(self.solver.walls.solid):
            if away < FREE and part * room > 0.0 and before + away > 0.0:
                room *= self._leads_to(I, x)
        return ti.select(before + away > 0.0, part * room, 0.0)

    @ti.func
    def _leads_to(self, I, x):
        """Return 1 if the straightest row of cells from cell I to x, and the faces between them, are air, else 0."""
        home, left = I, I
        for d in ti.static(range(self.dim)):
            n = ti.static(self.grid.shape[d])
            home[d] = ti.static(self.grid.ghost) + ti.math.clamp(
                ti.cast(x[d] / self.grid.dx, ti.i32), 0, n - 1
            )
            left[d] = home[d] - I[d]
        J, free = I, 1.0
        way = abs(left)
        for _ in range(way.sum()):
            axis, behind = 0, -1.0
            for d in ti.static(range(self.dim)):  # the axis that lags most behind the straight line
                more = ti.cast(ti.abs(home[d] - J[d]), ti.f32) / ti.max(way[d], 1)
                if more > behind:
                    axis, behind = d, more
            for d in ti.static(range(self.dim)):
                if axis == d:
                    step = ti.select(left[d] > 0, 1, -1)
                    if ti.static(len(self._area) > 0):
                        face = J
                        face[d] += ti.max(step, 0)
                        free = ti.select(self._area[d][face] > 0.0, free, 0.0)
                    J[d] += step
            if (home != J).any():  # there is air at x, even if the cell holds little
                free = ti.select(self.room[J] > 0.0, free, 0.0)
        return free
