"""Actions of a learnt policy: values from -1 to 1 for speed and turn rate, or for a way point.

drive     speed (1 + a0)/2 and turn rate a1, as fractions of the body's largest; a1 > 0 turns left
waypoint  the point a0 ahead and a1 to the left, times `step`: turn to it, drive to it, wait there
climb     of drones, an additional value a2: climb rate, as a fraction of the body's largest upward or downward speed;
          with waypoint the point is a2 times `step` above the drone, which flies there straight
declare   an additional value; above 0.5 the robot declares a source at its position

An action holds until the next decision. In a mirrored world left and right are swapped.
"""

from math import pi
from typing import cast

from taichi_plume.agents.members import Members
from taichi_plume.agents.observation import action_names
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.swarm import Swarm, wrap
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.policy import Policy

WORD = 0.5  # threshold of the last component, above which the robot declares a source
NEAR = 1e-3  # m, tolerance of way points


class Commands:
    """Conversion of a policy's actions, of `size` components `names`, to motion commands. tick: control period [s]."""

    STATE: tuple[str, ...] = ("held", "goal")

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.swarm, self.members, self.robot = swarm, members, members.robot
        group = members.groups[0].model
        model, self.flies = cast(Policy, group.algorithm), group.body.flies
        self.names = action_names(group)
        self.size, self.drives, self.declares = len(self.names), model.act == "drive", model.declares
        self.p = Parameters(members, lambda group: {"step": float(cast(Policy, group.model.algorithm).step)})
        self.held = ti.vector_field(2, ti.f32, members.size)  # speed and turn rate over their limits
        if self.flies:
            # climb rate over its limit, or altitude of the way point [m]
            self.up = ti.filled(swarm.altitude[members.robot.to_numpy()] * (not self.drives), ti.f32)
            self.STATE = (*self.STATE, "up")
        # believed place of the way point [m]
        self.goal = ti.filled_vectors(swarm.believed_position[members.robot.to_numpy()])

    @ti.func
    def clear(self, n):
        """Reset the actions of robot n and let the robot stand."""
        i = self.robot[n]
        self.held[n] = ti.Vector([0.0, 0.0])
        self.goal[n] = self.swarm.believed_position[i]
        self.swarm.speed_command[i], self.swarm.turn_rate_command[i] = 0.0, 0.0
        if ti.static(self.flies):
            self.up[n] = 0.0 if ti.static(self.drives) else self.swarm.altitude[i]

    @ti.func
    def take(self, n, flip, row, table: Template, t):
        """Store the action of robot n, row `row` of table (rows, size), at time t [s]; flip: -1 if mirrored, else 1."""
        i = self.robot[n]
        a, b = ti.math.clamp(table[row, 0], -1.0, 1.0), flip * ti.math.clamp(table[row, 1], -1.0, 1.0)
        if ti.static(self.drives):
            self.held[n] = ti.Vector([0.5 * (1.0 + a), b])
        else:
            e = cos_sin(self.swarm.believed_heading[i])
            way = self.p.step[n] * ti.Vector([a * e[0] - b * e[1], a * e[1] + b * e[0]])
            self.goal[n] = self.swarm.believed_position[i] + way
        if ti.static(self.flies):
            c = ti.math.clamp(table[row, 2], -1.0, 1.0)
            self.up[n] = c if ti.static(self.drives) else self.swarm.altitude[i] + self.p.step[n] * c
        if ti.static(self.declares):
            if table[row, self.size - 1] > WORD:
                self.swarm.declare(i, self.swarm.believed_position[i], t)

    @ti.func
    def carry_out(self, n, dt):
        """Write speed and turn rate commands of robot n for the next dt [s] by its last action."""
        i = self.robot[n]
        speed, turn = self.held[n][0] * self.swarm.max_speed[i], self.held[n][1] * self.swarm.max_turn_rate[i]
        if ti.static(not self.drives):
            apart = self.goal[n] - self.swarm.believed_position[i]
            distance = apart.norm()
            speed, turn = 0.0, 0.0
            if distance > NEAR:
                off = wrap(ti.atan2(apart[1], apart[0]) - self.swarm.believed_heading[i])
                turn = off / self.swarm.turn_time(i, dt)
                if ti.abs(off) < 0.25 * pi:  # else the robot first turns
                    speed = ti.min(distance / dt, self.swarm.max_speed[i] * ti.cos(off))
        self.swarm.speed_command[i], self.swarm.turn_rate_command[i] = speed, turn
        if ti.static(self.flies):
            if ti.static(self.drives):
                up = self.up[n]
                most = ti.select(up > 0.0, self.swarm.max_climb[i], self.swarm.max_descent[i])
                self.swarm.climb_command[i] = up * most
            else:
                goal = self.goal[n]
                self.swarm.goal[i] = ti.Vector([goal[0], goal[1], self.up[n]])
