"""Recorded flow realisations in memory: each environment of a learner plays a film, from any start time.

The films are planes at the height of the sensors, or volumes for drones, in half precision (11 bits: 0.05 %). They are
interpolated linearly in time between frames, and bilinearly or trilinearly in space over the cells that hold air.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template

WIND, GAS = 0, 1  # rows of `air`: at the height of the anemometer, and of the gas sensor
TOP = 2.0**15  # stored value of the largest ppm of a gas in a film; half precision ends at 65504


class FilmBank:
    """Wind and gas at robots, from recordings (films) that environments of a learner play, each from its own time.

    Robot i belongs to environment e = i // robots, which plays film[e] at begin[e] + now[e] [s] of the film. After its
    end the last frame holds. gas_of[e] is the number of the gas in use, -1 for all gases.
    """

    STATE = ("film", "gas_of", "begin", "now")

    def __init__(self, bank: Any, count: int, robots: int = 1, background: Mapping[str, float] | None = None):
        """count: number of environments; robots: robots of each environment; background: of species in clean air [ppm],
        by name, which adds to the recorded gas. bank: see envs/bank.py, with

        values (films, frames, nx, ny, 2 + gases), of volumes (films, frames, nx, ny, nz, 2 + gases), float16: wind
        along the floor [m/s], and each gas in units of its scale; scale (films, gases) [ppm]; air (2, nx, ny) or
        (2, nx, ny, nz), rows WIND and GAS; spacing of the cells [m]; low: height of the lower end of a volume [m];
        frame [s] between frames; species of each gas.
        """
        self.films, self.frames, *cells, channels = bank.values.shape
        self.cells, self.dim = tuple(cells), len(cells)
        self.gases, self.robots = channels - 2, robots
        self.species = tuple(dict.fromkeys(bank.species))
        self._which = tuple(self.species.index(species) for species in bank.species)
        self.background = tuple((background or {}).get(species.name, 0.0) for species in self.species)
        self.has_background = any(self.background)
        if self.has_background:
            self._background = ti.filled(self.background, ti.f32)
        self.film, self.gas_of = ti.field(ti.i32, count), ti.filled(np.full(count, -1))
        self.begin, self.now = ti.field(ti.f32, count), ti.field(ti.f32, count)
        self._air = ti.filled(bank.air, ti.f32)
        self._scale = ti.filled(bank.scale if self.gases else np.zeros((self.films, 1)))
        self._frame, self._spacing = ti.filled(bank.frame, ti.f32), ti.filled(bank.spacing, ti.f32)
        self._values = ti.filled(bank.values, ti.f16)
        if self.dim == 3:
            self._low = ti.filled(bank.low, ti.f32)

    @ti.func
    def _moment(self, e):
        """Return the frame at or before environment e's time in its film, and the weight of the next (0 to 1)."""
        at = ti.math.clamp((self.begin[e] + self.now[e]) / self._frame[None], 0.0, self.frames - 1.0)
        n = ti.min(ti.cast(at, ti.i32), ti.max(self.frames - 2, 0))
        return n, at - n

    @ti.func
    def _corners(self, x: Template, row: ti.i32):
        """Return the lowest of the cells around point x [m], and the weights of all; 0 for cells without air."""
        most = ti.Vector(self.cells)
        low, weights = ti.Vector.zero(ti.i32, self.dim), ti.Vector.zero(ti.f32, 2**self.dim)
        part = ti.Vector.zero(ti.f32, self.dim)
        for d in ti.static(range(self.dim)):
            place = x[d]
            if ti.static(d == 2):
                place -= self._low[None]
            at = ti.math.clamp(place / self._spacing[None] - 0.5, 0.0, most[d] - 1.0)
            low[d] = ti.min(ti.cast(at, ti.i32), ti.max(most[d] - 2, 0))
            part[d] = at - low[d]
        total = 0.0
        for k in ti.static(range(2**self.dim)):
            w = 1.0
            for d in ti.static(range(self.dim)):
                w *= part[d] if ti.static(self._is_upper(k, d)) else 1.0 - part[d]
            w *= self._air[row, self._corner(low, k)]
            weights[k] = w
            total += w
        return low, weights / ti.max(total, 1e-6)

    def _is_upper(self, k: int, d: int) -> int:
        """Return 1 if corner k, of 2^dim corners, is at the upper end along axis d, else 0."""
        return k >> (self.dim - 1 - d) & 1

    @ti.func
    def _corner(self, low, k: Template):
        """Return the index of corner k of the cells whose lowest is `low`, within the film."""
        I = low
        for d in ti.static(range(self.dim)):
            I[d] = ti.min(low[d] + ti.static(self._is_upper(k, d)), self.cells[d] - 1)
        return I

    @ti.func
    def _value(self, film, n, share, low, weights, c):
        """Return channel c of a film between frames n and n + 1 (weight `share`), interpolated from its cells."""
        later, value = ti.min(n + 1, self.frames - 1), 0.0
        for k in ti.static(range(2**self.dim)):
            I = self._corner(low, k)
            now = ti.cast(self._values[film, n, I, c], ti.f32)
            then = ti.cast(self._values[film, later, I, c], ti.f32)
            value += weights[k] * (now + share * (then - now))
        return value

    @ti.func
    def velocity_of(self, i, x: Template, t: float):
        """Return the velocity [m/s] at point x [m] for robot i, in its environment's film at its time; t is ignored."""
        e = i // self.robots
        n, share = self._moment(e)
        low, weights = self._corners(x, WIND)
        result = ti.Vector.zero(ti.f32, x.n)
        for d in ti.static(range(2)):
            result[d] = self._value(self.film[e], n, share, low, weights, d)
        return result

    @ti.func
    def ppm_of(self, i, x: Template, t: float):
        """Return the mole fraction [ppm] of each species at point x [m] for robot i, in its environment's film."""
        e = i // self.robots
        film, chosen = self.film[e], self.gas_of[e]
        n, share = self._moment(e)
        low, weights = self._corners(x, GAS)
        result = ti.Vector.zero(ti.f32, ti.static(len(self.species)))
        for g in ti.static(range(self.gases)):
            if chosen < 0 or chosen == g:
                value = self._value(film, n, share, low, weights, 2 + g)
                result[self._which[g]] += value * self._scale[film, g]
        if ti.static(self.has_background):
            for s in ti.static(range(len(self.species))):
                result[s] += self._background[s]
        return result


def half(ppm: Sequence[np.ndarray] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return gas values (frames, ..., gases) [ppm] over a scale, in half precision, and the scale (gases,) [ppm]."""
    values = np.asarray(ppm, np.float32)
    top = np.abs(values).max(axis=tuple(range(values.ndim - 1)), initial=0.0)
    scale = np.where(top > 0.0, top / TOP, 1.0).astype(np.float32)
    return (values / scale).astype(np.float16), scale
