"""Scenario -> Simulation: the one place that knows all parts."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.line_sensors import Surroundings
from taichi_plume.agents.mapping import mappers
from taichi_plume.agents.placement import Placed, place, placed
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.team import teams
from taichi_plume.assembly.initial import begin_fields
from taichi_plume.assembly.kinds import GASES, WINDS, Context
from taichi_plume.assembly.own_code import execute
from taichi_plume.assembly.prepare import Prepared, again, checked
from taichi_plume.assembly.resources import Resources
from taichi_plume.files.bag_ways import Way
from taichi_plume.files.gaden import Cubes
from taichi_plume.files.network import Network, NetworkError
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.grid import kernels
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.cut_cells import Air, air_of, sealed
from taichi_plume.grid.fields import Gas, Mixture, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.layers import Layers
from taichi_plume.grid.level_set import LevelSet
from taichi_plume.grid.rng import generator
from taichi_plume.grid.state import State
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.policy import Policy
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.simulation import Simulation
from taichi_plume.solvers.bodies import MovingObstacle, Wake
from taichi_plume.solvers.downwash import Downwash
from taichi_plume.solvers.filmed import FilmedGas, FilmedWind, Reel
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.forces import Forces
from taichi_plume.solvers.momentum import BuoyantScalar
from taichi_plume.solvers.patches import opening_cells, periodic_axes
from taichi_plume.solvers.screens import Resistance
from taichi_plume.solvers.transport import Scalar


def assemble(
    scenario: Scenario,
    folder: Path = Path(),
    algorithms: Mapping[str, type] | None = None,
    allow_code: bool = False,
    allow_outside: bool = False,
    driven: bool = False,
) -> Simulation:
    """Check a scenario and return its simulation, at the start of its warm-up.

    Starts Taichi on the CPU unless it runs; `grid.kernels.start` takes another device. folder: of the files that the
    scenario names. algorithms: own classes by the name of the group that they drive, whose algorithm is of kind own.
    allow_code: whether Python files that it names are executed. allow_outside: whether its files may lie outside of
    `folder`. driven: whether the caller drives its external robots (see agents/external.py). Raises ScenarioError, with
    a line for each fault.
    """
    prepared = checked(scenario, Path(folder), allow_outside)
    groups = [group.name for group in scenario.robots]
    for name, algorithm in (algorithms or {}).items():
        if name not in groups:
            raise ScenarioError(
                [f"algorithms: no group is named {name!r}; groups: {', '.join(groups) or 'none'}"]
            )
        if not isinstance(algorithm, type):
            raise ScenarioError(
                [f"algorithms: {name}: got {algorithm!r}; give a class, not an object of the class"]
            )
    execute(prepared, allow_code, without=algorithms or ())
    kernels.ensure_started()
    return build(prepared, algorithms, driven=driven)


def build(
    prepared: Prepared,
    algorithms: Mapping[str, type] | None = None,
    reel: Reel | None = None,
    driven: bool = False,
) -> Simulation:
    """The simulation of a checked scenario, at the begin of its warm-up; Taichi must have been started.

    Files of own algorithms have been executed, see own_code.

    algorithms: own classes by the name of the group that they drive (its algorithm is of kind own, see agents/own.py).
    reel: holds a film of the air, which is shown instead of solving for what is in it. driven: whether something drives
    external robots. Raises ScenarioError where robots do not fit, or nothing drives them.
    """
    scenario, resources = prepared
    if not driven:
        _require_inside(scenario)
    grid, air = _box(scenario, resources)
    cubes = resources.site.cubes if resources.site else None
    seen = [*resources.obstacles, *([cubes] if cubes else [])]
    clearance, walking = ways(scenario, resources, cubes)
    walkers = [scenario.obstacles[n] for n in walking]
    starts, sources = _starts(scenario, clearance, walkers), _places(scenario)
    swarm = Swarm(scenario.robots, *starts, clearance, sources, scenario.seed, walkers, scenario.rivals)
    stirring = Stirring(scenario, swarm, grid)
    scalars = {path: Scalar(grid) for path in _weights(scenario)}
    weighing = [BuoyantScalar(scalar.q, 0.0) for scalar in scalars.values()]
    _weigh(weighing, scenario)
    context = Context(scenario, resources, grid, air, scalars, weighing, stirring.makers)
    wind = _wind(context, reel)
    gas = Mixture([_gas(context, path, wind, reel) for path, _ in scenario.gases])
    if reel is None:
        begin_fields(scenario, resources, wind, gas.gases)
    sensors = Sensors(swarm, grid.dim, scenario.tick, gas.species, partial(_around, scenario, grid, air))
    own, networks = _own(scenario, resources, algorithms), _networks(scenario, resources)
    try:
        driving = teams(swarm, scenario.tick, own, networks, _recorded(scenario, resources))
    except NetworkError as error:
        raise ScenarioError([str(error)]) from None
    extent, most = (grid.extent[0], grid.extent[1]), swarm.members.shape[1]
    mapped = Floor(extent, max(1, swarm.trials), most, scenario.tick, clearance.obstacle_distance_at)
    maps = mappers(scenario.maps, mapped)
    sim = Simulation(scenario, grid, wind, gas, swarm, sensors, driving, maps, seen, air)
    state = State(sim)

    def begin(scenario: Scenario) -> Scenario:
        """Every part anew, with the numbers of a scenario of the same structure; returns that completed."""
        scenario, _ = again(prepared, scenario)
        walkers = [scenario.obstacles[n] for n in walking]
        starts = _starts(scenario, clearance, walkers)
        t = scenario.first_tick * scenario.tick
        state.clear()
        _weigh(weighing, scenario)
        stirring.begin(scenario)
        wind.begin(scenario.wind, t, scenario.seed_of_air)
        for one, (_, model) in zip(gas.gases, scenario.gases, strict=True):
            one.begin(model, t, scenario.seed_of_air)
        gas.begin()
        if reel is None:
            begin_fields(scenario, resources, wind, gas.gases)
        swarm.begin(scenario.robots, *starts, _places(scenario), scenario.seed, walkers)
        sensors.begin()
        for team in driving:
            team.begin()
        for gas_map, model in zip(maps, scenario.maps, strict=True):
            gas_map.begin(model)
        return scenario

    sim.begin = begin
    if isinstance(wind, FlowSolver) and wind.area is not None:
        sim.forces = Forces(wind, air, len(resources.obstacles))
    if isinstance(wind, FlowSolver):
        sim.pressure, sim.heat = wind.p, wind.heat
    return sim


class Stirring:
    """Obstacles and robots that move the air. makers: make them, of the openness of the faces."""

    def __init__(self, scenario: Scenario, swarm: Swarm, grid: Grid):
        self.swarm, self.grid = swarm, grid
        self.walkers: list[tuple[int, MovingObstacle]] = []
        self.wakes: list[tuple[int, Wake | Downwash]] = []
        moving = [(n, one) for n, one in enumerate(scenario.obstacles) if one.motion]
        stirring = [group for group in swarm.groups if group.model.wake]
        self.makers = [
            *(partial(self._walker, n, one) for n, one in moving),
            *(partial(self._wake, group) for group in stirring),
        ]

    def _walker(self, number: int, model: Obstacle, open: tuple[Any, ...]) -> Resistance:
        self.walkers.append((number, MovingObstacle(model, self.grid, open)))
        return self.walkers[-1][1]

    def _wake(self, group: GroupRange, open: tuple[Any, ...]) -> Resistance:
        swarm, body, robots = self.swarm, group.model.body, (group.start, group.count)
        wake: Wake | Downwash
        if body.flies:
            flight = swarm.position, swarm.heading, swarm.altitude, swarm.acceleration
            wake = Downwash(body, self.grid, *flight, *robots, open)
        else:
            wake = Wake(body, self.grid, swarm.position, swarm.velocity, *robots, open)
        self.wakes.append((group.number, wake))
        return wake

    def begin(self, scenario: Scenario) -> None:
        """With the obstacles' ways and the bodies of that scenario."""
        for number, walker in self.walkers:
            walker.begin(scenario.obstacles[number])
        for number, wake in self.wakes:
            wake.begin(scenario.robots[number].body)


def ways(scenario: Scenario, resources: Resources, cubes: Cubes | None) -> tuple[ClearanceMap, list[int]]:
    """What stands in the robots' way, `cubes` of an occupancy grid too; and the numbers of the obstacles that walk."""
    flying = [group for group in scenario.robots if group.body.flies]
    driving = [group for group in scenario.robots if not group.body.flies]
    standing: list[Any] = [one for one in resources.standing if one is not None]
    shapes, floor, feet = [*standing, *([cubes] if cubes else [])], scenario.floor, np.zeros((1, 2))
    # algorithms of the floor see what stands there or, of drones alone, at the altitudes at which these begin
    some = driving or flying
    base = min((group.start_altitude for group in some), default=0.0)
    top = max((group.start_altitude + group.body.height for group in some), default=0.1)
    clearance = ClearanceMap(shapes, floor.high, top - base, low=floor.low, base=base)
    low, high = base, top
    if flying:
        ceiling = scenario.domain.extent[2]
        clearance.layers = Layers(shapes, clearance, ceiling, max(group.body.height for group in flying))
        low, high = 0.0, ceiling
    walking = [
        n
        for n, one in enumerate(resources.obstacles)
        if one.model.motion and np.isfinite(one.horizontal_distance(feet, low, high))
    ]
    return clearance, walking


def _box(scenario: Scenario, resources: Resources) -> tuple[Grid, Air]:
    """The grid, and what of it is air."""
    film = resources.films.get("wind")
    openings = scenario.openings
    grid = Grid.of(scenario.domain, film.periodic if film else periodic_axes(openings, scenario.domain.dim))
    if film:
        return grid, sealed(film.air(), resources.standing, grid)
    if resources.site:
        return grid, resources.site_air()
    return grid, air_of(resources.standing, grid, opening_cells(openings, grid))


def _around(scenario: Scenario, grid: Grid, air: Air) -> Surroundings:
    """What stops the beams of lasers, and how far apart the gas is to be taken along them."""
    finest = [gas.finest for _, gas in scenario.gases if gas.finest is not None]
    level = LevelSet(air, grid) if (air.volume < 1.0).any() else None
    return Surroundings(level, grid.extent, min([grid.dx / 8.0, *finest]), grid.dx)


def _wind(context: Context, reel: Reel | None) -> Wind:
    model = context.scenario.wind
    if reel is not None and reel.wind:
        return FilmedWind(reel, context.grid, context.begin[0])
    try:
        return WINDS[model.kind](model, context)
    except WindFileError as error:
        raise ScenarioError([f"wind.files: {error}"]) from None
    except ScenarioError:
        raise
    except ValueError as error:
        raise ScenarioError([f"wind.{error}"]) from None


def _gas(context: Context, path: str, wind: Wind, reel: Reel | None) -> Gas:
    """The gas at a place in the scenario."""
    model = dict(context.scenario.gases)[path]
    if reel is not None and path in reel.gases:
        return FilmedGas(reel, reel.gases.index(path), model, context.grid, context.air, context.begin[0])
    try:
        return GASES[model.kind](model, path, context, wind)
    except ValueError as error:
        raise ScenarioError([f"{path}.{error}"]) from None


def _weights(scenario: Scenario) -> dict[str, float]:
    """By how much a kg/m³ of each gas that makes the air heavier changes the air's density."""
    if scenario.buoyancy is None or not scenario.buoyancy.solutal:
        return {}
    return {path: model.vapour.weight_per_density for path, model in scenario.gases if model.weighs}


def _weigh(weighing: list[BuoyantScalar], scenario: Scenario) -> None:
    for one, weight in zip(weighing, _weights(scenario).values(), strict=True):
        one.weight = weight


def _own(scenario: Scenario, resources: Resources, algorithms: Mapping[str, type] | None) -> dict[str, type]:
    """The users' own classes by the names of their groups. Raises ScenarioError where one is missing."""
    found = {
        group.name: resources.own[f"robots[{n}].algorithm"]
        for n, group in enumerate(scenario.robots)
        if f"robots[{n}].algorithm" in resources.own
    } | dict(algorithms or {})
    missing = [
        f"robots[{n}].algorithm: no class of its own was handed over; name a Python file with file: FILE.py"
        for n, group in enumerate(scenario.robots)
        if isinstance(group.algorithm, Own) and group.name not in found
    ]
    if missing:
        raise ScenarioError(missing)
    return found


def _networks(scenario: Scenario, resources: Resources) -> dict[str, Network]:
    """Those of the policies by the names of their groups. Raises ScenarioError where one is still to be learnt."""
    policies = {
        f"robots[{n}].algorithm": group.name
        for n, group in enumerate(scenario.robots)
        if isinstance(group.algorithm, Policy)
    }
    missing = [path for path in policies if path not in resources.networks]
    if missing:
        what = "file: none is given, the policy is still to be learnt; learn it in an environment of taichi_plume.envs"
        raise ScenarioError([f"{path}.{what}" for path in missing])
    return {name: resources.networks[path] for path, name in policies.items()}


def _recorded(scenario: Scenario, resources: Resources) -> dict[str, Sequence[Way]]:
    """Ways of recorded robots by the names of the groups that go them."""
    paths = {f"robots[{n}].algorithm": group.name for n, group in enumerate(scenario.robots)}
    return {paths[path]: found for path, found in resources.ways.items()}


def _require_inside(scenario: Scenario) -> None:
    """Raise ScenarioError where something outside is to drive robots, and nothing does."""
    outside = [f"robots[{n}].algorithm" for n, group in enumerate(scenario.robots) if group.algorithm.outside]
    if outside:
        what = "external: nothing drives its robots here; run the scenario by python -m taichi_plume.serve"
        raise ScenarioError([f"{path}: {what}" for path in outside])


def _places(scenario: Scenario) -> np.ndarray:
    """Of the sources, (m, 3) [m]; in 2-D on the floor."""
    places = np.zeros((len(scenario.sources), 3))
    for row, (_, source) in zip(places, scenario.sources, strict=True):
        row[: len(source.position)] = source.position
    return places


def _start_numbers(seed: int, group: int, trial: int) -> np.random.Generator:
    """What places and headings of a group's trial are drawn from."""
    return generator(seed, f"start of group {group}, trial {trial}")


def _starts(
    scenario: Scenario, clearance: ClearanceMap, walkers: list[Obstacle]
) -> tuple[np.ndarray, np.ndarray]:
    """Where all robots start (n, 2) [m], and their headings (n,) [rad]."""
    trials = np.arange(max((group.trials for group in scenario.robots), default=1))
    occupied = [Placed(np.tile(one.center[:2], (len(trials), 1)), one.disc, trials) for one in walkers]
    positions, headings = [np.empty((0, 2))], [np.empty(0)]
    for n, group in enumerate(scenario.robots):
        draws = partial(_start_numbers, scenario.seed, n)
        try:
            distance: Any = clearance.distance_at
            if group.body.flies:
                distance = partial(clearance.layers.distance_at, z=group.start_altitude)
            where, heading = place(group, draws, distance, occupied)
        except ValueError as error:
            raise ScenarioError([f"robots[{n}].start: {error}"]) from None
        if not scenario.rivals:
            occupied.append(placed(group, where))
        positions.append(where)
        headings.append(heading)
    return np.concatenate(positions), np.concatenate(headings)
