"""What tests of plume tracking share: a room with a steady plume, and many trials that search in it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import taichi as ti
from pydantic import TypeAdapter

from taichi_plume.agents.placement import place
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.team import Team
from taichi_plume.grid.state import State
from taichi_plume.grid.transfer import reader, uploader
from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.robots import Body, Group
from taichi_plume.scenario.sensors import Anemometer, IdealGasSensor
from taichi_plume.scenario.sensors import Sensors as SensorModels
from taichi_plume.scenario.species import SPECIES
from taichi_plume.scenario.starts import StartArea

EXTENT = (4.0, 3.0)
SOURCE = (0.5, 1.5)
TICK = 0.1
CONE, STRIP, PATCH = range(3)
IDEAL = (IdealGasSensor(kind="ideal"),)
NO_BOX = ((-9.0, -9.0), (0.1, 0.1))


@ti.data_oriented
class Arena:
    """Walls around EXTENT and an upright box at `center`, `half` = half its edges."""

    low, high = (0.0, 0.0), EXTENT

    def __init__(self):
        self.box = ti.Vector.field(2, ti.f32, 2)
        self._put = uploader(self.box)
        self.build(*NO_BOX)

    def build(self, center, half):
        """Another box."""
        self.center, self.half = center, half
        self._put(np.array([center, half]))

    @ti.func
    def nearest(self, p):
        """Distance and normal of the next surface."""
        best = ti.Vector([p[0], 1.0, 0.0])
        if p[1] < best[0]:
            best = ti.Vector([p[1], 0.0, 1.0])
        for d in ti.static(range(2)):
            if EXTENT[d] - p[d] < best[0]:
                best = ti.Vector([EXTENT[d] - p[d], float(d - 1), float(-d)])
        center, half = self.box[0], self.box[1]
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
        walls = np.minimum(points, np.array(EXTENT) - points).min(-1)
        low, high = np.subtract(self.center, self.half), np.add(self.center, self.half)
        return np.minimum(walls, np.hypot(*(points - np.clip(points, low, high)).T))


@ti.data_oriented
class Plume:
    """Wind along +x and gas: behind SOURCE a Gaussian CONE with `peak` ppm at its tip, a STRIP along the axis of the
    room, or a PATCH downwind of x = 2.5 m.
    """

    species = (SPECIES["ethanol"],)

    def __init__(self):
        self.peak, self.wind = ti.field(ti.f32, ()), ti.field(ti.f32, ())
        self.shape = ti.field(ti.i32, ())
        self.set = uploader(self.peak, self.wind, self.shape)

    @ti.func
    def ppm(self, x, t):
        behind = x[0] - SOURCE[0]
        width = 0.08 + 0.1 * ti.max(behind, 0.0)
        across = (x[1] - SOURCE[1]) / width
        share = ti.select(behind > 0.0, ti.exp(-0.5 * across * across) * 0.08 / width, 0.0)
        if self.shape[None] == STRIP:
            share = ti.select(ti.abs(x[1] - 1.5) < 0.3, 1.0, 0.0)
        elif self.shape[None] == PATCH:
            share = ti.select(x[0] > 2.5, 1.0, 0.0)
        return ti.Vector([self.peak[None] * share])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([self.wind[None], 0.0])


class Hunt:
    """60 trials of one robot for each of the gas sensors, that neither see nor touch each other."""

    STATE = ("swarm", "sensors", "team")
    TRIALS = 60

    def __init__(self, kind, gases=IDEAL):
        self.kind, self.gases = kind, gases
        self.arena = Arena()
        self.plume: Any = Plume()
        groups, where, headings = self._placed((2.8, 0.3), (3.7, 2.7), {})
        self.swarm = Swarm(groups, where, headings, self.arena, np.array([SOURCE]), seed=3, rivals=True)
        self.sensors = Sensors(self.swarm, 2, TICK, self.plume.species)
        self.team = Team(self.swarm, range(len(gases)), TICK)
        self._state = State(self)
        self._look = reader(self.swarm.state, self.swarm.position)

    def _placed(self, low, high, model):
        """The groups, positions and headings."""
        groups = tuple(
            Group(
                name="team",
                count=1,
                trials=self.TRIALS,
                start=StartArea(kind="area", low=low, high=high),
                algorithm=TypeAdapter(Algorithm).validate_python({"kind": self.kind, **model}),
                body=Body(),
                sensors=SensorModels(gas=gas, wind=Anemometer(kind="ultrasonic")),
                reach=0.3,
            )
            for gas in self.gases
        )
        poses = [place(group, np.random.default_rng, self.arena.distance_at) for group in groups]
        return groups, *(np.concatenate(parts) for parts in zip(*poses, strict=True))

    def search(
        self,
        peak,
        seconds,
        shape=CONE,
        wind=0.5,
        box=NO_BOX,
        low=(2.8, 0.3),
        high=(3.7, 2.7),
        trials=TRIALS,
        **model,
    ):
        """Search anew. For each sensor what the robots of the first `trials` trials have in the end (`found`,
        `path_length`, `wind_known`), their `states` (ticks, robots) and `tracks` (ticks, robots, 2).
        """
        self.plume.set(peak, wind, shape)
        self.arena.build(*box)
        groups, positions, headings = self._placed(low, high, model)
        self._state.clear()
        self.swarm.begin(groups, positions, headings, np.array([SOURCE]), 3)
        self.sensors.begin()
        self.team.begin()
        seen = []
        for tick in range(1, round(seconds / TICK) + 1):
            self.sensors.measure(self.plume, self.plume, tick, tick * TICK)
            self.team.act(tick, tick * TICK, TICK)
            self.swarm.move(tick, tick * TICK, TICK)
            seen.append(self._look())
        states, tracks = (np.array(values) for values in zip(*seen, strict=True))
        swarm = self.swarm
        ends = {
            "found": swarm.found.to_numpy(),
            "path_length": swarm.path_length.to_numpy(),
            "wind_known": swarm.wind_known.to_numpy(),
        }
        parts = [slice(group.start, group.start + trials) for group in swarm.groups]
        return [
            SimpleNamespace(
                states=states[:, part],
                tracks=tracks[:, part],
                **{name: values[part] for name, values in ends.items()},
            )
            for part in parts
        ]
