"""Casting in space, for drones: surge upwind in the plume, cast across the wind when the plume is lost.

A moth counter-turns both horizontally and vertically while it follows a plume; Rutkowski, Edwards, Willis, Quinn &
Causey, "Moth-inspired plume tracking strategies in three-dimensions", ICRA 2005, and Rutkowski, Willis & Quinn,
"Simulated odor tracking in a plane normal to the wind direction", ICRA 2006, make robots do so. Here the casts are the
arms of a square spiral in the plane across the wind, around the position where the plume was lost: our choice, like the
widening casts of surge-cast in two directions. U, V and s as in `tracking`, Z upward, r = ±1: sense of vertical motion.

FIND    sweep along s V until blocked, then RISE
RISE    along r Z by find_rise, then FIND on the other side; at the lowest or highest altitude, or blocked, r changes:
        UPWIND
UPWIND  step along U by find_step, then FIND on the other side; when blocked, later steps go the other way
SURGE   fly along U; out of the plume for lost_distance, or out of it and blocked: CAST
CAST    along s V, r Z, -s V, -r Z by cast_distance and cast_rise, then twice as far, three times as far ...; what is
        blocked, or at the lowest or highest altitude, is cut short; after `turns` of these FIND

The drone keeps its heading: it flies in any direction.
"""

from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.tracking import FIND, UPWIND, PlumeTracker
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin
from taichi_plume.scenario import algorithms

SURGE, CAST, RISE = range(2, 5)


class Casting3D(PlumeTracker):
    """Search algorithm for drones that casts horizontally and vertically. tick: control period [s]."""

    STREAM = "casting_3d"
    STATE: tuple[str, ...] = (*PlumeTracker.STATE, "leg", "rise")
    STATE_NAMES: tuple[str, ...] = ("FIND", "UPWIND", "SURGE", "CAST", "RISE")
    DECISIONS: tuple[Decision, ...] = (
        *PlumeTracker.DECISIONS,
        Decision("cast_segment", "1", "number of the path segment in the last cast, from 0 on", "leg"),
        Decision("vertical_sense", "1", "last vertical motion: 1 upward, -1 downward", "rise", none=0.0),
    )

    def _allocate(self) -> None:
        super()._allocate()
        self.leg = ti.field(ti.i32, self.size)  # number of the path segment in the cast, from 0 on
        self.rise = ti.field(ti.f32, self.size)  # r; 0 before the first rise, which is upward

    def numbers(self, group: GroupRange, model: algorithms.Casting3D) -> Numbers:
        return {
            **super().numbers(group, model),
            "cast_distance": model.cast_distance,  # m
            "cast_rise": model.cast_rise,  # m
            "find_rise": model.find_rise,  # m
            "legs": 4 * model.turns,
            "lowest": model.lowest,  # m
            "highest": model.highest,  # m
        }

    @ti.func
    def _upward(self, n):
        """Return the sense r of vertical motion of drone n: 1 upward, -1 downward."""
        return ti.select(self.rise[n] < 0.0, -1.0, 1.0)

    @ti.func
    def _way(self, n):
        """Return the unit vector (3,) along which drone n intends to fly in its present state."""
        U = self.upwind[n]
        across = self.side[n] * ti.Vector([-U[1], U[0]])
        along, up = across, 0.0  # FIND
        state = self.swarm.state[self.robot[n]]
        if state == UPWIND:
            along = self.step_sign[n] * U
        elif state == SURGE:
            along = U
        elif state == RISE:
            along, up = 0.0 * U, self._upward(n)
        elif state == CAST:
            there = ti.select(self.leg[n] % 4 < 2, 1.0, -1.0)
            if self.leg[n] % 2 == 0:
                along = there * across
            else:
                along, up = 0.0 * U, there * self._upward(n)
        return ti.Vector([along[0], along[1], up])

    @ti.func
    def _feel_bumper(self, n, dt):
        """Update the collision flag of drone n; reaching the lowest or highest altitude counts as a collision."""
        i = self.robot[n]
        up, z = self._way(n)[2], self.swarm.altitude[i]
        ends = (up > 0.0 and z >= self.p.highest[n]) or (up < 0.0 and z <= self.p.lowest[n])
        self.stuck[n] = ti.select(self.swarm.blocked[i] == 1, self.stuck[n] + dt, 0.0)
        # a first collision on a path segment may be with the obstacle that ended the previous segment
        self.bump[n] = ti.cast(self.stuck[n] > 1.5 * dt or ends, ti.i32)

    @ti.func
    def _decide(self, n, dt):
        state, bump = self.swarm.state[self.robot[n]], self.bump[n] == 1
        if state == SURGE:
            if not self._still_smells(n) and (bump or self._driven(n) >= self.p.lost_distance[n]):
                self.leg[n] = 0
                self._enter(n, CAST)
        elif self._comes_upon_plume(n):
            self._enter(n, SURGE)
        elif state == CAST:
            step = ti.select(self.leg[n] % 2 == 0, self.p.cast_distance[n], self.p.cast_rise[n])
            if bump or self._driven(n) >= step * (self.leg[n] // 2 + 1):
                self.leg[n] += 1
                self._enter(n, ti.select(self.leg[n] >= self.p.legs[n], FIND, CAST))
        elif state == FIND:
            if bump:
                self.side[n] = -self.side[n]
                self._enter(n, RISE)
        elif state == RISE:
            if bump:
                self.rise[n] = -self._upward(n)
                self._enter(n, UPWIND)
            elif self._driven(n) >= self.p.find_rise[n]:
                self._enter(n, FIND)
        elif bump or self._driven(n) >= self.p.find_step[n]:
            if bump:
                self.step_sign[n] = -self.step_sign[n]
            self._enter(n, FIND)

    @ti.func
    def _steer(self, n, dt):
        """Set the velocity commands of drone n along its intended direction; the heading stays constant."""
        i = self.robot[n]
        way, e = self.p.speed[n] * self._way(n), cos_sin(self.swarm.believed_heading[i])
        self.swarm.speed_command[i] = way[0] * e[0] + way[1] * e[1]
        self.swarm.left_command[i] = way[1] * e[0] - way[0] * e[1]
        self.swarm.climb_command[i] = way[2]
