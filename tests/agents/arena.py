"""Arena for the tests of all search algorithms: an empty rectangular arena, scripted gas, and teams that run in it."""

import numpy as np
from robots import group

from taichi_plume.agents.placement import place
from taichi_plume.agents.room import Room
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.team import teams
from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.state import State
from taichi_plume.scenario.species import SPECIES

TICK = 0.1
ETHANOL = SPECIES["ethanol"]
LONGEST = 400  # script


class Script:
    """Ethanol in still air that depends on time alone: ppm[k] from k times `every` seconds on, and then the last."""

    species = (SPECIES["ethanol"],)

    def __init__(self, ppm, every):
        self.table = ti.field(ti.f32, LONGEST)
        self.every = ti.field(ti.f32, ())
        self.tell(ppm, every)

    def tell(self, ppm, every):
        """Another script."""
        self.table.from_numpy(np.pad(np.asarray(ppm, float), (0, LONGEST - len(ppm)), mode="edge"))
        self.every[None] = every

    @ti.func
    def ppm(self, x, t):
        k = ti.cast(ti.floor(t / self.every[None] + 1e-3), ti.i32)
        return ti.Vector([self.table[ti.min(k, LONGEST - 1)]])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([0.0, 0.0])


class Run:
    """Teams in an empty arena, tick by tick.

    algorithm: a section of the scenario; or of rivals, which neither see nor touch each other, a list of dictionaries
    with what differs from the other arguments: `algorithm`, `positions`, `trials`, `heading_deg`, other keys of groups.
    """

    STATE = ("swarm", "sensors", "teams")

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
        arena=None,
        seed=1,
        **keys,
    ):
        self.keys = {"positions": positions, "trials": trials, "heading_deg": heading_deg, **keys}
        high = (low[0] + size[0], low[1] + size[1])
        self.arena, self.seed = arena or ClearanceMap(list(obstacles), high, 0.1, low=low), seed
        self.sources, self.gas = np.array(sources).reshape(-1, 2), gas
        self.begin(algorithm)

    @property
    def algorithm(self):
        """Algorithm of the first group, and of all others of its kind."""
        return self.teams[0].algorithm

    def _placed(self, algorithm):
        """The groups, with positions and headings of all robots."""
        rivals = algorithm if isinstance(algorithm, list) else [{"algorithm": algorithm}]
        groups = tuple(_group(**(self.keys | rival)) for rival in rivals)
        poses = [place(one, np.random.default_rng, self.arena.distance_at) for one in groups]
        return groups, *(np.concatenate(parts) for parts in zip(*poses, strict=True))

    def begin(self, algorithm, **keys):
        """Make teams at the start of a run; keys: what differs from before."""
        self.keys |= keys
        rivals, where, headings = self._placed(algorithm)
        several = len(rivals) > 1
        room = Room(
            tuple(self.arena.high), 1.0, lambda axis, side, along, width: np.ones(len(along), bool), ETHANOL
        )
        self.swarm = Swarm(
            rivals, where, headings, self.arena, self.sources, self.seed, rivals=several, room=room
        )
        self.sensors = Sensors(self.swarm, 2, TICK, self.gas.species)
        self.teams = teams(self.swarm, TICK)
        self.tick = 0

    def of(self, rival):
        """The part of an array over the robots that is a rival's."""
        return self.swarm.groups[rival].slice

    def step(self):
        """One tick."""
        self.tick += 1
        t = self.tick * TICK
        self.sensors.measure(self.gas, self.gas, self.tick, t)
        for team in self.teams:
            team.act(self.tick, t, TICK)
        self.swarm.move(self.tick, t, TICK)

    def go(self, seconds):
        """Run on; returns the state of each robot at each tick, and its position."""
        states, places = [], []
        for _ in range(round(seconds / TICK)):
            self.step()
            states.append(self.swarm.state.to_numpy())
            places.append(self.swarm.position.to_numpy())
        return np.array(states), np.array(places)

    def saved(self):
        """Return a function that goes back to the present state."""
        state, tick = State(self), self.tick
        saved = state.save()

        def restore():
            state.restore(saved)
            self.tick = tick

        return restore


def _group(positions, heading_deg, **keys):
    start = {"kind": "positions", "positions": positions, "heading_deg": heading_deg}
    body = {"radius": 0.085, "max_speed": 0.2, "max_turn_rate_deg": 90}
    sensors = {"gas": {"kind": "ideal", "period": 0.5}, "wind": {"kind": "ideal"}}
    return group(**{"count": len(positions), "start": start, "body": body, "sensors": sensors, **keys})
