"""Tables of the kinds of wind and gas, and the solver of each. Add a kind here.

A solver is imported when a scenario needs it: importing all takes as long as the rest of a start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from typing import TYPE_CHECKING, Any

from taichi_plume.assembly.resources import Resources
from taichi_plume.files.own_class import NO_CLASS
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Gas, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.own_code import OwnLaw
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


WINDS: dict[str, str] = {
    "cfd": "flow.FlowSolver",
    "frozen": "frozen_flow.FrozenSolver",
    "uniform": "uniform_wind.UniformSolver",
    "synthetic": "synthetic_flow.SyntheticSolver",
    "playback": "playback.PlayedWind",
    "imported": "imported_flow.ImportedFlow",
    "plumesim_log": "plumesim.PointWind",
    "own": "own_laws.OwnFlow",
}
GASES: dict[str, str] = {
    "eulerian": "gas.EulerianSolver",
    "puffs": "puffs.PuffSolver",
    "gaussian_plume": "plumes.Plumes",
    "meandering": "plumes.Plumes",
    "continuous": "gaussian_puffs.ContinuousPuffs",
    "gaussian_puff": "gaussian_puffs.GaussianPuffs",
    "plumesim_gaussian": "plumesim.ProgramPuff",
    "plumesim_meandering": "plumesim.ProgramMeander",
    "plumesim_log": "plumesim.PointGas",
    "fluent": "plumesim.PointGas",
    "playback": "playback.PlayedGas",
    "movie": "playback.PlayedGas",
    "gaden": "playback.PlayedGas",
    "own": "own_laws.OwnGasField",
}
"""Modules and classes of the solvers, by kind. `_make` passes the arguments that the constructor names."""


def make_wind(model: AnyWind, ctx: Context) -> Wind:
    """Return the solver of a wind section. Raises ScenarioError if obstacles cut an inlet off from all outlets."""
    resources, film = ctx.resources, ctx.resources.films.get("wind")
    if resources.site is not None:
        film = _solver("imported_flow.ImportedFilm").of(resources.site, ctx.grid, ctx.air)
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
    found = (ctx.resources.films, ctx.resources.movies, ctx.resources.gaden_films)
    film = next((films[path] for films in found if path in films), None)
    return _make(GASES, model, path, ctx, wind=wind, film=film)


def _make(kinds: dict[str, str], model: Model, path: str, ctx: Context, **parts: Any) -> Any:
    parts |= vars(ctx) | {
        "extent": ctx.grid.extent, "name": path, "seed": ctx.scenario.seed_of_air, "t": ctx.start,
        "frames": ctx.resources.frames.get(path), "openings": ctx.scenario.openings, "scalar": ctx.scalars.get(path),
    }  # fmt: skip
    if isinstance(model, OwnLaw):
        parts["law"] = ctx.resources.code_of(path, model)
        if parts["law"] is None:
            raise ScenarioError([f"{path}: {NO_CLASS}"])
    solver = _solver(kinds[vars(model)["kind"]])
    _, *names = signature(solver).parameters
    return solver(model, **{name: parts[name] for name in names})


def _solver(path: str) -> Any:
    module, name = path.split(".")
    return getattr(import_module(f"taichi_plume.solvers.{module}"), name)
