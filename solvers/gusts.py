"""Ornstein-Uhlenbeck processes and their integrals over time: gusts, and how far they have carried the air.

    dv = -v/T dt + s sqrt(2/T) dW,  dY = v dt

Drawn by the exact joint law of both increments (Gillespie 1996, doi:10.1103/PhysRevE.54.2084) at knots in time that no
one's steps change. In between Y is the cubic that has v as its slope at the knots: the mean of all paths through them,
to leading order in the knots' interval over T.
"""

from collections.abc import Sequence
from math import ceil, expm1
from typing import Any

import numpy as np
import taichi as ti
from scipy.signal import lfilter

from taichi_plume.grid.kernels import Template

KNOTS_PER_TIME = 20  # in between v lacks 0.6 % of its variance, Y 0.1 % of s T
KNOTS_PER_REACH = 50  # where the gusts are slower than what is told of them
BLOCK = 64  # knots drawn at a time


def knots(time: float, reach: float) -> int:
    """How many are kept to tell of the last `reach` seconds of a process of integral time `time` [s]."""
    return BLOCK * (ceil(reach / interval(time, reach) / BLOCK) + 2)


def interval(time: float, reach: float) -> float:
    """Time from one knot to the next [s]."""
    return min(time / KNOTS_PER_TIME, reach / KNOTS_PER_REACH)


def cubic(w, h, y, v):
    """Y and v at share w of an interval of length h, from the values y and v at both of its ends."""
    rise = y[1] - y[0]
    bend, twist = 3 * rise - h * (2 * v[0] + v[1]), h * (v[0] + v[1]) - 2 * rise
    return y[0] + w * (h * v[0] + w * (bend + w * twist)), v[0] + w * (2 * bend + 3 * w * twist) / h


_cubic: Any = ti.func(cubic)


@ti.kernel
def _store(path: Template, first: ti.i32, values: ti.types.ndarray()):
    for n, c in ti.ndrange(values.shape[0], values.shape[1]):
        path[first + n][c] = values[n, c]


@ti.data_oriented
class OrnsteinUhlenbeck:
    """Independent processes v of zero mean, and their integrals Y; of all, the last `reach` seconds are known.

    deviations: standard deviation of each; time: their integral time [s]; begin: the first time asked for [s].
    Field path, a ring of knots: Y and v of each process.
    """

    def __init__(
        self,
        deviations: Sequence[float],
        time: float,
        begin: float,
        reach: float,
        rng: np.random.Generator,
    ):
        self.deviations = np.asarray(deviations, float)
        self.size = len(self.deviations)
        self.time, self.reach = time, reach
        self.interval = interval(time, reach)
        self.count = knots(time, reach)
        self.path = ti.Vector.field(2 * self.size, ti.f32, self.count)
        self.head = ti.field(ti.i32, ())
        self.share = ti.field(ti.f32, ())
        self.now = ti.Vector.field(self.size, ti.f32, ())
        self._rng = rng
        self._known = np.zeros((self.count, 2, self.size))
        self._drawn = 0
        self._origin = begin - reach
        self._law()
        self._last = np.stack([np.zeros(self.size), self.deviations * rng.standard_normal(self.size)])
        self.advance(begin)

    def _law(self) -> None:
        """Memory of v over an interval, and the factor of the covariance of what is new in v and Y, for s = 1."""
        h, T = self.interval / self.time, self.time
        fresh = -expm1(-h)
        variance_v = fresh * (2.0 - fresh)
        covariance = T * fresh**2
        variance_y = T**2 * (2.0 * h - 2.0 * fresh - fresh**2)
        self._memory, self._carried = 1.0 - fresh, T * fresh
        self._factor = np.linalg.cholesky([[variance_v, covariance], [covariance, variance_y]])

    def _draw(self) -> None:
        """The next knots, after the last ones drawn."""
        noise = self._rng.standard_normal((BLOCK, self.size, 2)) @ self._factor.T
        new_v, new_y = (self.deviations * noise[..., k] for k in (0, 1))
        y, v = self._last
        after, _ = lfilter([1.0], [1.0, -self._memory], new_v, axis=0, zi=self._memory * v[None])
        before = np.concatenate([v[None], after[:-1]])
        rows = np.stack([y + np.cumsum(self._carried * before + new_y, axis=0), after], axis=1)
        first = self._drawn % self.count
        self._known[first : first + BLOCK] = rows
        _store(self.path, first, rows.reshape(BLOCK, -1).astype(np.float32))
        self._last = rows[-1]
        self._drawn += BLOCK

    def advance(self, t: float) -> None:
        """Let `now` be time t [s], which never goes back."""
        while (t - self._origin) / self.interval >= self._drawn - 1:
            self._draw()
        knot, share = self._place(t)
        self.head[None], self.share[None] = knot, share
        self.now[None] = self.at(t)[0]

    def _place(self, t: float) -> tuple[int, float]:
        share, knot = np.modf((t - self._origin) / self.interval)
        return int(knot) % self.count, float(share)

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Y and v of each process at a time that is not further back than `reach`, nor ahead of now."""
        knot, share = self._place(t)
        ends = self._known[[knot, (knot + 1) % self.count]]
        return cubic(share, self.interval, ends[:, 0], ends[:, 1])

    @ti.func
    def before(self, age: float):
        """By how much each Y has grown in the last `age` seconds, and v then."""
        place = self.share[None] - ti.math.clamp(age, 0.0, self.reach) / self.interval
        below = ti.floor(place)
        knot = (self.head[None] + ti.cast(below, ti.i32) + self.count) % self.count
        low, high = self.path[knot], self.path[(knot + 1) % self.count]
        grown = ti.Vector.zero(ti.f32, self.size)
        then = ti.Vector.zero(ti.f32, self.size)
        for n in ti.static(range(self.size)):
            y, v = [low[n], high[n]], [low[self.size + n], high[self.size + n]]
            there, then[n] = _cubic(place - below, self.interval, y, v)
            grown[n] = self.now[None][n] - there
        return grown, then
