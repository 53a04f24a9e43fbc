"""Tables of the kinds of wind and gas, and the solver of each. Add a kind here.

A solver is imported when a scenario needs it: importing all takes as long as the rest of a start.
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
    """Parts of a simulation that solvers of wind and gas are made from, besides their own sections.

    scalars: concentrations on the grid of the gases that make the air heavier (buoyancy), by their paths in the
    scenario. weighing: the same, with their weights. resistances: constructors of drag of walkers and wakes, which take
    the open fractions of the faces.
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
        """Start of the run [s], and the seed of wind and gas."""
        return self.scenario.first_tick * self.scenario.tick, self.scenario.seed_of_air


def _of(module: str, name: str) -> Any:
    """Import a class of the solvers."""
    return getattr(import_module(f"taichi_plume.solvers.{module}"), name)


def _flow(solver: "type[FlowSolver]", model: Any, ctx: Context) -> "FlowSolver":
    flow = solver(model, ctx.grid, ctx.air, *ctx.begin, ctx.weighing, ctx.resistances)
    trapped = flow.boundaries.trapped(ctx.air.regions())
    if trapped:
        what = (
            "its air has no way to an outlet, obstacles close it off; move one of them or add an outlet there"
        )
        raise ScenarioError([f"wind.openings[{n}]: {what}" for n in trapped])
    return flow


def _imported(model: Any, ctx: Context) -> Wind:
    assert ctx.resources.site is not None
    film = _of("imported", "ImportedFilm")(ctx.resources.site, ctx.grid, ctx.air)
    return _played(_of("imported", "ImportedFlow")(model, film, ctx.grid, *ctx.begin), ctx)


def _played(wind: Any, ctx: Context) -> Wind:
    """Let a recorded wind advance in whole ticks unless a gas is solved on its grid."""
    wind.carries = any(gas.solved for _, gas in ctx.scenario.gases)
    return wind


WINDS: dict[str, Callable[[Any, Context], Wind]] = {
    "cfd": lambda model, ctx: _flow(_of("flow", "FlowSolver"), model, ctx),
    "frozen": lambda model, ctx: _flow(_of("frozen", "FrozenSolver"), model, ctx),
    "uniform": lambda model, ctx: _of("uniform", "UniformSolver")(model, ctx.grid, *ctx.begin),
    "synthetic": lambda model, ctx: _of("synthetic", "SyntheticSolver")(model, ctx.grid, ctx.air, *ctx.begin),
    "playback": lambda model, ctx: _played(
        _of("playback", "PlayedWind")(model, ctx.resources.films["wind"], ctx.grid, *ctx.begin), ctx
    ),
    "plumesim_log": lambda model, ctx: _of("plumesim", "PointWind")(
        model, ctx.resources.frames["wind"], ctx.grid.extent, *ctx.begin
    ),
    "imported": _imported,
}
"""Constructors of winds, from their sections."""


def _points(model: Any, path: str, ctx: Context, wind: Wind) -> Gas:
    return _of("plumesim", "PointGas")(model, ctx.resources.frames[path], ctx.grid.extent, ctx.begin[0])


def _plumes(model: Any, path: str, ctx: Context, wind: Wind) -> Gas:
    return _of("plumes", "Plumes")(model, ctx.grid, wind, *ctx.begin, path)


GASES: dict[str, Callable[[Any, str, Context, Wind], Gas]] = {
    "eulerian": lambda model, path, ctx, wind: _of("gas", "EulerianSolver")(
        model,
        ctx.grid,
        wind,
        ctx.air,
        *ctx.begin,
        path,
        ctx.scalars.get(path),
        ctx.scenario.openings,
    ),
    "puffs": lambda model, path, ctx, wind: _of("puffs", "PuffSolver")(
        model, ctx.grid, wind, ctx.air, *ctx.begin, path
    ),
    "gaussian_plume": _plumes,
    "meandering": _plumes,
    "continuous": lambda model, path, ctx, wind: _of("gaussian_puffs", "ContinuousPuffs")(
        model, ctx.grid, wind, ctx.begin[0]
    ),
    "gaussian_puff": lambda model, path, ctx, wind: _of("gaussian_puffs", "GaussianPuffs")(
        model, ctx.grid, wind, ctx.begin[0]
    ),
    "plumesim_gaussian": lambda model, path, ctx, wind: _of("plumesim", "ProgramPuff")(
        model, ctx.grid.extent, ctx.begin[0]
    ),
    "plumesim_meandering": lambda model, path, ctx, wind: _of("plumesim", "ProgramMeander")(
        model, ctx.grid.extent, *ctx.begin, path
    ),
    "plumesim_log": _points,
    "fluent": _points,
    "playback": lambda model, path, ctx, wind: _of("playback", "PlayedGas")(
        model, ctx.resources.films[path], ctx.grid, ctx.begin[0]
    ),
    "movie": lambda model, path, ctx, wind: _of("playback", "PlayedGas")(
        model, ctx.resources.movies[path], ctx.grid, ctx.begin[0]
    ),
}
"""Constructors of gases, from their sections, their paths in the scenario, and the wind that carries them."""
