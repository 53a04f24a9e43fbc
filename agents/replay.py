"""Robots that go the ways of recorded ones, and smell the simulated plume there.

WAITING    its recording has not begun: it is where its first pose is
REPLAYED   it is where it was recorded to be, between its poses linearly
ENDED      its recording is over: it is where its last pose was

Whatever stands there does not stop them. What the recorded robots read is compared with what these do: of every
recorded reading the simulated one of the tick in which it was made.
"""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from taichi_plume.agents.columns import Columns, Rows
from taichi_plume.agents.members import Members
from taichi_plume.agents.swarm import Swarm
from taichi_plume.files.bag_ways import Way
from taichi_plume.scenario.external import Replay

WAITING, REPLAYED, ENDED = range(3)
SUMS = ("n", "a", "b", "aa", "bb", "ab", "apart")  # of recorded readings a and simulated b


class ReplayAlgorithm:
    """Puts the robots of one group where those of `ways` were. tick: control period [s]."""

    PER_GROUP: bool = True
    STATE: tuple[str, ...] = ("sums",)
    STATE_NAMES: tuple[str, ...] = ("WAITING", "REPLAYED", "ENDED")

    def __init__(self, swarm: Swarm, members: Members, tick: float, ways: Sequence[Way]):
        self.members, self.tick, self.ways = members, tick, ways
        (group,) = members.groups
        flown = (Columns.ordered_altitude,) if group.model.body.flies else ()
        ordered = (Columns.state, Columns.ordered_position, Columns.ordered_heading, *flown)
        self._ordered = Rows(swarm, ordered, group.start, group.size)
        self._told = Rows(swarm, (Columns.reading,), group.start, group.size)
        self.begin()

    def begin(self) -> None:
        """Put the robots where they are at the end of the first tick."""
        (group,) = self.members.groups
        model = cast(Replay, group.model.algorithm)
        self.chosen = model.chosen(self.ways, group.count)
        self.zero, self.origin = model.begin_of(self.chosen), np.array(model.origin)
        self.sums = np.zeros((group.size, len(SUMS)))
        self._order(0.0, self.tick)

    def act(self, tick: int, t: float, dt: float) -> None:
        self._compare(t, dt)
        self._order(t, dt)

    def _order(self, t: float, dt: float) -> None:
        """Tell what the robots do at t [s], and where they are a tick of dt [s] later."""
        (group,) = self.members.groups
        now = self.zero + t
        late = now - 1e-6 * dt
        state = [
            WAITING if now < one.t[0] else REPLAYED if late <= one.t[-1] else ENDED for one in self.chosen
        ]
        poses = np.array([one.at(now + dt) for one in self.chosen])
        x, y, z, heading = np.tile(poses, (group.trials, 1)).T
        place, heading = np.stack([x, y], axis=-1) + self.origin, np.mod(heading + np.pi, 2 * np.pi) - np.pi
        flown = [z] if group.model.body.flies else []
        self._ordered.write([np.tile(state, group.trials), place, heading, *flown])

    def _compare(self, t: float, dt: float) -> None:
        """Add the readings that were recorded in the tick of dt [s] that ends at t [s]."""
        edges = self.zero + np.array([t - dt, t]) + 1e-6 * dt
        found = [slice(*np.searchsorted(one.read_at, edges)) for one in self.chosen]
        if not any(one.stop > one.start for one in found):
            return
        (group,) = self.members.groups
        (readings,) = self._told.read()
        for n, b in enumerate(readings.astype(float)):
            a = self.chosen[n % group.count].ppm[found[n % group.count]]
            pairs = (
                len(a),
                a.sum(),
                b * len(a),
                (a * a).sum(),
                b * b * len(a),
                b * a.sum(),
                np.abs(b - a).sum(),
            )
            self.sums[n] += pairs

    def recorded(self) -> dict[str, Any] | None:
        """How readings are beside those recorded, of the robots of each trial together; None where none was recorded.

        readings: how many; correlation; mae_ppm: mean distance; bias_ppm: by how much they are larger.
        """
        (group,) = self.members.groups
        n, a, b, aa, bb, ab, apart = self.sums.reshape(group.trials, group.count, -1).sum(axis=1).T
        if not n.any():
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = np.sqrt((n * aa - a * a) * (n * bb - b * b))
            correlation = np.where(spread > 0.0, (n * ab - a * b) / spread, np.nan)
            each = {"correlation": correlation, "mae_ppm": apart / n, "bias_ppm": (b - a) / n}
        return {"readings": int(n[0])} | {name: values.tolist() for name, values in each.items()}
