"""What tests of gas maps share: robots that jump about and read numbers at random, and a log of it."""

import numpy as np

from taichi_plume.agents.gas_map import Floor
from taichi_plume.engine import ti

EXTENT = (2.0, 1.5)
TRIALS, COUNT = 2, 3
TICK = 0.5


class Readers:
    """What a map sees of a swarm: those of trial k are the robots k count ..., in a wind of about 0.7 m/s."""

    def __init__(self, trials, count):
        self.trials, self.count = trials, count
        n = trials * count
        self.believed_position = ti.vector_field(2, ti.f32, n)
        self.reading = ti.field(ti.f32, n)
        self.wind = ti.vector_field(2, ti.f32, n)
        self.wind_known = ti.field(ti.i32, n)
        self.team_size = ti.field(ti.i32, trials)
        robots = np.full((trials, count + 1), -1)
        robots[:, :count] = np.arange(n).reshape(trials, count)
        self.members = ti.filled(robots)
        self.trial = np.arange(n) // count

    def begin(self, seed, extent=EXTENT):
        """Somewhere on the floor, all of them."""
        self.rng, self.extent = np.random.default_rng(seed), extent
        n = self.trials * self.count
        self.where = self.rng.uniform(0, extent, (n, 2))
        self.believed, self.readings = np.zeros((n, 2), np.float32), np.zeros(n, np.float32)
        self.felt, self.known = np.zeros((n, 2), np.float32), np.zeros(n, np.int32)
        self.teams(*[self.count] * self.trials)
        return self

    def teams(self, *sizes):
        """Let only the first so many of each trial be there."""
        self.sizes = sizes
        self._tell()

    def _tell(self):
        self.believed_position.from_numpy(self.believed)
        self.reading.from_numpy(self.readings)
        self.wind.from_numpy(self.felt)
        self.wind_known.from_numpy(self.known)
        self.team_size.from_numpy(self.sizes)

    def wander(self):
        """Go on and read something."""
        n = len(self.where)
        self.where = np.clip(self.where + self.rng.normal(0, 0.1, self.where.shape), 0.0, self.extent)
        readings = self.rng.exponential(20.0, n)
        self.felt = self.rng.normal((0.7, 0.0), 0.3, (n, 2)).astype(np.float32)
        self.known = (self.rng.random(n) < 0.8).astype(np.int32)
        self.show(self.where, readings)

    def show(self, where, readings):
        """Be there, and read that; of one trial also by fewer of its robots, the first ones."""
        if len(readings) < self.trials * self.count:
            self.sizes = (len(readings),)
        self.believed[: len(readings)], self.readings[: len(readings)] = where, readings
        self._tell()

    def rows(self, t):
        """(trial, x, y, reading, wind x, wind y, t) of each robot; no wind where it is not known."""
        wind = self.felt.astype(float) * self.known[:, None]
        return np.column_stack(
            [self.trial, self.believed.astype(float), self.readings, wind, np.full(len(self.where), t)]
        )


class Stock:
    """Readers and maps of tests."""

    def robots(self, seed, trials=TRIALS, count=COUNT, extent=EXTENT):
        return Readers(trials, count).begin(seed, extent)

    def map(self, kind, model, floor=None):
        return kind(model, floor or Floor(EXTENT, TRIALS, COUNT + 1, TICK))


def feed(gas_map, robots, ticks, dt):
    """Let the robots wander and the map take it in; returns all rows that it was shown."""
    rows = []
    for tick in range(1, 1 + ticks):
        robots.wander()
        gas_map.update(robots, tick * dt, dt)
        rows.append(robots.rows(tick * dt))
    return np.concatenate(rows)


def centers(shape, cell):
    """Of the cells, (nx ny, 2)."""
    axes = [(np.arange(n) + 0.5) * cell for n in shape]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def same(ours, reference, rel=1e-5):
    """Equal to 1e-5 relative, and unknown in the same cells."""
    assert (np.isnan(ours) == np.isnan(reference)).all()
    np.testing.assert_allclose(ours, reference, rtol=rel)
