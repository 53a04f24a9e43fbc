"""Casting: upwind at an angle while in the plume, crosswind sweeps when the plume is lost.

After Lochmatter & Martinoli, "Tracking odor plumes in a laminar wind field with bio-inspired algorithms", ISER 2008.
FIND, UPWIND, U, V and s as in `tracking`.

IN_PLUME  drive along U turned by upwind_angle towards s; out of the plume for lost_distance: other side,
          LOST; blocked for PATIENCE: in the plume SIDESTEP, out of it other side, LOST
LOST      sweep along s V, back to where the plume was; after cast_distance, or blocked: other side, twice as
          far; after CASTS sweeps FIND
SIDESTEP  along s V by lost_distance, then IN_PLUME; blocked for PATIENCE: other side
"""

from math import cos, radians, sin

from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.tracking import FIND, PATIENCE, PlumeTracker
from taichi_plume.engine import ti
from taichi_plume.scenario import algorithms

IN_PLUME, LOST, SIDESTEP = range(2, 5)

CASTS = 4  # failed sweeps before the search restarts


class Casting(PlumeTracker):
    """Search algorithm: obliquely upwind in the plume, crosswind casts out of it. tick: control period [s]."""

    STREAM = "casting"
    STATE: tuple[str, ...] = (*PlumeTracker.STATE, "cast", "failed")
    STATE_NAMES: tuple[str, ...] = ("FIND", "UPWIND", "IN_PLUME", "LOST", "SIDESTEP")
    DECISIONS: tuple[Decision, ...] = (
        *PlumeTracker.DECISIONS,
        Decision("cast_m", "m", "length of the last sweep across the wind", "cast", none=0.0),
        Decision("failed_casts", "1", "number of sweeps without gas since the plume was lost", "failed"),
    )

    def _allocate(self) -> None:
        super()._allocate()
        self.cast = ti.field(ti.f32, self.size)  # length of the present sweep [m]
        self.failed = ti.field(ti.i32, self.size)  # sweeps without gas

    def numbers(self, group: GroupRange, model: algorithms.Casting) -> Numbers:
        angle = radians(model.upwind_angle_deg)
        return {
            **super().numbers(group, model),
            "along": cos(angle),  # component of the course in the plume along U
            "across": sin(angle),  # component along s V
            "cast_distance": model.cast_distance,  # m
        }

    @ti.func
    def _course(self, n):
        course = self._finding_course(n)
        if self.swarm.state[self.robot[n]] == IN_PLUME:
            U = self.upwind[n]
            V = ti.Vector([-U[1], U[0]])
            course = self.p.along[n] * U + self.side[n] * self.p.across[n] * V
        return course

    @ti.func
    def _decide(self, n, dt):
        state = self.swarm.state[self.robot[n]]
        if state == IN_PLUME:
            smells = self._still_smells(n)
            blocked = self.stuck[n] > PATIENCE
            if not smells and (blocked or self._driven(n) >= self.p.lost_distance[n]):
                self.side[n] = -self.side[n]
                self.cast[n] = self.p.cast_distance[n]
                self.failed[n] = 0
                self._enter(n, LOST)
            elif blocked:
                self._enter(n, SIDESTEP)
        elif state == SIDESTEP:
            c = self.swarm.reading[self.robot[n]]
            self.peak[n], self.trough[n] = ti.max(self.peak[n], c), c
            if self._driven(n) >= self.p.lost_distance[n]:
                self._enter(n, IN_PLUME)
            elif self.stuck[n] > PATIENCE:
                self.side[n] = -self.side[n]
                self._enter(n, SIDESTEP)
        elif self._comes_upon_plume(n):
            self._enter(n, IN_PLUME)
        elif state == LOST:
            if self.bump[n] == 1 or self._driven(n) >= self.cast[n]:
                self.side[n] = -self.side[n]
                self.cast[n] *= 2.0
                self.failed[n] += 1
                self._enter(n, ti.select(self.failed[n] >= CASTS, FIND, LOST))
        else:
            self._find(n)
