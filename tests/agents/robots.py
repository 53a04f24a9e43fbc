"""Robots that tests of motion and sensing share: groups, a floor, a gas and a driver; all in closed form."""

import numpy as np

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.fields import Wind
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.species import SPECIES

NOWHERE = np.empty((0, 2))  # no sources
EXTENT = (4.0, 3.0)
AWAY = [-9, -9, 0.1], [-9, -9, 0.1, 0.1]  # disc and plate that are in nobody's way


def group(**keys) -> Group:
    """Casting robots, unless given; their start is for `place` alone, as tests put swarms to places of their own."""
    usual = {
        "count": 1,
        "algorithm": {"kind": "casting"},
        "start": {"kind": "positions", "positions": [(1, 1)]},
    }
    return Group.model_validate(usual | keys)


def team(*positions, **keys) -> dict:
    """The section of a group that casts, unless given, from these positions on."""
    start = {"kind": "positions", "positions": positions, "heading_deg": keys.pop("heading_deg", None)}
    return {"count": len(positions), "start": start, "algorithm": {"kind": "casting"}} | keys


def room(*robots, **keys) -> dict:
    """A scenario of these groups in an even wind in EXTENT."""
    usual = {
        "duration": 4.0,
        "domain": {"size": list(EXTENT), "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.5, 0.0]},
        "gas": {"kind": "eulerian", "sources": [{"position": [0.5, 1.5], "rate": "1 mg/s"}]},
        "robots": list(robots),
    }
    return usual | keys


class Floor:
    """Nothing in the way."""

    low, high = (0.0, 0.0), EXTENT

    @ti.func
    def distance(self, p):
        return 1e6

    @ti.func
    def normal(self, p):
        return ti.Vector([1.0, 0.0])


class Arena:
    """Walls around EXTENT, a round obstacle and an upright plate or box; they can be moved."""

    low, high = (0.0, 0.0), EXTENT

    def __init__(self):
        self.disc = ti.field(ti.f32, 3)  # x, y, radius
        self.plate = ti.field(ti.f32, 4)  # x, y, half width, half length
        self.set()

    def set(self, disc=AWAY[0], plate=AWAY[1]):
        self.shapes = np.array(disc, np.float32).astype(float), np.array(plate, np.float32).astype(float)
        self.disc.from_numpy(self.shapes[0])
        self.plate.from_numpy(self.shapes[1])

    @ti.func
    def nearest(self, p):
        """Distance and normal of the next surface; the normal is meant for the outside of plate and disc."""
        best = ti.Vector([p[0], 1.0, 0.0])
        if p[1] < best[0]:
            best = ti.Vector([p[1], 0.0, 1.0])
        for d in ti.static(range(2)):
            if EXTENT[d] - p[d] < best[0]:
                best = ti.Vector([EXTENT[d] - p[d], float(d - 1), float(-d)])
        apart = p - ti.Vector([self.disc[0], self.disc[1]])
        if apart.norm() - self.disc[2] < best[0]:
            best = ti.Vector([apart.norm() - self.disc[2], apart[0] / apart.norm(), apart[1] / apart.norm()])
        center, half = ti.Vector([self.plate[0], self.plate[1]]), ti.Vector([self.plate[2], self.plate[3]])
        apart = p - ti.math.clamp(p, center - half, center + half)
        if apart.norm() < best[0]:
            best = ti.Vector([apart.norm(), apart[0] / apart.norm(), apart[1] / apart.norm()])
        return best

    @ti.func
    def distance(self, p):
        return self.nearest(p)[0]

    @ti.func
    def normal(self, p):
        best = self.nearest(p)
        return ti.Vector([best[1], best[2]])

    def distance_at(self, points):
        """The same distance in float64."""
        points, (disc, plate) = np.asarray(points, float), self.shapes
        walls = np.minimum(points, np.array(EXTENT) - points).min(-1)
        to_disc = np.hypot(*(points - disc[:2]).T) - disc[2]
        to_plate = points - np.clip(points, plate[:2] - plate[2:], plate[:2] + plate[2:])
        return np.minimum(np.minimum(walls, to_disc), np.hypot(*to_plate.T))


class Air(Wind):
    """The same gas [ppm] and wind [m/s] everywhere; gas grows by `slope` per m of x + 10 z."""

    species = (SPECIES["ethanol"],)

    def __init__(self, dim=2):
        self.dim = dim
        self.level, self.slope = ti.field(ti.f32, ()), ti.field(ti.f32, ())
        self.u = ti.vector_field(dim, ti.f32, ())

    def is_finite(self):
        return True

    def advance(self, t, dt):
        pass

    @ti.func
    def ppm(self, x, t):
        ppm = self.level[None] + self.slope[None] * x[0]
        if ti.static(self.dim == 3):
            ppm += self.slope[None] * 10.0 * x[2]
        return ti.Vector([ppm])

    @ti.func
    def velocity(self, x, t):
        return self.u[None]


class Driver:
    """A swarm, and what tests do with it: make another, command, look."""

    def __init__(self, swarm: Swarm):
        self.swarm, self.tick = swarm, 0

    def begin(self, groups, positions, headings, sources=(), seed=0, **keys):
        """Make another swarm in the same arena."""
        self.swarm = Swarm(
            groups,
            np.array(positions),
            np.array(headings),
            self.swarm.clearance,
            np.reshape(sources, (-1, 2)),
            seed,
            **keys,
        )
        self.tick = 0

    def command(self, speed, turn_rate):
        self.swarm.speed_command.from_numpy(speed)
        self.swarm.turn_rate_command.from_numpy(turn_rate)

    def move(self, ticks=1, dt=0.1):
        for _ in range(ticks):
            self.tick += 1
            self.swarm.move(self.tick, self.tick * dt, dt)
        return self.swarm.snapshot()


class Bench:
    """A robot at (1, 1) for each of these gas sensors, in air that the tests set."""

    def __init__(self, *sensors, dt=0.1, around=None, place=1.0):
        self.air, self.dt, self.tick, n = Air(), dt, 0, len(sensors)
        groups = [
            group(name=f"group {k}", sensors={"gas": one, "wind": {"kind": "ideal"}})
            for k, one in enumerate(sensors)
        ]
        self.swarm = Swarm(groups, np.full((n, 2), place), np.zeros(n), Floor(), NOWHERE, 3)
        self.sensors = Sensors(self.swarm, 2, dt, self.air.species, around)

    def measure(self, level=None, column="reading_ppm"):
        """One tick, in gas of another level [ppm] if given; the column of all robots."""
        self.tick += 1
        if level is not None:
            self.air.level[None] = level
        self.sensors.measure(self.air, self.air, self.tick, self.dt * self.tick)
        return self.swarm.snapshot()[column]

    def series(self, levels, column="reading_ppm"):
        """The column of all robots (ticks, robots) in gas of these levels, tick by tick."""
        return np.array([self.measure(level, column) for level in levels])
