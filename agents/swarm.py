"""All robots: where they are, what they read, and how they move without ever touching anything.

A body is an upright disc that drives like a unicycle. Per tick it moves along the chord of its arc; contact
cuts the move short and the rest of it slides along the obstacle. Robots of one trial move one after the
other, so that each sees where the ones before it are now; robots of different trials neither see nor touch
each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.odometry import Odometry
from taichi_plume.grid.rng import generator
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.obstacles import Box, Obstacle, motion_of
from taichi_plume.scenario.robots import Group

SKIN = 1e-3  # m, air kept around a body: far more than the rounding of its position
TOUCH = 1e-4  # m, steps shorter than this are contact
OPEN = 1.5  # gap over a way that is free all along: a bilinear clearance map is no steeper than √2
PROBES = 256  # looks ahead per move; sliding along a wall takes one per 2 mm
GRAZE = 1e-3  # sine of the angle below which a disc is passed, not met
FREE = 0.9  # share of a commanded move below which the bumper feels contact


@dataclass(frozen=True)
class GroupRange:
    """Where a group lies in the swarm: robot i of trial k has index start + k count + i.

    number: of the group in the scenario, from 0 on; its random streams are named by it, as names may repeat. row: of
    its first trial in the swarm's `members`.
    """

    number: int
    name: str
    start: int
    count: int
    trials: int
    model: Group
    row: int = 0

    @property
    def size(self) -> int:
        """Robots of all trials."""
        return self.count * self.trials

    @property
    def first(self) -> int:
        """Number of its first robot among all trials there could be: random streams count by it."""
        return self.model.first_trial * self.count

    def speed(self, wanted: float | None) -> float:
        """What is wanted, or else the body's largest [m/s]."""
        return self.model.body.max_speed if wanted is None else wanted

    def generators(self, seed: int, name: str) -> list[np.random.Generator]:
        """What is drawn once for the robots of each trial, the same for a trial alone and among others."""
        first = self.model.first_trial
        return [
            generator(seed, f"group {self.number}/{name} of trial {first + k}") for k in range(self.trials)
        ]

    @property
    def slice(self) -> slice:
        """The group's part of an array over the swarm."""
        return slice(self.start, self.start + self.size)


def ranges(groups: tuple[Group, ...], rivals: bool) -> list[GroupRange]:
    """The groups one after the other; those of rivals have trials of their own."""
    result, start, row = [], 0, 0
    for number, group in enumerate(groups):
        result.append(GroupRange(number, group.name, start, group.count, group.trials, group, row))
        start += result[-1].size
        row += group.trials if rivals else 0
    return result


@ti.data_oriented
class Swarm:
    """State and motion of the robots of all groups, one Taichi field per quantity.

    positions: (count, 2) [m] and headings: (count,) [rad] at the start, free of overlap (see `placement`).
    clearance: its ti.funcs ``distance(p)`` and ``normal(p)`` give a lower bound of the distance [m] from p to
    the next wall or obstacle, and the unit vector away from it. sources: (m,
    2) [m], known to the referee, not to the robots. walkers: obstacles that move, of which the robots feel the disc
    around the footprint; one that walks into a robot does not push it: the robot can only drive away. rivals:
    whether groups neither see nor touch each other.

    Algorithms read `reading` [ppm], `wind` [m/s], `wind_known`, `blocked` (the bumper), where the robot believes to be,
    `believed_position` [m], `believed_heading` [rad] and `odometer` [m], and write `speed_command` [m/s],
    `turn_rate_command` [rad/s] and `state`. Without errors of odometry the beliefs are the truth: the same fields.
    """

    def __init__(
        self,
        groups: tuple[Group, ...],
        positions: np.ndarray,
        headings: np.ndarray,
        clearance: Any,
        sources: np.ndarray,
        seed: int,
        walkers: Sequence[Obstacle] = (),
        rivals: bool = False,
    ):
        self.groups = ranges(groups, rivals)
        self.clearance, self.seed = clearance, seed
        self.key: Any = ti.field(ti.u32, ())  # the seed, for kernels
        uploader(self.key)(np.uint32(seed))
        self.count = sum(group.size for group in self.groups)
        self.start = np.array(positions, np.float32).reshape(-1, 2)  # where the robots begin [m]
        self.trials = max((group.row + group.trials for group in self.groups), default=0)
        n = max(1, self.count)  # Taichi has no empty fields
        self.position: Any = ti.Vector.field(2, ti.f32, n)
        self.velocity: Any = ti.Vector.field(2, ti.f32, n)
        self.heading = ti.field(ti.f32, n)
        self.speed_command = ti.field(ti.f32, n)
        self.turn_rate_command = ti.field(ti.f32, n)
        self.reading = ti.field(ti.f32, n)
        self.resistance = ti.field(ti.f32, n)  # ohm, of a metal oxide
        self.true_ppm = ti.field(ti.f32, n)
        self.wind = ti.Vector.field(2, ti.f32, n)
        self.wind_known = ti.field(ti.i32, n)
        self.blocked = ti.field(ti.i32, n)
        self.bumps = ti.field(ti.i32, n)
        self.acquisitions = ti.field(ti.i32, n)
        self.hits = ti.field(ti.i32, n)
        self.found = ti.field(ti.i32, n)
        self.found_time = ti.field(ti.f32, n)
        self.path_length = ti.field(ti.f32, n)
        self.state = ti.field(ti.i32, n)
        self.found_time.fill(np.nan)
        self.resistance.fill(np.nan)
        self._fill_bodies(n)
        self._fill_members()
        self.walkers = [(motion_of(one), one.center) for one in walkers]
        self.walker_count = len(self.walkers)
        self.discs: Any = ti.Vector.field(2, ti.f32, max(1, len(walkers)))
        self.disc_radius: Any = ti.field(ti.f32, max(1, len(walkers)))
        if walkers:
            self.disc_radius.from_numpy(np.array([disc_around(one) for one in walkers], np.float32))
        self.source_count = len(sources)
        self.sources: Any = ti.Vector.field(2, ti.f32, max(1, len(sources)))
        if len(sources):
            self.sources.from_numpy(np.asarray(sources, np.float32))
        if self.count:
            self.position.from_numpy(np.asarray(positions, np.float32))
            self.heading.from_numpy(np.asarray(headings, np.float32))
        self._fill_beliefs(n)

    def _fill_beliefs(self, n: int) -> None:
        self.reckons = any(group.model.odometry for group in self.groups)
        self.believed_position: Any = self.position
        self.believed_heading, self.odometer = self.heading, self.path_length
        if self.reckons:
            self.odometry = Odometry(self.groups, n, self.seed)
            self.believed_position = ti.Vector.field(2, ti.f32, n)
            self.believed_heading, self.odometer = ti.field(ti.f32, n), ti.field(ti.f32, n)
            self.believed_position.copy_from(self.position)
            self.believed_heading.copy_from(self.heading)

    def _fill_bodies(self, n: int) -> None:
        self.radius = ti.field(ti.f32, n)
        self.reach = ti.field(ti.f32, n)
        self.square = ti.field(ti.f32, n)  # 1 where the reach is half the edge of a square
        self.max_speed = ti.field(ti.f32, n)
        self.max_turn_rate = ti.field(ti.f32, n)
        self.half_base = ti.field(ti.f32, n)  # between the wheels, 0 for a unicycle [m]
        self.max_acceleration = ti.field(ti.f32, n)
        self.speed = ti.field(ti.f32, n)  # forward, as commanded and limited [m/s]
        for field, value in (
            (self.radius, lambda group: group.body.radius),
            (self.reach, lambda group: group.reach),
            (self.square, lambda group: float(group.capture == "square")),
            (self.max_speed, lambda group: group.body.max_speed),
            (self.max_turn_rate, lambda group: np.radians(group.body.max_turn_rate_deg)),
            (self.half_base, lambda group: 0.5 * (group.body.wheel_base or 0.0)),
            (self.max_acceleration, lambda group: group.body.max_acceleration or np.inf),
        ):
            values = np.zeros(n, np.float32)
            for group in self.groups:
                values[group.slice] = value(group.model)
            field.from_numpy(values)

    def _fill_members(self) -> None:
        """members[k, :team_size[k]]: the robots of trial k, of all groups that have part in it."""
        teams = [
            [
                g.start + (k - g.row) * g.count + i
                for g in self.groups
                if 0 <= k - g.row < g.trials
                for i in range(g.count)
            ]
            for k in range(self.trials)
        ]
        sizes = np.array([len(team) for team in teams] or [0], np.int32)
        table = np.full((len(sizes), max(1, sizes.max())), -1, np.int32)
        for row, team in zip(table, teams, strict=False):
            row[: len(team)] = team
        self.members: Any = ti.field(ti.i32, table.shape)
        self.team_size: Any = ti.field(ti.i32, sizes.shape)
        self.members.from_numpy(table)
        self.team_size.from_numpy(sizes)

    def move(self, tick: int, t: float, dt: float) -> None:
        """Carry out the commands for one tick of dt [s] that ends at t [s]; robots at a source stay there."""
        if not self.count:
            return
        if self.walkers:
            places = [motion.place(center, t) for motion, center in self.walkers]
            self.discs.from_numpy(np.array(places, np.float32))
        self._move(tick, t, dt)

    def all_found(self) -> bool:
        """Whether every robot of every trial has found a source."""
        return bool(self.found.to_numpy()[: self.count].all())

    def snapshot(self) -> dict[str, np.ndarray]:
        """What recordings and results keep, as arrays over the robots; SI units, readings in ppm."""
        table = np.empty((self.count, 20), np.float32)
        if self.count:
            self._tabulate(table)
        names = (
            "heading",
            "reading_ppm",
            "true_ppm",
            "path_length",
            "found_time",
            "state",
            "found",
            "blocked",
            "resistance_ohm",
            "bumps",
            "acquisitions",
            "hits",
            "believed_heading",
            "odometer",
        )
        numbers: dict[str, np.ndarray] = {name: table[:, 4 + n].copy() for n, name in enumerate(names)}
        for name in ("state", "found", "blocked", "bumps", "acquisitions", "hits"):
            numbers[name] = numbers[name].astype(np.int32)
        pairs = {"position": table[:, :2], "wind": table[:, 2:4], "believed_position": table[:, 18:]}
        return {"start": self.start, **{name: pair.copy() for name, pair in pairs.items()}, **numbers}

    @ti.kernel
    def _tabulate(self, table: ti.types.ndarray()):
        """One launch for all of `snapshot`: reading field by field takes ten times as long."""
        for i in range(self.count):
            for d in ti.static(range(2)):
                table[i, d] = self.position[i][d]
                table[i, 2 + d] = self.wind[i][d]
                table[i, 18 + d] = self.believed_position[i][d]
            table[i, 4] = self.heading[i]
            table[i, 5] = self.reading[i]
            table[i, 6] = self.true_ppm[i]
            table[i, 7] = self.path_length[i]
            table[i, 8] = self.found_time[i]
            table[i, 9] = self.state[i]
            table[i, 10] = self.found[i]
            table[i, 11] = self.blocked[i]
            table[i, 12] = self.resistance[i]
            table[i, 13] = self.bumps[i]
            table[i, 14] = self.acquisitions[i]
            table[i, 15] = self.hits[i]
            table[i, 16] = self.believed_heading[i]
            table[i, 17] = self.odometer[i]

    @ti.kernel
    def _move(self, tick: int, t: float, dt: float):
        for k in range(self.trials):
            for m in range(self.team_size[k]):
                i = self.members[k, m]
                before = self.blocked[i]
                self.blocked[i] = 0
                self.velocity[i] = ti.Vector([0.0, 0.0])
                if self.found[i] == 0:
                    self._drive(i, k, tick, dt)
                    self.bumps[i] += ti.cast(self.blocked[i] > before, ti.i32)
                    for s in range(self.source_count):
                        apart = self.position[i] - self.sources[s]
                        distance = ti.select(
                            self.square[i] > 0.0, ti.max(ti.abs(apart[0]), ti.abs(apart[1])), apart.norm()
                        )
                        if distance <= self.reach[i]:
                            self.found[i] = 1
                            self.found_time[i] = t

    @ti.func
    def _drive(self, i, k, tick, dt):
        """Move robot i of trial k: unicycle motion over dt, cut short and slid along what is in the way."""
        speed, turn_rate = self._limited(i, dt)
        arc, turn = speed * dt, turn_rate * dt
        chord = arc
        if ti.abs(turn) > 1e-3:  # below, the factor differs from 1 by less than f32 resolves
            chord *= ti.sin(0.5 * turn) / (0.5 * turn)
        course = self.heading[i] + 0.5 * turn
        self.heading[i] = wrap(self.heading[i] + turn)

        wanted = chord * ti.Vector([ti.cos(course), ti.sin(course)])
        begin = self.position[i]
        p = begin
        rest = wanted
        path = 0.0
        contact = 0
        for _leg in range(2):  # straight on, then what is left of it along the first thing met
            length = rest.norm()
            if length > 0.0:
                e = rest / length
                step, normal, met = self._trace(i, k, p, e, length)
                p += step * e
                path += step
                rest = (length - step) * e
                rest -= ti.min(rest.dot(normal), 0.0) * normal
                contact = ti.max(contact, met)
                if met == 1 and rest.norm() > TOUCH:
                    # a little off the surface, or rounding would press the body into it
                    rest = (rest + TOUCH * normal).normalized() * rest.norm()
                else:
                    rest *= 0.0
        if contact == 1 and (p - begin).dot(wanted) < FREE * wanted.dot(wanted):
            self.blocked[i] = 1
        self.position[i] = p
        self.velocity[i] = (p - begin) / dt
        self.path_length[i] += path
        if ti.static(self.reckons):
            self._reckon(i, tick, turn, ti.select(arc < 0.0, -path, path), p - begin)

    @ti.func
    def _reckon(self, i, tick, turn, way, moved):
        """What robot i believes after a turn [rad] and a way, negative backwards, that took it by `moved` [m]."""
        if self.odometry.errs[i] == 1:
            told, scale, stray = self.odometry.told(i, tick, turn, way)
            heading = self.believed_heading[i]
            self.believed_heading[i] = wrap(heading + told)
            course = heading + 0.5 * told  # as the chord of its arc
            off = course - (self.heading[i] - 0.5 * turn)
            ahead = ti.Vector([ti.cos(course), ti.sin(course)])
            self.believed_position[i] += scale * turned(moved, off) + stray * ahead
            self.odometer[i] += scale * ti.abs(way) + ti.select(way < 0.0, -stray, stray)
        else:
            self.believed_position[i] = self.position[i]
            self.believed_heading[i] = self.heading[i]
            self.odometer[i] = self.path_length[i]

    @ti.func
    def as_believed(self, i, v):
        """A vector v that robot i senses, as it puts it into its map: turned by the error of its heading."""
        result = v
        if ti.static(self.reckons):
            result = turned(v, self.believed_heading[i] - self.heading[i])
        return result

    @ti.func
    def _limited(self, i, dt):
        """Speed [m/s] and turn rate [rad/s] that the body of robot i makes of its commands."""
        limit, turn_limit = self.max_speed[i], self.max_turn_rate[i]
        speed = ti.math.clamp(self.speed_command[i], -limit, limit)
        turn_rate = ti.math.clamp(self.turn_rate_command[i], -turn_limit, turn_limit)
        # the outer wheel goes no faster than the robot can, in the same bend
        outer = ti.abs(speed) + ti.abs(turn_rate) * self.half_base[i]
        share = ti.select(outer > limit, limit / ti.max(outer, 1e-9), 1.0)
        change = ti.math.clamp(
            share * speed - self.speed[i], -self.max_acceleration[i] * dt, self.max_acceleration[i] * dt
        )
        self.speed[i] += change
        return self.speed[i], share * turn_rate

    @ti.func
    def _trace(self, i, k, p, e, length):
        """How far [m] robot i gets from p along e, up to `length`; the normal there; whether it touches."""
        free, normal, contact = self._free_of_discs(i, k, p, e, length)
        # Sphere tracing with over-relaxation (Keinert et al. 2014, doi:10.2312/stag.20141233): as no distance
        # changes by more than the way walked, a stride is free if the gaps at its two ends together cover it.
        r = self.radius[i]
        gap = self.clearance.distance(p) - r
        s = 0.0
        if gap > OPEN * free + SKIN:
            s = free  # what most moves are: no need to look where it ends
        stride = ti.min(free, 2.0 * gap)
        probes = 0
        while s < free and probes < PROBES:
            probes += 1
            ahead = self.clearance.distance(p + (s + stride) * e) - r
            if stride > 0.0 and gap + ahead >= stride and (ahead >= SKIN or ahead >= gap):
                s += stride
                gap = ahead
                stride = ti.min(free - s, 2.0 * gap)
            elif stride > TOUCH:
                stride *= 0.5
            else:
                free = s
                contact = 1
                normal = self.clearance.normal(p + s * e)
        return s, normal, contact

    @ti.func
    def _free_of_discs(self, i, k, p, e, length):
        """The same, but for the other robots and for what walks about alone."""
        free = length
        normal = ti.Vector([0.0, 0.0])
        contact = 0
        team = self.team_size[k]
        for m in range(team + self.walker_count):
            j = -1
            apart = ti.Vector([0.0, 0.0])
            reach = self.radius[i] + SKIN
            if m < team:
                j = self.members[k, m]
                apart = p - self.position[j]
                reach += self.radius[j]
            else:
                apart = p - self.discs[m - team]
                reach += self.disc_radius[m - team]
            if j != i:
                d = apart.norm()
                along = e.dot(apart)  # negative on approach; the closest point is -along ahead
                if along < -GRAZE * d or (along < 0.0 and d < reach - 0.5 * SKIN):
                    half_chord2 = along * along - (d - reach) * (d + reach)
                    if half_chord2 > 0.0:
                        s = ti.max(-along - ti.sqrt(half_chord2), 0.0)
                        if s < free:
                            free = s
                            contact = 1
                            normal = (apart + s * e).normalized()
        return free, normal, contact


def disc_around(obstacle: Obstacle) -> float:
    """Radius [m] of the disc around the footprint of a box, cylinder or sphere."""
    if isinstance(obstacle, Box):
        return hypot(*obstacle.size[:2]) / 2
    return obstacle.radius


@ti.func
def turned(v, angle):
    """The vector v turned left by `angle` [rad]."""
    c, s = ti.cos(angle), ti.sin(angle)
    return ti.Vector([c * v[0] - s * v[1], s * v[0] + c * v[1]])


@ti.func
def wrap(angle):
    """The angle [rad] brought into [-π, π]."""
    return angle - 2.0 * np.pi * ti.round(angle / (2.0 * np.pi))
