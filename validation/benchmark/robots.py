"""Speed of robots: sensors in a 3-D gas on the grid, a search algorithm and motion; each robot is a trial."""

import time
from dataclasses import dataclass

import numpy as np
from pydantic import TypeAdapter

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.team import Team
from taichi_plume.engine import program, ti
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.fields import Mixture
from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.starts import StartAt
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.setups import cfd, flow_on, gas_on

TICK = 0.1  # s
WARM_UP = 5  # ticks
TICKS = 30
OPENINGS = ({"kind": "honeycomb", "face": "x-", "speed": 0.7}, {"kind": "honeycomb", "face": "x+"})


@dataclass(frozen=True)
class RobotTick:
    """Cost of a tick of many robots: medians of the parts [ms], and CPU time of all cores per robot [us]."""

    case: str
    algorithm: str
    robots: int
    measure_ms: float
    act_ms: float
    move_ms: float
    Mrobot_steps_per_s: float
    cpu_us: float
    """CPU time of a robot-step; more reliable than wall time on a busy machine."""

    def __str__(self) -> str:
        return (
            f"{self.case:16} {self.robots:8,} robots, {self.algorithm:12} "
            f"{self.Mrobot_steps_per_s:6.2f} Mrobot-steps/s  measure {self.measure_ms:.2f}, "
            f"act {self.act_ms:.2f}, move {self.move_ms:.2f} ms, {self.cpu_us:.3f} us of CPU"
        )


def crowd(algorithm: str, robots: int) -> tuple[Mixture, FlowSolver, Swarm, Sensors, Team]:
    """Return gas, wind, and robots with MiCS-5524 sensors, spread over the empty arena (4 x 3 x 0.52 m, 4 cm cells)."""
    wind = flow_on(cfd(OPENINGS), (100, 75, 13), 0.04)
    source = {"position": (0.6, 1.5, 0.1), "rate": 2e-5}
    gas = Mixture([gas_on(wind.grid, wind, sources=[source])])
    group = Group(
        count=1,
        trials=robots,
        start=StartAt(kind="positions", positions=((1.0, 1.0),)),
        algorithm=TypeAdapter(Algorithm).validate_python({"kind": algorithm}),
    )
    rng = np.random.default_rng(0)
    places = rng.uniform((0.2, 0.2), (3.8, 2.8), (robots, 2))
    arena = ClearanceMap([], wind.grid.extent, 0.15)
    swarm = Swarm((group,), places, rng.uniform(-3.0, 3.0, robots), arena, np.array([[0.6, 1.5]]), 1)
    return gas, wind, swarm, Sensors(swarm, 3, TICK, gas.species), Team(swarm, (0,), TICK)


def ticks(case: str, arch: str, algorithm: str, robots: int = 100_000) -> RobotTick:
    """Return the cost of ticks of a crowd of robots."""
    program.start(arch)
    gas, wind, swarm, sensors, team = crowd(algorithm, robots)
    parts = []
    cpu = 0.0
    for tick in range(1, WARM_UP + TICKS + 1):
        if tick == WARM_UP + 1:
            cpu = time.process_time()
        t = tick * TICK
        moments = [time.perf_counter()]
        for work in (
            lambda t=t, tick=tick: sensors.measure(gas, wind, tick, t),
            lambda t=t, tick=tick: team.act(tick, t, TICK),
            lambda t=t, tick=tick: swarm.move(tick, t, TICK),
        ):
            work()
            ti.sync()
            moments.append(time.perf_counter())
        parts.append(np.diff(moments))
    measure, act, move = (1e3 * np.median(parts[WARM_UP:], axis=0)).tolist()
    cpu = (time.process_time() - cpu) / TICKS / robots
    rate = robots / (measure + act + move) / 1e3
    return RobotTick(case, algorithm, robots, measure, act, move, rate, 1e6 * cpu)
