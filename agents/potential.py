"""Obstacle avoidance by artificial potential fields: driving to a way point among teammates, walls and obstacles.

Khatib, "Real-time obstacle avoidance for manipulators and mobile robots", Int. J. Robotics Research 5 (1986) 90-98,
doi:10.1177/027836498600500106, with an attraction of bounded strength; scales are our choice. At x, on the way to w,

    F = (w - x) / max(|w - x|, SOFT) + Σ k (1/d - 1/d0) / d² n,      k = d0³ / 4

summed over the robots of the trial, the moving obstacles and the nearest surface, if closer than d0; d: gap to the
robot [m], n: unit vector away. With this k the repulsion at d0/2 balances the full attraction. The robot turns to F;
its speed grows with its alignment to F.

A robot without progress for PATIENCE is in a local minimum: for a while the robot follows the tangent of the repulsion,
left and right in turn and each time for twice as long.
"""

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.swarm import Swarm, wrap
from taichi_plume.engine import ti

SOFT = 0.1  # m from the way point, within which the attraction fades
ROUNDING = 1e-5  # m
CLOSE = 0.005  # m, the smallest gap in the repulsion
STEER = 0.4  # s in which the robot tries to turn to its course
NEAR = 0.05  # m from the way point: distance that counts as arrival
PATIENCE = 3.0  # s without progress
WAY = 0.1  # of the distance that the robot could drive in PATIENCE; less is no progress
ESCAPE = 2.0  # s of the first escape
TRIES = 2  # escapes; if these fail, a way point counts as out of reach
PUSHES = 4  # corrections that move a way point out of obstacles


class Potential:
    """Potential-field commands for robots: call `set_out` with each new way point, then `drive` in each time step.

    parameters: must include the entries of `Potential.numbers`. Until the first `set_out`, `mark` is inf.
    """

    STATE = ("mark", "idle", "tries", "escape")

    def __init__(self, members: Members, parameters: Parameters):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        n = members.size
        self.mark = ti.filled_vectors(np.full((n, 2), np.inf))  # position at the last progress [m]
        self.idle = ti.field(ti.f32, n)  # time since then [s]
        self.tries = ti.field(ti.i32, n)  # escapes since `set_out`
        self.escape = ti.field(ti.f32, n)  # remaining time of the present escape [s]

    @staticmethod
    def numbers(swarm: Swarm, group: GroupRange, speed: float | None, avoidance: float) -> Numbers:
        """Return a group's kernel parameters; speed [m/s]: by default the body's largest; avoidance: distance d0 [m].

        Way points should be `room` [m] away from obstacles, or the repulsion would keep the robot from them; low, high:
        corners of this part of the floor [m].
        """
        room = group.model.body.radius + avoidance
        return {
            "speed": group.speed(speed),
            "room": room,
            "low": tuple(edge + room for edge in swarm.clearance.low),
            "high": tuple(edge - room for edge in swarm.clearance.high),
            "stiffness": avoidance**3 / 4,  # k
            "ease": float(np.float32(avoidance**3 / 4) * np.float32(1 / avoidance)),  # k / d0
            "least_way": WAY * group.speed(speed) * PATIENCE,  # m
            "row": group.row + np.arange(group.size) // group.count,  # of the trial among all
        }

    @ti.func
    def set_out(self, n):
        """Reset robot n's progress and escapes, at the start towards a new way point."""
        self.mark[n] = self.swarm.believed_position[self.robot[n]]
        self.idle[n], self.escape[n], self.tries[n] = 0.0, 0.0, 0

    @ti.func
    def is_over(self, n, goal, tolerance):
        """Return whether robot n is within `tolerance` [m] of its way point `goal`, or has given the way point up."""
        apart = self.swarm.believed_position[self.robot[n]] - goal
        return apart.norm() <= tolerance or self.is_stuck(n)

    @ti.func
    def is_stuck(self, n):
        """Return whether robot n has given up its way point after too many escapes."""
        return self.tries[n] > TRIES

    @ti.func
    def low(self, n):
        """Return the lower corner (2,) [m] of the area in which robot n's way points may lie."""
        return ti.Vector([self.p.low[n, 0], self.p.low[n, 1]])

    @ti.func
    def high(self, n):
        """Return the upper corner (2,) [m] of the area in which robot n's way points may lie."""
        return ti.Vector([self.p.high[n, 0], self.p.high[n, 1]])

    @ti.func
    def clear(self, n, place):
        """Return the way point `place` [m] moved away from walls and obstacles, into robot n's area of way points."""
        low, high = self.low(n), self.high(n)
        w = ti.math.clamp(place, low, high)
        for _ in range(PUSHES):
            lacking = self.p.room[n] - self.swarm.clearance.distance(w)
            if lacking > ROUNDING:
                w += lacking * self.swarm.clearance.normal(w)
        return ti.math.clamp(w, low, high)

    @ti.func
    def drive(self, n, goal, dt: float):
        """Write the commands of robot n for the next time step of dt [s] towards the way point `goal` [m]."""
        i = self.robot[n]
        way = goal - self.swarm.believed_position[i]
        distance = way.norm()
        self._watch(n, distance, dt)
        attraction = way / ti.max(distance, SOFT)
        repulsion = self.swarm.as_believed(i, self._repulsion(n, i))
        if self.escape[n] > 0.0 and repulsion.norm() > 0.0:
            side = ti.select(self.tries[n] % 2 == 1, 1.0, -1.0)
            attraction = side * ti.Vector([-repulsion[1], repulsion[0]]) / repulsion.norm()
        force = attraction + repulsion
        error = wrap(ti.atan2(force[1], force[0]) - self.swarm.believed_heading[i])
        speed = ti.min(1.0, force.norm()) * ti.max(0.0, ti.cos(error)) * self.p.speed[n]  # type: ignore[misc]
        self.swarm.speed_command[i] = ti.min(speed, distance / dt)
        self.swarm.turn_rate_command[i] = error / self.swarm.turn_time(i, ti.max(dt, STEER))

    @ti.func
    def stand(self, n):
        """Command robot n to stop."""
        self.swarm.speed_command[self.robot[n]] = 0.0
        self.swarm.turn_rate_command[self.robot[n]] = 0.0

    @ti.func
    def _watch(self, n, distance, dt):
        """Detect whether robot n is in a local minimum (no progress for PATIENCE), and then start an escape."""
        x = self.swarm.believed_position[self.robot[n]]
        self.escape[n] = self.escape[n] - dt
        self.idle[n] = self.idle[n] + dt
        if distance < NEAR or self.escape[n] > 0.0 or (x - self.mark[n]).norm() > self.p.least_way[n]:
            self.mark[n] = x
            self.idle[n] = 0.0
        elif self.idle[n] >= PATIENCE:
            self.escape[n] = ESCAPE * 2.0 ** ti.min(self.tries[n], 10)
            self.tries[n] = self.tries[n] + 1
            self.idle[n] = 0.0

    @ti.func
    def _repulsion(self, n, i):
        """Return the sum (2,) of the repulsive forces on robot n of the algorithm, robot i of the swarm."""
        k = self.p.row[n]
        x, radius = self.swarm.position[i], self.swarm.radius[i]
        repulsion = self._strength(
            n, self.swarm.clearance.distance(x) - radius
        ) * self.swarm.clearance.normal(x)
        for m in range(self.swarm.team_size[k]):
            j = self.swarm.members[k, m]
            if j != i:
                repulsion += self._repulsion_from(
                    n, x - self.swarm.position[j], radius + self.swarm.radius[j]
                )
        for w in range(self.swarm.walker_count):
            repulsion += self._repulsion_from(n, x - self.swarm.discs[w], radius + self.swarm.disc_radius[w])
        return repulsion

    @ti.func
    def _repulsion_from(self, n, apart, radii):
        d = apart.norm()
        return self._strength(n, d - radii) * apart / ti.max(d, CLOSE)

    @ti.func
    def _strength(self, n, gap):
        d = ti.max(gap, CLOSE)
        return ti.max((self.p.stiffness[n] / d - self.p.ease[n]) / d**2, 0.0)
