"""Eddy diffusivity of a room with a synthetic flow, from particles carried by its waves, rolls and eddies.

A cosine of half a wavelength along an axis of length L decays by diffusion as exp(-K (pi/L)² t), walls included. So
does its autocovariance over particles that fill the room evenly, <cos(pi x(s + t)/L) cos(pi x(s)/L)>. K follows from
the rate of decay once the particles have lost the memory of their velocity: between a third and two thirds of the
simulated time, or until noise dominates; K is the mean over all axes. The random numbers have a stream of their own, so
that the run does not change.

Between obstacles the cosine is no mode of diffusion. The cosine less its mean over the air then decays by K times its
Rayleigh quotient, the mean square of its slope over its variance: (pi/L)² in an empty room, more between inner walls.
"""

from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np
from scipy.ndimage import map_coordinates

AIRS, EACH = 8, 64  # independent realisations of the flow, and particles in each
STEP = 0.3  # time step over the turnover time of a particle
TURNS, MEMORIES = 60.0, 3.0  # least number of turnover times, and of the rolls' memory, to simulate
MOST = 240  # largest number of steps
LEAST = 0.3  # autocovariance of a cosine below which noise dominates

PER_CHANGE, WITHOUT = 0.52, 0.31  # K over V^(2/3) per hour: per air change, and without air changes


def air_changes(diffusivity: float, volume: float) -> float:
    """Return the air changes per hour n from K = V^(2/3) (0.52 n + 0.31) per hour (Cheng et al. 2011,
    doi:10.1021/es103080p, 11 measurements), V the `volume` [m³] and K the eddy diffusivity [m²/s] of a room; negative
    below that of closed rooms.
    """
    return (3600.0 * diffusivity / volume ** (2 / 3) - WITHOUT) / PER_CHANGE


def diffusivity(volume: float, changes: float) -> float:
    """Return the eddy diffusivity K [m²/s] of a room of `volume` [m³], by the law of `air_changes`."""
    return volume ** (2 / 3) * (PER_CHANGE * changes + WITHOUT) / 3600.0


@dataclass(frozen=True)
class RoomFlow:
    """Synthetic flow of a room that can be evaluated at any point, for several realisations at once.

    k (n, 3) [1/m], c (n, 3) [m²/s] and frequency (n,) [rad/s] of the waves; rolls: largest potential [m²/s] by axis;
    memory: of the rolls [s]; distance: of cell middles to the next surface [m], negative in solids, with a layer of
    cells all round; layer: thickness in which the flow fades [m]; eddies: viscosity of shorter eddies [m²/s], including
    the air's own `viscosity`.
    """

    extent: np.ndarray
    dx: float
    k: np.ndarray
    c: np.ndarray
    frequency: np.ndarray
    rolls: dict[int, float]
    memory: float
    distance: np.ndarray
    layer: float
    eddies: float
    viscosity: float
    schmidt: float

    @property
    def dim(self) -> int:
        """Dimension of the room, 2 or 3."""
        return len(self.extent)

    @property
    def turning(self) -> float:
        """Approximate rate [1/s] at which a particle crosses an eddy or the room."""
        across = pi / self.extent.min()
        k = np.linalg.norm(self.k, axis=1)
        waves = 0.5 * ((k * np.maximum(k, across)) ** 2 * (np.abs(self.c) ** 2).sum(axis=1)).sum()
        rolls = sum((largest * across**2) ** 2 for largest in self.rolls.values())
        return float(np.sqrt(waves + rolls))

    @cached_property
    def _slopes(self) -> list[np.ndarray]:
        return list(np.gradient(self.distance, self.dx))

    @cached_property
    def _across(self) -> np.ndarray:
        return np.cross(self.k, self.c)

    def around(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the distance [m] from surfaces, the ramp f and its gradient [1/m] at points x (n, dim) [m]."""
        at = (x / self.dx + 0.5).T
        parts = (self.distance, *self._slopes)
        d, *slope = (map_coordinates(part, at, order=1, mode="nearest") for part in parts)
        f = np.tanh(np.maximum(d, 0.0) / self.layer)
        gradient = np.zeros((len(x), 3))
        gradient[:, : self.dim] = np.stack(slope, axis=1) * ((1.0 - f**2) / self.layer)[:, None]
        return d, f, gradient

    def velocity(self, x: np.ndarray, phase: np.ndarray, turn: dict[int, np.ndarray]) -> np.ndarray:
        """Return u [m/s] at points x (n, dim) [m]; phase of the waves (n, waves) [rad]; turn (n,): rolls, by axis."""
        theta = x @ self.k[:, : self.dim].T + phase
        cos, sin = np.cos(theta), np.sin(theta)
        across = self._across
        A = cos @ self.c.real - sin @ self.c.imag
        curl = -sin @ across.real - cos @ across.imag
        for m, strength in self.rolls.items():
            axes = [a for a in range(self.dim) if a != m]
            waves = {a: np.sin(pi * x[:, a] / self.extent[a]) for a in axes}
            A[:, m] += strength * turn[m] * np.prod(list(waves.values()), axis=0)
            for a in axes:
                slope = pi / self.extent[a] * np.cos(pi * x[:, a] / self.extent[a])
                others = np.prod([waves[b] for b in axes if b != a], axis=0)
                part = strength * turn[m] * slope * others
                unit = np.cross(np.eye(3)[a], np.eye(3)[m])
                curl += part[:, None] * unit
        _, f, gradient = self.around(x)
        return (f[:, None] * curl + np.cross(gradient, A))[:, : self.dim]

    def spreading(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the diffusivity by shorter eddies [m²/s] and its gradient [m/s] at points x (n, dim) [m]."""
        _, f, gradient = self.around(x)
        K = np.maximum(self.eddies * f - self.viscosity, 0.0) / self.schmidt
        uphill = np.where((K > 0.0)[:, None], self.eddies / self.schmidt * gradient, 0.0)
        return K, uphill[:, : self.dim]

    def inside(self, x: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Return points x mirrored at the faces of the box; points in an obstacle are replaced by `before`."""
        x = self.extent - np.abs(self.extent - np.abs(x) % (2.0 * self.extent))
        cells = tuple(np.floor(x / self.dx).astype(int).T + 1)
        return np.where((self.distance[cells] > 0.0)[:, None], x, before)

    def starts(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Return n random points (n, dim) [m], uniform over the air."""
        air = np.argwhere(self.distance > 0.0) - 1
        return (air[rng.integers(len(air), size=n)] + rng.random((n, self.dim))) * self.dx

    def even(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean over the air and the Rayleigh quotient [1/m²] of the cosine along each axis, (dim,) each."""
        air = np.argwhere(self.distance > 0.0) - 1
        points = np.concatenate([air + 0.25, air + 0.75])  # a single cell has a variance too
        angle = pi * points * self.dx / self.extent
        slope = pi / self.extent * np.sin(angle)
        return np.cos(angle).mean(axis=0), (slope**2).mean(axis=0) / np.cos(angle).var(axis=0)


def particle_paths(flow: RoomFlow, rng: np.random.Generator, step: float, steps: int) -> np.ndarray:
    """Return the positions [m] of particles carried by a flow, every `step` [s], (steps + 1, AIRS, EACH, dim)."""
    n = AIRS * EACH
    x = flow.starts(n, rng)
    phase = np.repeat(rng.uniform(0.0, 2.0 * pi, (AIRS, len(flow.k))), EACH, axis=0)
    turns = {m: rng.standard_normal(AIRS) for m in flow.rolls}
    memory = np.exp(-step / flow.memory)
    places = [x]
    for s in range(steps):
        first = flow.velocity(x, phase + step * s * flow.frequency, _each(turns))
        turns = {
            m: memory * turn + np.sqrt(1.0 - memory**2) * rng.standard_normal(AIRS)
            for m, turn in turns.items()
        }
        ahead = flow.inside(x + step * first, x)
        second = flow.velocity(ahead, phase + step * (s + 1) * flow.frequency, _each(turns))
        K, uphill = flow.spreading(x)
        scatter = np.sqrt(2.0 * step * K)[:, None] * rng.standard_normal(x.shape)
        x = flow.inside(x + 0.5 * step * (first + second) + step * uphill + scatter, x)
        places.append(x)
    return np.array(places).reshape(steps + 1, AIRS, EACH, flow.dim)


def _each(turns: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    return {m: np.repeat(turn, EACH) for m, turn in turns.items()}


def rates(
    places: np.ndarray, step: float, extent: np.ndarray, even: tuple[np.ndarray, np.ndarray]
) -> tuple[float, float]:
    """Return the eddy diffusivity K [m²/s], mean over the axes, of particles at `places` (steps + 1, airs, each, dim)
    [m], and its standard error over the realisations (jackknife). step [s]; even: see `RoomFlow.even`.
    """
    mean, quotient = even
    cosines = np.cos(pi * places / extent) - mean
    all_airs = np.arange(cosines.shape[1])
    airs = len(all_airs)
    estimates = [_rate(cosines, step, quotient, all_airs[all_airs != out]) for out in (-1, *all_airs)]
    without = np.array(estimates[1:])
    error = np.sqrt((airs - 1) / airs * ((without - without.mean()) ** 2).sum())
    return float(estimates[0]), float(error)


def _rate(cosines: np.ndarray, step: float, quotient: np.ndarray, airs: np.ndarray) -> float:
    of = []
    for d, per_area in enumerate(quotient):
        series = cosines[..., d][:, airs]
        last = 2 * (len(series) - 1) // 3
        while last > 2 and _autocovariance(series, last) < LEAST * _autocovariance(series, 0):
            last = max(2, int(0.8 * last))
        first = last // 2
        decay = np.log(_autocovariance(series, first) / _autocovariance(series, last)) / (
            step * (last - first)
        )
        of.append(decay / per_area)
    return float(np.mean(of))


def _autocovariance(series: np.ndarray, lag: int) -> float:
    """Return the autocovariance of cosines (steps, ...) at a lag in steps."""
    return float((series[: len(series) - lag] * series[lag:]).mean())


def measured_diffusivity(flow: RoomFlow, rng: np.random.Generator) -> tuple[float, float]:
    """Return the eddy diffusivity K of a flow [m²/s] and its standard error, from simulated particles."""
    turning = flow.turning
    if not turning:
        return 0.0, 0.0
    longest = max(TURNS / turning, MEMORIES * flow.memory if any(flow.rolls.values()) else 0.0)
    step = STEP / turning
    steps = int(np.clip(longest / step, 60, MOST))
    return rates(particle_paths(flow, rng, step, steps), step, flow.extent, flow.even())
