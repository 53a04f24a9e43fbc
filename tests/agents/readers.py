"""What tests of gas maps share: robots that jump about and read numbers at random, and a log of it."""

import numpy as np
import taichi as ti

EXTENT = (2.0, 1.5)
TRIALS, COUNT = 2, 3


class Readers:
    """What a map sees of a swarm: those of trial k are the robots k count ..., in a wind of about 0.7 m/s."""

    def __init__(self, seed, trials=TRIALS, count=COUNT, extent=EXTENT):
        self.rng, self.extent = np.random.default_rng(seed), extent
        n = trials * count
        self.believed_position = ti.Vector.field(2, ti.f32, n)
        self.reading = ti.field(ti.f32, n)
        self.wind = ti.Vector.field(2, ti.f32, n)
        self.wind_known = ti.field(ti.i32, n)
        self.members = ti.field(ti.i32, (trials, count + 1))
        self.team_size = ti.field(ti.i32, trials)
        self.team_size.fill(count)
        self.members.fill(-1)
        for i in range(n):
            self.members[i // count, i % count] = i
        self.trial = np.arange(n) // count
        self.where = self.rng.uniform(0, extent, (n, 2))

    def wander(self):
        """Go on and read something."""
        n = len(self.where)
        self.where = np.clip(self.where + self.rng.normal(0, 0.1, self.where.shape), 0.0, self.extent)
        self.show(self.where, self.rng.exponential(20.0, n))
        self.wind.from_numpy(self.rng.normal((0.7, 0.0), 0.3, (n, 2)).astype(np.float32))
        self.wind_known.from_numpy((self.rng.random(n) < 0.8).astype(np.int32))

    def show(self, where, readings):
        """Be there, and read that."""
        self.believed_position.from_numpy(np.asarray(where, np.float32))
        self.reading.from_numpy(np.asarray(readings, np.float32))

    def rows(self, t):
        """(trial, x, y, reading, wind x, wind y, t) of each robot; no wind where it is not known."""
        wind = self.wind.to_numpy().astype(float) * self.wind_known.to_numpy()[:, None]
        where, reading = self.believed_position.to_numpy().astype(float), self.reading.to_numpy()
        return np.column_stack([self.trial, where, reading, wind, np.full(len(where), t)])


def centers(shape, cell):
    """Of the cells, (nx ny, 2)."""
    axes = [(np.arange(n) + 0.5) * cell for n in shape]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def same(ours, reference, rel=1e-5):
    """Equal to 1e-5 relative, and unknown in the same cells."""
    assert (np.isnan(ours) == np.isnan(reference)).all()
    np.testing.assert_allclose(ours, reference, rtol=rel)
