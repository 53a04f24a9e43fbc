"""What tests of search algorithms share: an empty rectangular arena, scripted gas, and a team that runs in it."""

import numpy as np
import taichi as ti

from taichi_plume.agents.placement import place
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.team import Team
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.scenario.robots import Body, Group, StartAt
from taichi_plume.scenario.sensors import Anemometer, IdealGasSensor
from taichi_plume.scenario.sensors import Sensors as SensorModels
from taichi_plume.scenario.species import SPECIES

TICK = 0.1


@ti.data_oriented
class Script:
    """Ethanol that depends on time alone: ppm[k] from k times `every` seconds on."""

    species = (SPECIES["ethanol"],)

    def __init__(self, ppm, every):
        self.table = ti.field(ti.f32, len(ppm))
        self.table.from_numpy(np.asarray(ppm, np.float32))
        self.every, self.last = every, len(ppm) - 1

    @ti.func
    def ppm(self, x, t):
        k = ti.cast(ti.floor(t / self.every + 1e-3), ti.i32)
        return ti.Vector([self.table[ti.min(k, self.last)]])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([0.0, 0.0])


class Run:
    """A group in an empty arena, tick by tick."""

    def __init__(
        self,
        algorithm,
        gas,
        positions=((1.5, 1.0),),
        trials=1,
        size=(3.0, 2.1),
        sources=(),
        heading_deg: float | None = 0.0,
        low=(0.0, 0.0),
        obstacles=(),
        **keys,
    ):
        group = Group(
            name="team",
            count=len(positions),
            trials=trials,
            start=StartAt(kind="positions", positions=tuple(positions), heading_deg=heading_deg),
            algorithm=algorithm,
            body=Body(radius=0.085, max_speed=0.2, max_turn_rate_deg=90),
            sensors=SensorModels(gas=IdealGasSensor(kind="ideal", period=0.5), wind=Anemometer(kind="ideal")),
            **keys,
        )
        arena = ClearanceMap(list(obstacles), (low[0] + size[0], low[1] + size[1]), 0.1, low=low)
        where, headings = place(group, np.random.default_rng, arena.distance_at)
        self.swarm = Swarm((group,), where, headings, arena, np.array(sources).reshape(-1, 2), seed=1)
        self.sensors = Sensors(self.swarm, 2, TICK, gas.species)
        self.team = Team(self.swarm, (0,), TICK)
        self.gas, self.tick = gas, 0

    def step(self):
        """One tick."""
        self.tick += 1
        t = self.tick * TICK
        self.sensors.measure(self.gas, self.gas, self.tick, t)
        self.team.act(self.tick, t, TICK)
        self.swarm.move(self.tick, t, TICK)

    def go(self, seconds):
        """Run on; returns the state of each robot at each tick, and its position."""
        states, places = [], []
        for _ in range(round(seconds / TICK)):
            self.step()
            states.append(self.swarm.state.to_numpy())
            places.append(self.swarm.position.to_numpy())
        return np.array(states), np.array(places)
