"""Assembly of a `TimeLoop` (grid, wind, gas, robots, sensors) from a checked scenario."""

import gc
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import prod
from pathlib import Path
from typing import Any, cast

import numpy as np

from taichi_plume.agents.gas_classes import classifiers
from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.groups import GroupRange, sensor_heights
from taichi_plume.agents.line_sensors import Surroundings
from taichi_plume.agents.mapping import mappers
from taichi_plume.agents.placement import Placed, place, placed
from taichi_plume.agents.received_readings import ReceivedReadings
from taichi_plume.agents.room import Room
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.team import teams
from taichi_plume.assembly.initial_conditions import set_initial_conditions
from taichi_plume.assembly.own_code import execute
from taichi_plume.assembly.preparation import Prepared, again, checked
from taichi_plume.assembly.resources import Resources
from taichi_plume.assembly.solver_table import Context, make_gas, make_wind
from taichi_plume.engine import program
from taichi_plume.files.gaden import Cubes
from taichi_plume.files.network import Network, NetworkError
from taichi_plume.files.own_class import NO_CLASS
from taichi_plume.files.trajectories import Way
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.grid.blas import one_blas_thread
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.cut_cells import Air, air_of, sealed
from taichi_plume.grid.fields import Faces, Gas, GridGas, Mixture, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.layers import Layers
from taichi_plume.grid.level_set import LevelSet
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.gases import PureGas
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.species import Species
from taichi_plume.solvers.bodies import MovingObstacle, Wake
from taichi_plume.solvers.downwash import Downwash
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.forces import Forces
from taichi_plume.solvers.momentum import BuoyantScalar
from taichi_plume.solvers.openings import opening_cells, periodic_axes
from taichi_plume.solvers.playback import TickFilm, TickGas, TickWind
from taichi_plume.solvers.screens import Resistance
from taichi_plume.solvers.transport import Scalar
from taichi_plume.solvers.unresolved import Unresolved
from taichi_plume.time_loop import TimeLoop

LARGE = 100_000  # cells of a simulation whose memory is freed before the next is built


def assemble(
    scenario: Scenario,
    folder: Path = Path(),
    allow_code: bool = False,
    allow_outside: bool = False,
    driven: bool = False,
) -> TimeLoop:
    """Check a scenario and return its simulation, at the start of its warm-up.

    Starts Taichi on the CPU unless it runs; `grid.program.start` takes another device. folder: folder of the
    scenario's files. allow_code: whether the scenario's Python files are executed. allow_outside: whether files may lie
    outside `folder`. driven: whether the caller moves the external robots (see agents/external.py). Raises
    ScenarioError, with a line for each fault.
    """
    prepared = checked(scenario, Path(folder), allow_outside)
    execute(prepared, allow_code)
    program.ensure_started()
    return build(prepared, driven=driven)


@one_blas_thread
def build(
    prepared: Prepared,
    film: TickFilm | None = None,
    driven: bool = False,
    running: TimeLoop | None = None,
) -> TimeLoop:
    """Return the simulation of a checked scenario, at the start of its warm-up; Taichi must have been started.

    Users' algorithm files must have been executed, see own_code. film: recorded wind or gas that is played instead of
    solving for them. driven: whether external robots are driven. running: simulation whose users' algorithms go on, see
    `TimeLoop.rebuild`. Raises ScenarioError if robots do not fit, or nothing drives them.
    """
    scenario, resources = prepared
    if prod(scenario.domain.shape) > LARGE:
        gc.collect()  # earlier simulations: their parts refer to each other
    own, networks, recorded = _drivers(scenario, resources, driven)
    grid, air = _box(scenario, resources)
    cubes = resources.site.cubes if resources.site else None
    seen = [*resources.obstacles, *([cubes] if cubes else [])]
    clearance, walking = ways(scenario, resources, cubes)
    walkers = [scenario.obstacles[n] for n in walking]
    starts, sources = _starts(scenario, clearance, walkers), _places(scenario)
    swarm = Swarm(
        scenario.robots,
        *starts,
        clearance,
        sources,
        scenario.seed,
        walkers,
        scenario.rivals,
        background=any(scenario.backgrounds.values()),
        room=Room(scenario.domain.extent, scenario.domain.depth, scenario.passes_edge, _sought(scenario)),
        sources_at=scenario.targets_at if scenario.sources_change else None,
    )
    swarm.priors = _of_groups(resources.priors, "algorithm.prior", scenario)
    weights = _weights(scenario)
    scalars = {path: Scalar(grid, takes_space=True) for path in weights}
    weighing = [BuoyantScalar(scalar.q, weights[path], scalar.source) for path, scalar in scalars.items()]
    context = Context(scenario, resources, grid, air, scalars, weighing, _stirring(scenario, swarm, grid))
    wind = _wind(context, film)
    gases = [_gas(context, path, model, wind, film) for path, model in scenario.gases]
    unresolved = [
        Unresolved(cast(GridGas, gas), wind, model.vapour.diffusivity)
        if getattr(model, "fluctuations", False)
        else None
        for gas, (_, model) in zip(gases, scenario.gases, strict=True)
    ]
    gas = Mixture(gases, unresolved, scenario.backgrounds)
    if film is None:
        set_initial_conditions(scenario, resources, wind, gas.gases)
    around = partial(_around, scenario, grid, air)
    sensors = Sensors(swarm, grid.dim, scenario.tick, gas.species, around, gas.fluctuates, gas.background)
    sensors.classify_by(classifiers(swarm, _of_groups(resources.classifiers, "sensors.classifier", scenario)))
    try:
        driving = teams(swarm, scenario.tick, own, networks, recorded, running.teams if running else ())
    except NetworkError as error:
        raise ScenarioError([str(error)]) from None
    extent, most = (grid.extent[0], grid.extent[1]), swarm.members.shape[1]
    mapped = Floor(
        extent,
        max(1, swarm.trials),
        most,
        scenario.tick,
        clearance.obstacle_distance_at,
        scenario.passes_edge,
        sensors.lasers,
        grid.extent,
        clearance.solid_distance_at,
        sensor_heights(swarm.groups),
    )
    maps = mappers(scenario.maps, mapped)
    makers = {gas_map.robot for gas_map in scenario.maps if gas_map.robot is not None}
    received = {robot: ReceivedReadings(swarm, robot) for robot in sorted(makers)}
    rebuild = partial(_rebuild, prepared, film, driven)
    forces = None
    if isinstance(wind, FlowSolver) and wind.area is not None:
        forces = Forces(wind, air, len(resources.obstacles))
    return TimeLoop(
        scenario, grid, wind, gas, swarm, sensors, driving, maps, seen, air, rebuild, forces, received
    )


def _rebuild(
    prepared: Prepared,
    film: TickFilm | None,
    driven: bool,
    scenario: Scenario,
    running: TimeLoop | None = None,
) -> TimeLoop:
    """Return a new simulation of another scenario, see `TimeLoop.rebuild`."""
    other = again(prepared, scenario)
    execute(other, other.resources.allow_code)
    return build(other, film, driven, running)


def _stirring(scenario: Scenario, swarm: Swarm, grid: Grid) -> list[Callable[[Faces], Resistance]]:
    """Return the functions that take the open fractions of the cell faces, and return the drag of a moving obstacle or
    of the wakes of a group.
    """
    moving = (obstacle for obstacle in scenario.obstacles if obstacle.motion)
    stirring = (group for group in swarm.groups if group.model.wake)
    return [
        *(partial(MovingObstacle, obstacle, grid) for obstacle in moving),
        *(partial(_wake, group, swarm, grid) for group in stirring),
    ]


def _wake(group: GroupRange, swarm: Swarm, grid: Grid, open: Faces) -> Resistance:
    body, robots = group.model.body, (group.start, group.count)
    if not body.flies:
        return Wake(body, grid, swarm.position, swarm.velocity, *robots, open)
    flight = swarm.position, swarm.heading, swarm.altitude, swarm.acceleration
    return Downwash(body, grid, *flight, *robots, open)


def ways(scenario: Scenario, resources: Resources, cubes: Cubes | None) -> tuple[ClearanceMap, list[int]]:
    """Return a map of distances to standing obstacles, and the indices of moving obstacles at the robots' altitudes."""
    flying = [group for group in scenario.robots if group.body.flies]
    driving = [group for group in scenario.robots if not group.body.flies]
    standing: list[Any] = [shape for shape in resources.standing if shape is not None]
    shapes, floor, feet = [*standing, *([cubes] if cubes else [])], scenario.floor, np.zeros((1, 2))
    # algorithms of the floor see obstacles there or, with drones alone, at the altitudes of their starts
    groups = driving or flying
    base = min((group.start_altitude for group in groups), default=0.0)
    top = max((group.start_highest + group.body.height for group in groups), default=0.1)
    clearance = ClearanceMap(shapes, floor.high, top - base, low=floor.low, base=base)
    low, high = base, top
    if flying:
        ceiling = scenario.domain.extent[2]
        clearance.layers = Layers(shapes, clearance, ceiling, max(group.body.height for group in flying))
        low, high = 0.0, ceiling
    walking = [
        n
        for n, shape in enumerate(resources.obstacles)
        if shape.model.motion and np.isfinite(shape.horizontal_distance(feet, low, high))
    ]
    return clearance, walking


def _box(scenario: Scenario, resources: Resources) -> tuple[Grid, Air]:
    """Return the grid of the domain, and the open (fluid) fractions of its cells and faces."""
    film = resources.films.get("wind")
    openings = scenario.openings
    grid = Grid.of(scenario.domain, film.periodic if film else periodic_axes(openings, scenario.domain.dim))
    if film:
        return grid, sealed(film.air(), resources.standing, grid)
    if resources.site:
        return grid, resources.site_air()
    return grid, air_of(resources.standing, grid, opening_cells(openings, grid))


def _around(scenario: Scenario, grid: Grid, air: Air) -> Surroundings:
    """Return the surroundings of laser gas sensors: surfaces that stop beams, and the sampling step along a beam."""
    finest = [gas.finest for _, gas in scenario.gases if gas.finest is not None]
    level = LevelSet(air, grid) if (air.volume < 1.0).any() else None
    return Surroundings(level, grid.extent, min([grid.dx / 8.0, *finest]), grid.dx)


def _wind(context: Context, film: TickFilm | None) -> Wind:
    model = context.scenario.wind
    if film is not None and film.wind:
        return TickWind(film, context.grid, context.start)
    try:
        return make_wind(model, context)
    except WindFileError as error:
        raise ScenarioError([f"wind.files: {error}"]) from None
    except ScenarioError:
        raise
    except ValueError as error:
        raise ScenarioError([f"wind.{error}"]) from None


def _gas(context: Context, path: str, model: PureGas, wind: Wind, film: TickFilm | None) -> Gas:
    if film is not None and path in film.gases:
        return TickGas(film, film.gases.index(path), model, context.grid, context.air, context.start)
    try:
        return make_gas(model, path, context, wind)
    except ScenarioError:
        raise
    except ValueError as error:
        raise ScenarioError([f"{path}.{error}"]) from None


def _weights(scenario: Scenario) -> dict[str, float]:
    """Return the relative change of the air's density per kg/m³ of each gas with solutal buoyancy, by the gas's key."""
    if scenario.buoyancy is None or not scenario.buoyancy.solutal:
        return {}
    return {path: model.vapour.weight_per_density for path, model in scenario.gases if model.weighs}


def _drivers(
    scenario: Scenario, resources: Resources, driven: bool
) -> tuple[dict[str, type], dict[str, Network], dict[str, Sequence[Way]]]:
    """Return users' algorithm classes, policy networks and recorded robot paths, each by the names of the groups.

    Raises ScenarioError if a group lacks one, or if external robots exist and `driven` is false.
    """
    own, networks, recorded = {}, {}, {}
    faults: list[str] = []
    for n, group in enumerate(scenario.robots):
        path, kind = f"robots[{n}].algorithm", group.algorithm.kind
        if isinstance(group.algorithm, Own):
            code = resources.code_of(path, group.algorithm)
            if isinstance(code, type):
                own[group.name] = code
            else:
                faults.append(f"{path}: {NO_CLASS}")
        if path in resources.networks:
            networks[group.name] = resources.networks[path]
        if path in resources.ways:
            recorded[group.name] = resources.recorded_paths(path)
        if kind == "policy" and group.name not in networks:
            what = "none is given, the policy is still to be learnt; learn it in an environment of taichi_plume.envs"
            faults.append(f"{path}.file: {what}")
        if group.algorithm.outside and not driven:
            what = "nothing drives its robots here; run the scenario by python -m taichi_plume.serve"
            faults.append(f"{path}: external: {what}")
    if faults:
        raise ScenarioError(faults)
    return own, networks, recorded


def _of_groups(opened: Mapping[str, Any], key: str, scenario: Scenario) -> dict[int, Any]:
    """Return what was opened for a key of the groups of robots, such as ``algorithm.prior``, by the groups' numbers."""
    paths = {n: f"robots[{n}].{key}" for n in range(len(scenario.robots))}
    return {n: opened[path] for n, path in paths.items() if path in opened}


def _places(scenario: Scenario) -> np.ndarray:
    """Return the positions of the gas sources, (m, 3) [m]; in 2-D z is 0."""
    return np.reshape([(*source.position, 0.0)[:3] for _, source in scenario.sources], (-1, 3))


def _sought(scenario: Scenario) -> Species | None:
    """Return the species of the first gas whose sources robots search for; None without one."""
    return next((gas.vapour for _, gas in scenario.gases if gas.sources and gas.searched), None)


def _start_generator(seed: int, group: int, trial: int) -> np.random.Generator:
    """Return the random generator for the start positions and headings of a robot group in a trial."""
    return generator(seed, f"start of group {group}, trial {trial}")


def _starts(
    scenario: Scenario, clearance: ClearanceMap, walkers: list[Obstacle]
) -> tuple[np.ndarray, np.ndarray]:
    """Return start positions (n, 2) [m] and headings (n,) [rad] of all robots. Raises ScenarioError."""
    trials = np.arange(max((group.trials for group in scenario.robots), default=1))
    occupied = [
        Placed(np.tile(walker.center[:2], (len(trials), 1)), walker.disc, trials) for walker in walkers
    ]
    positions, headings = [np.empty((0, 2))], [np.empty(0)]
    for n, group in enumerate(scenario.robots):
        draws = partial(_start_generator, scenario.seed, n)
        try:
            distance: Callable[..., np.ndarray] = clearance.distance_at
            if group.body.flies:
                distance = partial(
                    clearance.layers.distance_above, low=group.start_altitude, high=group.start_highest
                )
            where, heading = place(group, draws, distance, occupied)
        except ValueError as error:
            raise ScenarioError([f"robots[{n}].start: {error}"]) from None
        if not scenario.rivals:
            occupied.append(placed(group, where))
        positions.append(where)
        headings.append(heading)
    return np.concatenate(positions), np.concatenate(headings)
