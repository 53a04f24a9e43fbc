"""Surge-cast: straight upwind while in the plume, widening crosswind casts when the plume is lost.

After Lochmatter & Martinoli, "Theoretical analysis of three bio-inspired plume tracking algorithms", ICRA 2009,
doi:10.1109/ROBOT.2009.5152521. FIND, UPWIND, U, V and s as in `tracking`.

SURGE  drive along U; out of the plume for lost_distance: CAST
CAST   along s V to cast_distance from where the plume was lost, then as far to the other side; each pair of legs goes
       twice as far; after PAIRS of them, or when blocked on both sides, FIND
"""

from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.tracking import FIND, PlumeTracker
from taichi_plume.engine import ti
from taichi_plume.scenario import algorithms

SURGE, CAST = range(2, 4)

PAIRS = 3  # pairs of path segments without gas before the search restarts


class SurgeCast(PlumeTracker):
    """Search algorithm that surges upwind in the plume and casts with growing width. tick: control period [s]."""

    STREAM = "surge_cast"
    STATE: tuple[str, ...] = (*PlumeTracker.STATE, "leg", "length")
    STATE_NAMES: tuple[str, ...] = ("FIND", "UPWIND", "SURGE", "CAST")
    DECISIONS: tuple[Decision, ...] = (
        *PlumeTracker.DECISIONS,
        Decision("cast_m", "m", "length of the last sweep across the wind", "length", none=0.0),
        Decision("cast_segment", "1", "number of the path segment in the last cast, from 0 on", "leg"),
    )

    def _allocate(self) -> None:
        super()._allocate()
        self.leg = ti.field(ti.i32, self.size)  # number of the path segment in the cast, from 0 on
        self.length = ti.field(ti.f32, self.size)  # length of the path segment [m]

    def numbers(self, group: GroupRange, model: algorithms.SurgeCast) -> Numbers:
        return {**super().numbers(group, model), "cast_distance": model.cast_distance}  # m

    @ti.func
    def _course(self, n):
        course = self._finding_course(n)
        if self.swarm.state[self.robot[n]] == SURGE:
            course = self.upwind[n]
        return course

    @ti.func
    def _decide(self, n, dt):
        state = self.swarm.state[self.robot[n]]
        if state == SURGE:
            if not self._still_smells(n) and (
                self._driven(n) >= self.p.lost_distance[n] or self.bump[n] == 1
            ):
                self.leg[n], self.length[n] = 0, self.p.cast_distance[n]
                self._enter(n, CAST)
        elif self._comes_upon_plume(n):
            self._enter(n, SURGE)
        elif state == CAST:
            if self.bump[n] == 1 or self._driven(n) >= self.length[n]:
                self.leg[n] += 1
                self.side[n] = -self.side[n]
                # back to the middle, and to the other side as far, or twice as far
                here = self.p.cast_distance[n] * (1 << ((self.leg[n] - 1) // 2))
                there = self.p.cast_distance[n] * (1 << (self.leg[n] // 2))
                self.length[n] = here + there
                self._enter(n, ti.select(self.leg[n] >= 2 * PAIRS, FIND, CAST))
        else:
            self._find(n)
