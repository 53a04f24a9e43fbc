"""Observations of a policy: values from -1 to 1 made of sensor readings, in each robot's own frame.

Observations never contain the truth: readings have sensor lag and noise, winds are measured, poses are believed. The
axes point ahead along the believed heading, and to the left. In a mirrored world left and right are swapped. An
observation is a row: the entries that the policy observes, in its order, then those of previous decisions (`history`).
"""

from collections.abc import Iterator, Sequence
from math import hypot
from typing import cast

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.lag import Lag
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.radio import NEVER, Radio, message_ticks
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin, log
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.robots import Group

DECADES = 6.0  # decades of ppm from 1 on, up to pure gas
KILO_OHM, DECADES_OF_OHM = 1e3, 4.0  # metal oxides lie within 1 kohm and 10 Mohm
HALF_TIME = 60.0  # s, mapped to one half
HALF_SPEED = 0.5  # m/s, mapped to one half: typical winds of rooms are below, of fans and outdoors above
PER_LN10 = 1.0 / float(np.log(10.0))
FARTHEST = 1e9  # m
HALF_AGE = 5.0  # s, age of a message that is mapped to one half


def of_a_mate(group: Group) -> tuple[str, ...]:
    """Return the names of the entries of a teammate."""
    return ("heard", "ahead", "left", *("above",) * group.body.flies, "gas")


def mates_of(group: Group) -> int:
    """Return the number of teammates that a policy observes."""
    most = cast(Policy, group.algorithm).neighbours
    return group.count - 1 if most is None else min(most, group.count - 1)


def action_names(group: Group) -> tuple[str, ...]:
    """Return the names of the components of an action of a group with a policy."""
    model = cast(Policy, group.algorithm)
    names = ("speed", "turn") if model.act == "drive" else ("ahead", "left")
    up = ("climb" if model.act == "drive" else "up",) * group.body.flies
    return (*names, *up, *("declare",) * model.declares)


def entries(group: Group) -> Iterator[tuple[str, str, float]]:
    """Yield kind, name and lower bound of each entry that a group's policy observes; the upper bound is 1."""
    model, sensors, mates = cast(Policy, group.algorithm), len(group.sensors.noses), mates_of(group)
    pairs: dict[str, Sequence[tuple[str, float]]] = {
        "gas": [("gas", 0.0)],
        "noses": [(f"gas of sensor {k}", 0.0) for k in range(1, sensors)],
        "memory": [(f"gas over {time:g} s", 0.0) for time in model.memory],
        "rise": [("rise", -1.0)],
        "resistance": [("resistance", 0.0)],
        "wind": [("upwind ahead", -1.0), ("upwind left", -1.0), ("wind speed", 0.0)],
        "bumper": [("bumper", 0.0)],
        "heading": [("heading cos", -1.0), ("heading sin", -1.0)],
        "position": [("position x", -1.0), ("position y", -1.0)],
        "height": [("height", 0.0)],
        "action": [(f"last {name}", -1.0) for name in action_names(group)],
        "clock": [("clock", 0.0)],
        "mates": [
            (f"mate {m} {name}", 0.0 if name in ("heard", "gas") else -1.0)
            for m in range(1, mates + 1)
            for name in of_a_mate(group)
        ],
    }
    for kind in model.observe:
        for name, low in pairs[kind]:
            yield kind, name, low


class Observation:
    """Observations of a group's learnt policy. tick: control period [s].

    names, low, high: names and bounds of the `size` components of an observation. Call `follow` in each control
    period, after the sensors; `write` at each decision, and `remember` its action; `clear` when a robot restarts.
    """

    STATE: tuple[str, ...] = ("averages", "before", "past", "action")

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.swarm, self.members, self.robot, self.tick = swarm, members, members.robot, tick
        (group,) = members.groups
        self.count, self.history = group.count, self.model.history
        sensors = len(group.model.sensors.noses)
        self.own = list(entries(group.model))
        self.others = tuple(getattr(swarm, f"reading_{k}") for k in range(1, sensors))
        self.width = len(self.own)
        self.size = self.width * self.history
        self.names = tuple(
            name if h == 0 else f"{name}, {h} decisions before"
            for h in range(self.history)
            for _, name, _ in self.own
        )
        self.low = np.tile(np.array([low for *_, low in self.own], np.float32), self.history)
        self.high = np.ones(self.size, np.float32)
        self.kinds = tuple(dict.fromkeys(kind for kind, *_ in self.own))
        self.begins = {
            kind: next(k for k, entry in enumerate(self.own) if entry[0] == kind) for kind in self.kinds
        }
        self.times, self.actions = len(self.model.memory), len(action_names(group.model))
        self.mates, self.of_a_mate, self.flies = (
            mates_of(group.model),
            len(of_a_mate(group.model)),
            group.model.body.flies,
        )
        self.talks = "mates" in self.kinds
        if self.talks:
            self.radio = Radio(members, Parameters(members, Radio.numbers, radio="radio"))
            self.radio.time.fill(NEVER)
            self.STATE = (*self.STATE, "radio")
        n = members.size
        self.averages = ti.field(ti.f32, (n, max(1, self.times)))  # running averages of the gas entry
        self.before = ti.field(ti.f32, n)  # gas entry at the last decision
        self.past = ti.field(ti.f32, (n, max(1, self.size - self.width)))  # earlier observations
        self.action = ti.field(ti.f32, (n, self.actions))  # last action
        self.low_corner, high = swarm.clearance.low, swarm.clearance.high
        self.extent = tuple(high[d] - self.low_corner[d] for d in range(2))
        self.diagonal = hypot(*self.extent)
        self.p = Parameters(members, self._numbers)

    @property
    def model(self) -> Policy:
        """Scenario section of the group's policy."""
        return cast(Policy, self.members.groups[0].model.algorithm)

    def _numbers(self, group: GroupRange) -> Numbers:
        shares = tuple(Lag(time, self.tick).share for time in self.model.memory) or (1.0,)
        return {"shares": shares, "every": message_ticks(group, self.tick)}

    @ti.func
    def gas(self, n):
        """Return robot n's gas reading on the logarithmic scale of observations, from 0 to 1."""
        return _of_gas(self.swarm.reading[self.robot[n]])

    @ti.func
    def clear(self, n):
        """Reset averages, past observations and last action of robot n."""
        self.before[n] = 0.0
        for k in range(self.times):
            self.averages[n, k] = 0.0
        for k in range(self.size - self.width):
            self.past[n, k] = 0.0
        for k in range(self.actions):
            self.action[n, k] = 0.0
        if ti.static(self.talks):
            self.radio.forget(n)

    @ti.func
    def send(self, n, tick):
        """Send robot n's gas entry and position to its team if due; tick: of the run. Then call `receive` for all."""
        if ti.static(self.talks):
            i = self.robot[n]
            now, _ = self.swarm.clock(i, tick, 0.0)
            self.radio.speaks[n] = 0
            if (now - 1) % self.p.every[n] == 0:
                height = 0.0
                if ti.static(self.flies):
                    height = self.swarm.altitude[i]
                self.radio.say(n, self.gas(n), ti.Vector([height, 0.0]))

    @ti.func
    def receive(self, n, tick, t):
        """Receive the messages to robot n; tick, t [s]: of the run."""
        if ti.static(self.talks):
            _, at = self.swarm.clock(self.robot[n], tick, t)
            for m in range(self.count):
                self.radio.receive(n, m, tick, at)

    @ti.func
    def remember(self, n, row, table: Template):
        """Store the last action of robot n, from row `row` of table (rows, actions)."""
        for k in range(self.actions):
            self.action[n, k] = ti.math.clamp(table[row, k], -1.0, 1.0)

    @ti.func
    def follow(self, n, dt):
        """Update the running averages of robot n's gas observation by the present reading."""
        if ti.static("memory" in self.kinds):
            gas = self.gas(n)
            for k in ti.static(range(self.times)):
                self.averages[n, k] = self.averages[n, k] + self.p.shares[n, k] * (gas - self.averages[n, k])

    @ti.func
    def write(self, n, flip, row, table: Template, elapsed, t=0.0):
        """Write the observation of robot n to a row of a table (rows, size).

        flip: -1 in a mirrored world, else 1. elapsed: time of the search so far [s]; t: time of the run [s].
        """
        rest = self.size - self.width
        for k in range(rest):
            table[row, self.width + k] = self.past[n, k]
        self._show(n, flip, row, table, elapsed, t)
        for k in range(rest - self.width):
            self.past[n, rest - 1 - k] = self.past[n, rest - 1 - k - self.width]
        for k in range(ti.min(rest, self.width)):
            self.past[n, k] = table[row, k]
        self.before[n] = self.gas(n)

    @ti.func
    def _show(self, n, flip, row, table: Template, elapsed, t):
        """Write the present entries of robot n's observation to row `row` of table; arguments as for `write`."""
        i = self.robot[n]
        gas, heading = self.gas(n), self.swarm.believed_heading[i]
        for kind in ti.static(self.kinds):
            at = ti.static(self.begins[kind])
            if ti.static(kind == "gas"):
                table[row, at] = gas
            elif ti.static(kind == "noses"):
                for k in ti.static(range(len(self.others))):
                    table[row, at + k] = _of_gas(self.others[k][i])
            elif ti.static(kind == "memory"):
                for k in ti.static(range(self.times)):
                    table[row, at + k] = self.averages[n, k]
            elif ti.static(kind == "rise"):
                table[row, at] = gas - self.before[n]
            elif ti.static(kind == "resistance"):
                table[row, at] = _resistance(self.swarm.resistance[i])
            elif ti.static(kind == "wind"):
                self._show_wind(self.swarm.wind[i], heading, flip, row, table, at)
            elif ti.static(kind == "bumper"):
                table[row, at] = ti.cast(self.swarm.blocked[i], ti.f32)
            elif ti.static(kind == "heading"):
                e = cos_sin(heading)
                table[row, at], table[row, at + 1] = e[0], flip * e[1]
            elif ti.static(kind == "position"):
                for d in ti.static(range(2)):
                    share_of = (self.swarm.believed_position[i][d] - self.low_corner[d]) / self.extent[d]
                    p = ti.math.clamp(2.0 * share_of - 1.0, -1.0, 1.0)
                    table[row, at + d] = p if ti.static(d == 0) else flip * p
            elif ti.static(kind == "height"):
                share = self.swarm.altitude[i] / self.swarm.clearance.layers.ceiling
                table[row, at] = ti.math.clamp(share, 0.0, 1.0)
            elif ti.static(kind == "action"):
                for k in ti.static(range(self.actions)):
                    table[row, at + k] = self.action[n, k]
            elif ti.static(kind == "clock"):
                table[row, at] = elapsed / (elapsed + HALF_TIME)
            else:
                _, now = self.swarm.clock(i, 0, t)
                self._show_mates(n, heading, flip, row, table, at, now)

    @ti.func
    def _show_wind(self, wind, heading, flip, row, table: Template, at: Template):
        """Write the upwind direction in the robot's frame and the scaled speed from column `at`; zeros if unknown."""
        speed = wind.norm()
        from_there = _in_frame(-wind, heading, flip) / ti.max(speed, 1e-9)
        table[row, at] = ti.math.clamp(from_there[0], -1.0, 1.0)
        table[row, at + 1] = ti.math.clamp(from_there[1], -1.0, 1.0)
        table[row, at + 2] = speed / (speed + HALF_SPEED)

    @ti.func
    def _show_mates(self, n, heading, flip, row, table: Template, at: Template, t):
        """Write the last messages of the nearest teammates from column `at`: age, relative position and gas entry;
        zeros for a teammate not heard yet.
        """
        i = self.robot[n]
        last, last_mate = -1.0, -1
        for k in ti.static(range(self.mates)):
            nearest, mate = FARTHEST, -1
            for m in range(self.count):
                if self.radio.has_heard(n, m):
                    away = (self.radio.sender[n, m] - self.swarm.believed_position[i]).norm()
                    if (away > last or (away == last and m > last_mate)) and away < nearest:
                        nearest, mate = away, m
            begin = ti.static(at + k * self.of_a_mate)
            for c in ti.static(range(self.of_a_mate)):
                table[row, begin + c] = 0.0
            if mate >= 0:
                apart = self.radio.sender[n, mate] - self.swarm.believed_position[i]
                place = _in_frame(apart, heading, flip) / self.diagonal
                table[row, begin] = HALF_AGE / (HALF_AGE + t - self.radio.time[n, mate])
                table[row, begin + self.of_a_mate - 1] = self.radio.value[n, mate]
                for d in ti.static(range(2)):
                    table[row, begin + 1 + d] = ti.math.clamp(place[d], -1.0, 1.0)
                if ti.static(self.flies):
                    above = self.radio.place[n, mate][0] - self.swarm.altitude[i]
                    table[row, begin + 3] = ti.math.clamp(
                        above / self.swarm.clearance.layers.ceiling, -1.0, 1.0
                    )
            last, last_mate = nearest, mate


@ti.func
def _in_frame(v, heading, flip):
    """Return the components of vector v ahead and to the left of a robot; flip: -1 in a mirrored world, else 1."""
    e = cos_sin(heading)
    return ti.Vector([v[0] * e[0] + v[1] * e[1], flip * (v[1] * e[0] - v[0] * e[1])])


@ti.func
def _of_gas(reading):
    """Return a gas reading [ppm] on a logarithmic scale from 0 to 1."""
    return ti.math.clamp(log(1.0 + ti.max(reading, 0.0)) * (PER_LN10 / DECADES), 0.0, 1.0)


@ti.func
def _resistance(ohm):
    """Return a metal oxide's resistance [ohm] on a logarithmic scale from 0 to 1; 0 without such a sensor."""
    scaled = ti.math.clamp(log(ti.max(ohm, KILO_OHM) / KILO_OHM) * (PER_LN10 / DECADES_OF_OHM), 0.0, 1.0)
    return scaled if ohm > 0.0 else 0.0
