"""The kinds of wind and of gas that a scenario may have, and what computes each. Add one here.

A solver is imported when a scenario needs it: together they take as long as the rest of a start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from taichi_plume.assembly.resources import Resources
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Gas, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario

if TYPE_CHECKING:
    from taichi_plume.solvers.flow import FlowSolver
    from taichi_plume.solvers.momentum import BuoyantScalar
    from taichi_plume.solvers.screens import Resistance
    from taichi_plume.solvers.transport import Scalar


@dataclass(frozen=True)
class Context:
    """What winds and gases are made of besides their own sections.

    scalars: concentrations on the grid of the gases that make the air heavier, by their places in the scenario.
    weighing: the same, with how much. resistances: make what holds the air besides screens, of the faces' openness.
    """

    scenario: Scenario
    resources: Resources
    grid: Grid
    air: Air
    scalars: "dict[str, Scalar]"
    weighing: "Sequence[BuoyantScalar]"
    resistances: "Sequence[Callable[[tuple[Any, ...]], Resistance]]"

    @property
    def begin(self) -> tuple[float, int]:
        """Time [s] at which the run begins, and the seed of its air."""
        return self.scenario.first_tick * self.scenario.tick, self.scenario.seed_of_air


def _of(module: str, name: str) -> Any:
    """A class of the solvers."""
    return getattr(import_module(f"taichi_plume.solvers.{module}"), name)


def _flow(solver: "type[FlowSolver]", model: Any, its: Context) -> "FlowSolver":
    flow = solver(model, its.grid, its.air, *its.begin, its.weighing, its.resistances)
    trapped = flow.boundaries.trapped(its.air.regions())
    if trapped:
        raise ScenarioError(
            [
                f"wind.openings[{n}]: its air has no way to an outlet, obstacles close it off; "
                "move one of them or add an outlet there"
                for n in trapped
            ]
        )
    return flow


def _imported(model: Any, its: Context) -> Wind:
    assert its.resources.site is not None
    film = _of("imported", "ImportedFilm")(its.resources.site, its.grid, its.air)
    return _played(_of("imported", "ImportedFlow")(model, film, its.grid, *its.begin), its)


def _played(wind: Any, its: Context) -> Wind:
    """A wind of frames, which goes in whole ticks where no gas is solved for."""
    wind.carries = any(gas.solved for _, gas in its.scenario.gases)
    return wind


WINDS: dict[str, Callable[[Any, Context], Wind]] = {
    "cfd": lambda model, its: _flow(_of("flow", "FlowSolver"), model, its),
    "frozen": lambda model, its: _flow(_of("frozen", "FrozenSolver"), model, its),
    "uniform": lambda model, its: _of("uniform", "UniformSolver")(model, its.grid, *its.begin),
    "synthetic": lambda model, its: _of("synthetic", "SyntheticSolver")(model, its.grid, its.air, *its.begin),
    "playback": lambda model, its: _played(
        _of("playback", "PlayedWind")(model, its.resources.films["wind"], its.grid, *its.begin), its
    ),
    "plumesim_log": lambda model, its: _of("plumesim", "PointWind")(
        model, its.resources.frames["wind"], its.grid.extent, *its.begin
    ),
    "imported": _imported,
}
"""Of a wind's section."""


def _points(model: Any, path: str, its: Context, wind: Any) -> Gas:
    return _of("plumesim", "PointGas")(model, its.resources.frames[path], its.grid.extent, its.begin[0])


def _plumes(model: Any, path: str, its: Context, wind: Any) -> Gas:
    return _of("plumes", "Plumes")(model, its.grid, wind, *its.begin, path)


GASES: dict[str, Callable[[Any, str, Context, Any], Gas]] = {
    "eulerian": lambda model, path, its, wind: _of("gas", "EulerianSolver")(
        model, its.grid, wind, its.air, *its.begin, path, its.scalars.get(path), its.scenario.openings
    ),
    "puffs": lambda model, path, its, wind: _of("puffs", "PuffSolver")(
        model, its.grid, wind, its.air, *its.begin, path
    ),
    "gaussian_plume": _plumes,
    "meandering": _plumes,
    "continuous": lambda model, path, its, wind: _of("gaussian_puffs", "ContinuousPuffs")(
        model, its.grid, wind, its.begin[0]
    ),
    "gaussian_puff": lambda model, path, its, wind: _of("gaussian_puffs", "GaussianPuffs")(
        model, its.grid, wind, its.begin[0]
    ),
    "plumesim_gaussian": lambda model, path, its, wind: _of("plumesim", "ProgramPuff")(
        model, its.grid.extent, its.begin[0]
    ),
    "plumesim_meandering": lambda model, path, its, wind: _of("plumesim", "ProgramMeander")(
        model, its.grid.extent, *its.begin, path
    ),
    "plumesim_log": _points,
    "fluent": _points,
    "playback": lambda model, path, its, wind: _of("playback", "PlayedGas")(
        model, its.resources.films[path], its.grid, its.begin[0]
    ),
    "movie": lambda model, path, its, wind: _of("playback", "PlayedMovie")(
        model, its.resources.movies[path], its.grid, its.begin[0]
    ),
}
"""Of a gas's section, its place in the scenario, and the wind that carries it."""
