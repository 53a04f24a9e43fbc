"""Scenario -> Simulation: the one place that knows all parts."""

from pathlib import Path

import numpy as np

from taichi_plume.agents.mapping import InverseDistanceMap, TimeSeriesMap
from taichi_plume.agents.placement import Placed, place, placed
from taichi_plume.agents.swarm import Swarm, disc_around
from taichi_plume.agents.team import Team
from taichi_plume.fields import Wind
from taichi_plume.geometry import ClearanceMap, air_regions, shapes, solid_cells
from taichi_plume.grid import Grid
from taichi_plume.loading import ScenarioError
from taichi_plume.rng import generator
from taichi_plume.scenario import CfdWind, Scenario, motion_of
from taichi_plume.simulation import Map, Simulation
from taichi_plume.solvers.bodies import MovingObstacle, Wake
from taichi_plume.solvers.boundaries import opening_cells, periodic_axes
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.uniform import UniformSolver

MAPS = {"time_series": TimeSeriesMap, "inverse_distance": InverseDistanceMap}


def assemble(scenario: Scenario, folder: Path = Path()) -> Simulation:
    """The simulation of a checked scenario, at the begin of its warm-up; Taichi must have been started.

    folder: where the scenario's mesh files lie. Raises ScenarioError where robots do not fit.
    """
    obstacles = shapes(scenario, folder)
    standing = [one for one in obstacles if motion_of(one.model) is None]
    wind_model = scenario.wind
    openings = wind_model.openings if isinstance(wind_model, CfdWind) else ()
    grid = Grid.of(scenario.domain, periodic_axes(openings, scenario.domain.dim))
    solid = solid_cells(standing, grid, opening_cells(openings, grid))
    begin = scenario.first_tick * scenario.tick
    wind: Wind
    if isinstance(wind_model, CfdWind):
        wind = FlowSolver(wind_model, grid, solid, scenario.seed)
        trapped = wind.boundaries.trapped(air_regions(solid, grid.periodic))
        if trapped:
            raise ScenarioError(
                [
                    f"wind.openings[{n}]: its air has no way to an outlet, obstacles close it off; "
                    "move one of them or add an outlet there"
                    for n in trapped
                ]
            )
    else:
        wind = UniformSolver(wind_model, grid)
    try:
        gas = EulerianSolver(scenario.gas, grid, wind, solid, begin, scenario.seed)
    except ValueError as error:
        raise ScenarioError([f"gas.{error}"]) from None
    swarm = _swarm(scenario, obstacles, grid)
    if isinstance(wind, FlowSolver):
        wind.resistances += [
            MovingObstacle(one.model, grid, wind.open) for one in obstacles if one not in standing
        ]
        wind.resistances += [
            Wake(grid, wind.open, swarm.position, swarm.velocity, group.start, group.count, group.model.body)
            for group in swarm.groups
            if group.model.wake
        ]
    teams = [Team(swarm, group, grid.dim, scenario.tick) for group in swarm.groups]
    floor = (grid.extent[0], grid.extent[1])
    maps: list[Map] = [MAPS[m.kind](m, floor, max(1, swarm.trials)) for m in scenario.maps]
    return Simulation(scenario, grid, wind, gas, swarm, list(teams), maps, obstacles)


def _swarm(scenario: Scenario, obstacles: list, grid: Grid) -> Swarm:
    """All robots at their places."""
    height = max((group.body.height for group in scenario.robots), default=0.1)
    clearance = ClearanceMap([s for s in obstacles if motion_of(s.model) is None], grid.extent, height)
    walkers = [
        s.model
        for s in obstacles
        if motion_of(s.model) and np.isfinite(s.horizontal_distance(np.zeros((1, 2)), 0.0, height))
    ]
    trials = np.arange(max((group.trials for group in scenario.robots), default=1))
    occupied = [
        Placed(np.tile(one.center[:2], (len(trials), 1)), disc_around(one), trials) for one in walkers
    ]
    positions, headings = [np.empty((0, 2))], [np.empty(0)]
    for n, group in enumerate(scenario.robots):
        rng = generator(scenario.seed, f"start of group {n}")
        try:
            where, heading = place(group, rng, clearance.distance_at, occupied)
        except ValueError as error:
            raise ScenarioError([f"robots[{n}].start: {error}"]) from None
        occupied.append(placed(group, where))
        positions.append(where)
        headings.append(heading)
    sources = np.array([source.position[:2] for source in scenario.gas.sources])
    return Swarm(
        scenario.robots,
        np.concatenate(positions),
        np.concatenate(headings),
        clearance,
        sources,
        scenario.seed,
        walkers,
    )
