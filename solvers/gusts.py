"""Gusts of wind: Ornstein-Uhlenbeck processes, and their time integrals, the displacement of the air.

    dv = -v/T dt + s sqrt(2/T) dW,  dY = v dt

Drawn by the exact joint law of both increments (Gillespie 1996, doi:10.1103/PhysRevE.54.2084) at knots in time that do
not depend on time steps. Between knots Y is the cubic with slope v at the knots: the mean of all paths through them, to
leading order in the knots' interval over T.
"""

from collections.abc import Callable, Sequence
from math import ceil, expm1

import numpy as np

from taichi_plume.engine import ti

KNOTS_PER_TIME = 20  # between knots v lacks 0.6 % of its variance, Y 0.1 % of s T
KNOTS_PER_REACH = 50  # where the integral time of the gusts is longer than the reach
BLOCK = 64  # knots drawn at a time
LEAST = 1 << 15  # capacity in knots: a change during a run may make the wind slower, or the gusts shorter


def knots(time: float, reach: float) -> int:
    """Return the number of knots that store the last `reach` seconds of gusts of integral time `time` [s]."""
    return BLOCK * (ceil(reach / interval(time, reach) / BLOCK) + 2)


def interval(time: float, reach: float) -> float:
    """Return the time between knots [s] of gusts of integral time `time` [s] that are stored for `reach` seconds."""
    return min(time / KNOTS_PER_TIME, reach / KNOTS_PER_REACH)


def cubic(w, h, y, v):
    """Return Y and h times the growth of v at the fraction w of an interval of length h; y, v: values at both ends."""
    rise = y[1] - y[0]
    bend, twist = 3 * rise - h * (2 * v[0] + v[1]), h * (v[0] + v[1]) - 2 * rise
    return y[0] + w * (h * v[0] + w * (bend + w * twist)), w * (2 * bend + 3 * w * twist)


_cubic: Callable = ti.func(cubic)


class OrnsteinUhlenbeck:
    """Gusts: independent Ornstein-Uhlenbeck processes v and their integrals Y, stored for the last `reach` seconds.

    Fields: path, a ring buffer of knots with Y and v of each process; head, the knot before the present time; share,
    the fraction of the interval to the next knot; now, the present Y of each process.
    """

    STATE = ("path", "head", "share", "now", "_rng", "_known", "_drawn", "_last")

    def __init__(
        self,
        deviations: Sequence[float],
        time: float,
        t: float,
        reach: float,
        rng: np.random.Generator,
    ):
        """deviations: standard deviations; time: integral time [s]; t: first time used [s]; reach: memory [s]."""
        self.size = len(deviations)
        self.count = max(knots(time, reach), LEAST)
        self.path = ti.vector_field(2 * self.size, ti.f32, self.count)
        self.head = ti.field(ti.i32, ())
        self.share = ti.field(ti.f32, ())
        self.now = ti.vector_field(self.size, ti.f32, ())
        self.deviations = np.asarray(deviations, float)
        self.time, self.reach, self.interval = time, reach, interval(time, reach)
        self._reach, self._interval = ti.filled(reach, ti.f32), ti.filled(self.interval, ti.f32)
        self._rng = rng
        self._known = np.zeros((self.count, 2, self.size))
        self._drawn = 0
        self._origin = t - reach
        self._law()
        self._last = np.stack([np.zeros(self.size), self.deviations * rng.standard_normal(self.size)])
        self.advance(t)

    def _law(self) -> None:
        """Compute the memory of v over an interval, and the covariance factor of increments of v and Y if s = 1."""
        h, T = self.interval / self.time, self.time
        fresh = -expm1(-h)
        variance_v = fresh * (2.0 - fresh)
        covariance = T * fresh**2
        variance_y = T**2 * (2.0 * h - 2.0 * fresh - fresh**2)
        self._memory, self._carried = 1.0 - fresh, T * fresh
        self._factor = np.linalg.cholesky([[variance_v, covariance], [covariance, variance_y]])

    def _draw(self) -> None:
        """Draw the next BLOCK knots and store them."""
        from scipy.signal import lfilter  # takes 0.3 s: for runs with gusts only

        noise = self._rng.standard_normal((BLOCK, self.size, 2)) @ self._factor.T
        new_v, new_y = (self.deviations * noise[..., k] for k in (0, 1))
        y, v = self._last
        after, _ = lfilter([1.0], [1.0, -self._memory], new_v, axis=0, zi=self._memory * v[None])
        before = np.concatenate([v[None], after[:-1]])
        rows = np.stack([y + np.cumsum(self._carried * before + new_y, axis=0), after], axis=1)
        first = self._drawn % self.count
        self._known[first : first + BLOCK] = rows
        self.path[first : first + BLOCK] = rows.reshape(BLOCK, -1)
        self._last = rows[-1]
        self._drawn += BLOCK

    def advance(self, t: float) -> None:
        """Advance the present time to t [s], which must not decrease."""
        while (t - self._origin) / self.interval >= self._drawn - 1:
            self._draw()
        knot, share = self._place(t)
        self.head.fill(knot)
        self.share.fill(share)
        self.now.from_numpy(self.at(t)[0])

    def _place(self, t: float) -> tuple[int, float]:
        share, knot = np.modf((t - self._origin) / self.interval)
        return int(knot) % self.count, float(share)

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return Y and v of each process at time t [s], at most `reach` before the present time."""
        knot, share = self._place(t)
        ends = self._known[[knot, (knot + 1) % self.count]]
        y, growth = cubic(share, self.interval, ends[:, 0], ends[:, 1])
        return y, ends[0, 1] + growth / self.interval

    @ti.func
    def before(self, age: float):
        """Return the growth of each Y over the last `age` seconds, and each v at the start of that time."""
        interval = self._interval[None]
        place = self.share[None] - ti.math.clamp(age, 0.0, self._reach[None]) / interval
        below = ti.floor(place)
        knot = (self.head[None] + ti.cast(below, ti.i32) + self.count) % self.count
        low, high = self.path[knot], self.path[(knot + 1) % self.count]
        grown = ti.Vector.zero(ti.f32, self.size)
        then = ti.Vector.zero(ti.f32, self.size)
        for n in ti.static(range(self.size)):
            y, v = [low[n], high[n]], [low[self.size + n], high[self.size + n]]
            there, growth = _cubic(place - below, interval, y, v)
            grown[n] = self.now[None][n] - there
            then[n] = v[0] + growth / interval
        return grown, then
