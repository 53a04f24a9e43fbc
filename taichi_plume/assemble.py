"""Scenario -> Simulation: the one place that knows all parts."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.mapping import mappers
from taichi_plume.agents.placement import Placed, place, placed
from taichi_plume.agents.swarm import Swarm, disc_around
from taichi_plume.agents.team import Team
from taichi_plume.files.film import Film, completed
from taichi_plume.files.gaden import Cubes
from taichi_plume.files.point_frames import frames_of
from taichi_plume.files.site import Site
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.cut_cells import Air, air_of
from taichi_plume.grid.fields import Gas, Mixture, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.closed_forms import (
    ClosedForm,
    ContinuousGas,
    GaussianPlumeGas,
    GaussianPuffGas,
    MeanderingGas,
)
from taichi_plume.scenario.gases import EulerianGas, PlaybackGas, PuffGas, PureGas
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.obstacles import motion_of
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas, PlumeSimMeander, PlumeSimPuff
from taichi_plume.scenario.resources import shapes
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import (
    CfdWind,
    FrozenWind,
    ImportedWind,
    PlaybackWind,
    PlumeSimWind,
    SyntheticWind,
    UniformWind,
)
from taichi_plume.simulation import Simulation
from taichi_plume.solvers.bodies import MovingObstacle, Wake
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.forces import forces
from taichi_plume.solvers.frozen import FrozenSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.gaussian_puffs import ContinuousPuffs, GaussianPuffs
from taichi_plume.solvers.imported import ImportedFilm, ImportedFlow
from taichi_plume.solvers.momentum import Weighing
from taichi_plume.solvers.patches import opening_cells, periodic_axes
from taichi_plume.solvers.playback import PlayedGas, PlayedWind
from taichi_plume.solvers.plumes import Plumes
from taichi_plume.solvers.plumesim import PointGas, PointWind, ProgramMeander, ProgramPuff
from taichi_plume.solvers.puffs import PuffSolver
from taichi_plume.solvers.resistance import Resistance
from taichi_plume.solvers.scalar import Scalar
from taichi_plume.solvers.synthetic import SyntheticSolver
from taichi_plume.solvers.uniform import UniformSolver


def assemble(
    scenario: Scenario, folder: Path = Path(), algorithms: Mapping[str, type] | None = None
) -> Simulation:
    """The simulation of a checked scenario, at the begin of its warm-up; Taichi must have been started.

    folder: where the scenario's meshes and films lie. algorithms: own classes by the name of the group that they drive
    (its algorithm is of kind own, see agents/own.py). Raises ScenarioError where robots do not fit.
    """
    scenario = completed(scenario, folder)
    obstacles = shapes(scenario, folder)
    standing = [one if motion_of(one.model) is None else None for one in obstacles]
    openings = scenario.wind.openings if isinstance(scenario.wind, CfdWind) else ()
    film = Film(folder / scenario.wind.file) if isinstance(scenario.wind, PlaybackWind) else None
    grid = Grid.of(scenario.domain, film.periodic if film else periodic_axes(openings, scenario.domain.dim))
    site = None
    if isinstance(scenario.wind, ImportedWind):
        site = Site(scenario.wind, scenario.domain.dim, folder)
    cubes = site.cubes if site else None
    if film:
        air = film.air()
    elif site:
        air = air_of(standing, grid, left=cubes.shares(grid) if cubes else None)
    else:
        air = air_of(standing, grid, opening_cells(openings, grid))
    swarm = _swarm(scenario, obstacles, grid, cubes)
    scalars = {path: Scalar(grid) for path, model in scenario.gases if isinstance(model, EulerianGas)}
    if isinstance(scenario.wind, CfdWind):
        resistances = [partial(MovingObstacle, one.model, grid) for one in obstacles if motion_of(one.model)]
        resistances += _wakes(swarm, grid)
        wind = _flow(scenario, grid, air, _weighing(scenario, scalars), resistances)
    else:
        wind = _wind(scenario, film, site, folder, grid, air)
    gas = Mixture(
        [
            _gas(model, path, scenario, folder, grid, wind, air, scalars.get(path))
            for path, model in scenario.gases
        ]
    )
    own = algorithms or {}
    teams = [
        Team(swarm, group, grid.dim, scenario.tick, folder, own.get(group.name)) for group in swarm.groups
    ]
    floor = Floor(
        (grid.extent[0], grid.extent[1]),
        max(1, swarm.trials),
        swarm.members.shape[1],
        scenario.tick,
        swarm.clearance.obstacle_distance_at,
    )
    maps = mappers(scenario.maps, floor)
    seen = [*obstacles, *([cubes] if cubes else [])]
    sim = Simulation(scenario, grid, wind, gas, swarm, list(teams), list(maps), seen, air)
    if isinstance(wind, FlowSolver) and wind.area is not None:
        sim.forces = partial(forces, wind, air, len(obstacles))
    return sim


def _wind(
    scenario: Scenario, film: Film | None, site: Site | None, folder: Path, grid: Grid, air: Air
) -> Wind:
    """The wind; `film` is the one that is played back, `site` has the files of an imported one."""
    model, begin = scenario.wind, scenario.first_tick * scenario.tick
    if isinstance(model, UniformWind):
        return UniformSolver(model, grid, begin, scenario.seed)
    if isinstance(model, SyntheticWind):
        return SyntheticSolver(model, grid, air, begin, scenario.seed)
    if isinstance(model, PlaybackWind):
        assert film is not None
        return PlayedWind(model, film, grid, begin)
    if isinstance(model, PlumeSimWind):
        return PointWind(model, frames_of(model, folder), grid.extent, begin)
    if isinstance(model, ImportedWind):
        assert site is not None
        try:
            return ImportedFlow(ImportedFilm(site, grid, air), model, grid, begin)
        except WindFileError as error:
            raise ScenarioError([f"wind.files: {error}"]) from None
    raise AssertionError(f"wind.kind: {model.kind}")


def _flow(
    scenario: Scenario,
    grid: Grid,
    air: Air,
    weighing: Sequence[Weighing],
    resistances: Sequence[Callable[..., Resistance]],
) -> FlowSolver:
    """A computed flow; weighing: what makes the air heavier, resistances: what holds it besides screens."""
    model, begin = scenario.wind, scenario.first_tick * scenario.tick
    assert isinstance(model, CfdWind)
    try:
        if isinstance(model, FrozenWind):
            flow = FrozenSolver(model, grid, air, begin, scenario.seed, weighing, resistances)
        else:
            flow = FlowSolver(model, grid, air, begin, scenario.seed, weighing, resistances)
    except ValueError as error:
        raise ScenarioError([f"wind.{error}"]) from None
    trapped = flow.boundaries.trapped(air.regions())
    if trapped:
        raise ScenarioError(
            [
                f"wind.openings[{n}]: its air has no way to an outlet, obstacles close it off; "
                "move one of them or add an outlet there"
                for n in trapped
            ]
        )
    return flow


def _gas(
    model: PureGas,
    path: str,
    scenario: Scenario,
    folder: Path,
    grid: Grid,
    wind: Wind,
    air: Air,
    scalar: Scalar | None,
) -> Gas:
    """One gas; `path` is its place in the scenario, `scalar` its concentration on the grid, where it has one."""
    begin = scenario.first_tick * scenario.tick
    if isinstance(model, PlaybackGas):
        return PlayedGas(model, Film(folder / model.file), grid, begin)
    if isinstance(model, PlumeSimGas | FluentGas):
        return PointGas(model, frames_of(model, folder), grid.extent, begin)
    if isinstance(model, PlumeSimPuff):
        return ProgramPuff(model, grid.extent, begin)
    if isinstance(model, PlumeSimMeander):
        return ProgramMeander(model, grid.extent, begin, scenario.seed, path)
    if isinstance(model, ClosedForm):
        return _closed_form(model, path, scenario, grid, wind)
    try:
        if isinstance(model, PuffGas):
            return PuffSolver(model, grid, wind, air, begin, scenario.seed, path)
        return EulerianSolver(model, grid, wind, air, begin, scenario.seed, path, scalar)
    except ValueError as error:
        raise ScenarioError([f"{path}.{error}"]) from None


def _closed_form(model: ClosedForm, path: str, scenario: Scenario, grid: Grid, wind: Wind) -> Gas:
    """A gas that a formula tells; `path` is its place in the scenario."""
    begin = scenario.first_tick * scenario.tick
    assert isinstance(wind, UniformSolver)
    if isinstance(model, GaussianPuffGas):
        return GaussianPuffs(model, grid, wind, begin)
    if isinstance(model, ContinuousGas):
        return ContinuousPuffs(model, grid, wind, begin)
    assert isinstance(model, GaussianPlumeGas | MeanderingGas)
    return Plumes(model, grid, wind, begin, scenario.seed, path)


def _weighing(scenario: Scenario, scalars: dict[str, Scalar]) -> list[Weighing]:
    """The gases that make the air heavier; scalars: concentrations [kg/m³] by the gas's place in the scenario."""
    buoyancy = scenario.wind.buoyancy if isinstance(scenario.wind, CfdWind) else None
    if buoyancy is None or not buoyancy.solutal:
        return []
    return [
        Weighing(scalars[path].q, model.vapour.weight_per_density)
        for path, model in scenario.gases
        if path in scalars
    ]


def _wakes(swarm: Swarm, grid: Grid) -> list[Callable[..., Resistance]]:
    """What robots that disturb the air do to it."""
    return [
        partial(Wake, group.model.body, grid, swarm.position, swarm.velocity, group.start, group.count)
        for group in swarm.groups
        if group.model.wake
    ]


def _start_numbers(seed: int, group: int, trial: int) -> np.random.Generator:
    """What places and headings of a group's trial are drawn from."""
    return generator(seed, f"start of group {group}, trial {trial}")


def _swarm(scenario: Scenario, obstacles: list, grid: Grid, cubes: Cubes | None) -> Swarm:
    """All robots at their places; `cubes` stand in their way too."""
    height = max((group.body.height for group in scenario.robots), default=0.1)
    standing = [s for s in obstacles if motion_of(s.model) is None] + ([cubes] if cubes else [])
    floor = scenario.floor
    clearance = ClearanceMap(standing, floor.high, height, low=floor.low)
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
        draws = partial(_start_numbers, scenario.seed, n)
        try:
            where, heading = place(group, draws, clearance.distance_at, occupied)
        except ValueError as error:
            raise ScenarioError([f"robots[{n}].start: {error}"]) from None
        if not scenario.rivals:
            occupied.append(placed(group, where))
        positions.append(where)
        headings.append(heading)
    sources = np.array([source.position[:2] for _, source in scenario.sources])
    return Swarm(
        scenario.robots,
        np.concatenate(positions),
        np.concatenate(headings),
        clearance,
        sources,
        scenario.seed,
        walkers,
        scenario.rivals,
    )
