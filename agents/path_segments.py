"""Path segments ("legs"): turn on the spot, drive a length; after a collision back off, turn aside, drive the rest.

Used by SPIRAL, E. coli, infotaxis and the random walk. The reaction to a collision follows Ferri et al., Robotics and
Autonomous Systems 57 (2009) 393-402: back off, rotate by 90°, drive the remaining distance.
"""

from math import pi

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.swarm import wrap
from taichi_plume.engine import ti

REST, TURN, DRIVE, BACK = range(4)

BACK_OFF = 0.1  # m
MOST_BUMPS = 6  # collisions on a path segment; one more ends the segment
NEAR = 1e-4  # m and rad: tolerance at the end of a segment
NEAR_AS_BELIEVED = 2e-3  # rad, least tolerance of robots that do not know their heading exactly


class Legs:
    """Path segments of robots: call `set_out` once, then `advance` in each time step until it returns False.

    parameters: must include the entries of `Legs.numbers`; robots turn as fast as their bodies can.
    """

    STATE = ("phase", "course", "length", "mark", "aside", "bumps")

    def __init__(self, members: Members, parameters: Parameters):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        n = members.size
        self.phase = ti.field(ti.i32, n)
        self.course = ti.field(ti.f32, n)  # heading to turn to [rad]
        self.length = ti.field(ti.f32, n)  # distance to drive [m]
        self.mark = ti.field(ti.f32, n)  # odometer at the start of the phase [m]
        self.aside = ti.field(ti.f32, n)  # +1: to the left after a collision, -1: to the right
        self.bumps = ti.field(ti.i32, n)  # collisions on this path segment

    @staticmethod
    def numbers(group: GroupRange, speed: float | None) -> Numbers:
        """Return a group's parameters of path segments; speed: driving speed [m/s], by default the body's largest."""
        by = group.model.localization
        near = NEAR if by is None else max(NEAR_AS_BELIEVED, by.heading_scatter)
        return {"speed": group.speed(speed), "near": near}

    @ti.func
    def set_out(self, n, turn, length, aside):
        """Start a path segment of robot n: turn by `turn` [rad], drive `length` [m]. aside: side to which the robot
        turns after a collision, +1 left, -1 right.
        """
        self.course[n] = wrap(self.swarm.believed_heading[self.robot[n]] + turn)
        self.length[n], self.aside[n] = length, aside
        self.bumps[n] = 0
        self.phase[n] = TURN

    @ti.func
    def advance(self, n, dt: float):
        """Write robot n's commands for the next time step dt [s]; return False when the path segment is completed."""
        i = self.robot[n]
        driven = self.swarm.odometer[i] - self.mark[n]
        bump = self.swarm.blocked[i] == 1
        if self.phase[n] == DRIVE:
            if bump:
                self.bumps[n] += 1
                self.length[n] = ti.max(self.length[n] - driven, 0.0)
                self._enter(n, ti.select(self.bumps[n] > MOST_BUMPS, REST, BACK))
            elif driven > self.length[n] - NEAR:
                self._enter(n, REST)
        elif self.phase[n] == BACK and (bump or driven > BACK_OFF - NEAR):
            self.course[n] = wrap(self.swarm.believed_heading[i] + 0.5 * pi * self.aside[n])
            self._enter(n, TURN)
        off = wrap(self.course[n] - self.swarm.believed_heading[i])
        if self.phase[n] == TURN and ti.abs(off) < self.p.near[n]:
            self._enter(n, DRIVE)
        speed, turn = 0.0, 0.0
        driven = self.swarm.odometer[i] - self.mark[n]
        if self.phase[n] == TURN:
            turn = off / self.swarm.turn_time(i, dt)
        elif self.phase[n] == DRIVE:
            speed = ti.min(self.p.speed[n], (self.length[n] - driven) / dt)
        elif self.phase[n] == BACK:
            speed = -ti.min(self.p.speed[n], (BACK_OFF - driven) / dt)
        self.swarm.speed_command[i], self.swarm.turn_rate_command[i] = speed, turn
        return self.phase[n] != REST

    @ti.func
    def _enter(self, n, phase):
        self.phase[n] = phase
        self.mark[n] = self.swarm.odometer[self.robot[n]]
