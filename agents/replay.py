"""Replay: robots that repeat recorded paths, and measure the simulated plume there.

WAITING    the recording has not started: the robot stays at its first pose
REPLAYED   the robot is at its recorded pose, interpolated linearly
ENDED      the recording is over: the robot stays at its last pose

Obstacles do not stop these robots. Each recorded reading is compared with the simulated reading of that time step.
"""

from collections.abc import Sequence
from typing import cast

import numpy as np

from taichi_plume.agents.columns import Columns, Rows
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.members import Members
from taichi_plume.agents.swarm import Swarm
from taichi_plume.files.trajectories import Way, begin_of, chosen
from taichi_plume.scenario.external import Replay

WAITING, REPLAYED, ENDED = range(3)
SUMS = ("n", "a", "b", "aa", "bb", "ab", "apart")  # sums of recorded readings a and simulated readings b


class ReplayAlgorithm:
    """Algorithm that moves a group's robots along recorded paths. tick: control period [s]; ways: in the domain."""

    PER_GROUP: bool = True
    STATE: tuple[str, ...] = ("sums",)
    STATE_NAMES: tuple[str, ...] = ("WAITING", "REPLAYED", "ENDED")
    DECISIONS: tuple[Decision, ...] = ()

    def __init__(self, swarm: Swarm, members: Members, tick: float, ways: Sequence[Way]):
        self.members = members
        (group,) = members.groups
        flown = (Columns.ordered_altitude,) if group.model.body.flies else ()
        ordered = (Columns.state, Columns.ordered_position, Columns.ordered_heading, *flown)
        self._ordered = Rows(swarm, ordered, group.start, group.size)
        self._told = Rows(swarm, (Columns.measured,), group.start, group.size)
        model = cast(Replay, group.model.algorithm)
        self.chosen = chosen(model, ways, group.count)
        self.zero = begin_of(model, self.chosen)
        self.sums = np.zeros((group.size, len(SUMS)))
        self._order(0.0, tick)

    def act(self, tick: int, t: float, dt: float) -> None:
        self._compare(t, dt)
        self._order(t, dt)

    def _order(self, t: float, dt: float) -> None:
        """Write the robots' states at time t [s], and order their recorded poses at t + dt [s]."""
        (group,) = self.members.groups
        now = self.zero + t
        late = now - 1e-6 * dt
        state = [
            WAITING if now < way.t[0] else REPLAYED if late <= way.t[-1] else ENDED for way in self.chosen
        ]
        poses = np.array([way.at(now + dt) for way in self.chosen])
        x, y, z, heading = np.tile(poses, (group.trials, 1)).T
        place, heading = np.stack([x, y], axis=-1), np.mod(heading + np.pi, 2 * np.pi) - np.pi
        flown = [z] if group.model.body.flies else []
        self._ordered.write([np.tile(state, group.trials), place, heading, *flown])

    def _compare(self, t: float, dt: float) -> None:
        """Add to `sums` the readings recorded from t - dt to t [s] and the simulated readings at t."""
        edges = self.zero + np.array([t - dt, t]) + 1e-6 * dt
        recorded_rows = [slice(*np.searchsorted(way.read_at, edges)) for way in self.chosen]
        if not any(rows.stop > rows.start for rows in recorded_rows):
            return
        (group,) = self.members.groups
        (readings,) = self._told.read()
        for n, b in enumerate(readings.astype(float)):
            a = self.chosen[n % group.count].ppm[recorded_rows[n % group.count]]
            squares = (a * a).sum(), b * b * len(a), b * a.sum()
            self.sums[n] += (len(a), a.sum(), b * len(a), *squares, np.abs(b - a).sum())

    def recorded(self) -> dict[str, int | list[float]] | None:
        """Return lists over trials that compare simulated with recorded readings; None without recorded readings.

        readings: number of readings; correlation; mae_ppm: mean absolute error; bias_ppm: mean error of the simulation.
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
