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
from taichi_plume.scenario.sources import OneGas
from taichi_plume.scenario.vocabulary import Model
from taichi_plume.scenario.wind_base import AnyWind

if TYPE_CHECKING:
    from taichi_plume.solvers.momentum import BuoyantScalar
    from taichi_plume.solvers.screens import Resistance
    from taichi_plume.solvers.transport import Scalar


@dataclass(frozen=True)
class Context:
    """Scenario, files, grid and shared fields from which the solvers of wind and gas are constructed.

    scalars: concentrations on the grid of the gases that make the air heavier (buoyancy), by their paths in the
    scenario. weighing: the same, with the density change per kg/m³. resistances: functions that take the open
    fractions of the cell faces and return the drag of a moving obstacle or of robots' wakes.
    """

    scenario: Scenario
    resources: Resources
    grid: Grid
    air: Air
    scalars: "dict[str, Scalar]"
    weighing: "Sequence[BuoyantScalar]"
    resistances: "Sequence[Callable[[tuple[Any, ...]], Resistance]]"

    @property
    def start(self) -> float:
        """Simulated time at which the warm-up starts [s], 0 or negative."""
        return self.scenario.first_tick * self.scenario.tick


Solver = tuple[str, str, str]
"""Module and class of a solver, and the arguments of the constructor after the section, as `_make` names them."""

WINDS: dict[str, Solver] = {
    "cfd": ("flow", "FlowSolver", "grid air t seed weighing resistances"),
    "frozen": ("frozen_flow", "FrozenSolver", "grid air t seed weighing resistances"),
    "uniform": ("uniform_wind", "UniformSolver", "grid t seed"),
    "synthetic": ("synthetic_flow", "SyntheticSolver", "grid air t seed"),
    "playback": ("playback", "PlayedWind", "film grid t"),
    "imported": ("imported_flow", "ImportedFlow", "film grid t"),
    "plumesim_log": ("plumesim", "PointWind", "frames extent t"),
}
GASES: dict[str, Solver] = {
    "eulerian": ("gas", "EulerianSolver", "grid wind air t seed path scalar openings"),
    "puffs": ("puffs", "PuffSolver", "grid wind air t seed path"),
    "gaussian_plume": ("plumes", "Plumes", "grid wind t seed path"),
    "meandering": ("plumes", "Plumes", "grid wind t seed path"),
    "continuous": ("gaussian_puffs", "ContinuousPuffs", "grid wind t"),
    "gaussian_puff": ("gaussian_puffs", "GaussianPuffs", "grid wind t"),
    "plumesim_gaussian": ("plumesim", "ProgramPuff", "extent t"),
    "plumesim_meandering": ("plumesim", "ProgramMeander", "extent seed path"),
    "plumesim_log": ("plumesim", "PointGas", "frames extent t"),
    "fluent": ("plumesim", "PointGas", "frames extent t"),
    "playback": ("playback", "PlayedGas", "film grid t"),
    "movie": ("playback", "PlayedGas", "movie grid t"),
}


def make_wind(model: AnyWind, ctx: Context) -> Wind:
    """Return the solver of a wind section. Raises ScenarioError if obstacles cut an inlet off from all outlets."""
    resources, film = ctx.resources, ctx.resources.films.get("wind")
    if resources.site is not None:
        film = _solver("imported_flow", "ImportedFilm").of(resources.site, ctx.grid, ctx.air)
    wind = _make(WINDS, model, "wind", ctx, film=film)
    if model.computed is not None and (trapped := wind.boundaries.trapped(ctx.air.regions())):
        what = (
            "its air has no way to an outlet, obstacles close it off; move one of them or add an outlet there"
        )
        raise ScenarioError([f"wind.openings[{n}]: {what}" for n in trapped])
    if film is not None:  # a recorded wind advances in whole ticks unless a gas is solved on its grid
        wind.carries = any(gas.solved for _, gas in ctx.scenario.gases)
    return wind


def make_gas(model: OneGas, path: str, ctx: Context, wind: Wind) -> Gas:
    """Return the solver of a gas section; path: key of the section in the scenario, wind: flow that carries the gas."""
    return _make(GASES, model, path, ctx, wind=wind, film=ctx.resources.films.get(path))


def _make(kinds: dict[str, Solver], model: Model, path: str, ctx: Context, **parts: Any) -> Any:
    scenario, resources = ctx.scenario, ctx.resources
    parts |= {
        "grid": ctx.grid, "extent": ctx.grid.extent, "air": ctx.air, "path": path, "seed": scenario.seed_of_air,
        "t": ctx.start, "frames": resources.frames.get(path), "openings": scenario.openings,
        "movie": resources.movies.get(path), "scalar": ctx.scalars.get(path), "weighing": ctx.weighing,
        "resistances": ctx.resistances,
    }  # fmt: skip
    module, name, arguments = kinds[vars(model)["kind"]]
    return _solver(module, name)(model, *(parts[argument] for argument in arguments.split()))


def _solver(module: str, name: str) -> Any:
    return getattr(import_module(f"taichi_plume.solvers.{module}"), name)
