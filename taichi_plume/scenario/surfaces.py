"""Boundary conditions of gas and heat: walls, obstacles and openings that exchange them with the air."""

from collections.abc import Iterator
from typing import Annotated, ClassVar

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.opening_base import Change
from taichi_plume.scenario.vocabulary import Model, consistency_check, exactly_one, ordered_schedule
from taichi_plume.scenario.windows import Region

Number = Annotated[int, Field(ge=0, le=1_000_000)]
"""Index in a list of the scenario, counted from 0."""


class OnObstacle(Model):
    """Base class of boundary conditions at an obstacle."""

    number: Number
    """Index of the obstacle in `obstacles`, counted from 0."""


class Surfaces(Model):
    """Base class of boundary conditions at `walls` and `obstacles`."""

    what: ClassVar[str] = "surface"
    """Noun for the condition of an obstacle in messages."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        walls: tuple[Region, ...] = vars(self)["walls"]
        for n, wall in enumerate(walls):
            yield from wall.on_its_face(f"{where}.walls[{n}]", context)
            for m, opening in enumerate(context.scenario.openings):
                if opening.wraps == wall.face[0]:
                    yield (
                        f"{where}.walls[{n}].face: there is no wall {wall.face}, wind.openings[{m}] makes axis "
                        f"{opening.wraps} periodic; remove one of them"
                    )
            for m, other in enumerate(walls[:n]):
                if wall.overlaps(other, context.domain):
                    yield (
                        f"{where}.walls[{n}]: overlaps {where}.walls[{m}] on face {wall.face}; "
                        "give both a center and a size that leave them apart"
                    )
        numbers = [obstacle.number for obstacle in vars(self)["obstacles"]]
        count = len(context.scenario.obstacles)
        for n, number in enumerate(numbers):
            path = f"{where}.obstacles[{n}].number"
            if number >= count:
                allowed = f"use 0 to {count - 1}" if count else "there are none"
                yield f"{path}: there is no obstacles[{number}]; {allowed}"
            elif number in numbers[:n]:
                yield f"{path}: obstacles[{number}] has a {self.what} already; remove one"


class ConcentrationAt(Change):
    """Change of the inflow: from `at` on, air comes in with `concentration`."""

    concentration: si.Concentration
    """Concentration in the air that comes in from then on."""


class Inflow(Model):
    """Concentration of the gas in the air that flows in through an opening."""

    opening: Number
    """Index of the opening in `wind.openings`, counted from 0."""
    concentration: si.Concentration
    """Concentration in the air that comes in."""
    schedule: tuple[ConcentrationAt, ...] = ()
    """Concentrations from given times on; before the first, `concentration` holds."""

    _ordered = ordered_schedule()

    def at(self, t: float) -> float:
        """Return the concentration [ppm] of the inflowing air at time t [s]."""
        return [self.concentration, *(step.concentration for step in self.schedule if step.at <= t)][-1]


class GasSurface(Model):
    """A surface with an uptake of gas, or a given concentration (Dirichlet)."""

    uptake: si.SurfaceVelocity | None = None
    """Deposition velocity: gas per area and time over the concentration at the surface. The film of air at the surface
    acts in series."""
    concentration: si.Concentration | None = None
    """Constant concentration at the surface; instead of `uptake`."""
    transfer: si.SurfaceVelocity | None = None
    """Mass transfer coefficient of the film of air at the surface, per difference of concentration. Unless given, that
    of the law of the wall or, without a model of eddies, of diffusion across half a cell."""

    _one_condition = exactly_one("uptake", "concentration")


class GasWall(GasSurface, Region):
    """A face of the domain, or a region of it; where an opening is, there is no wall."""


class GasObstacle(GasSurface, OnObstacle):
    """An obstacle that exchanges gas with the air."""


class GasSurfaces(Surfaces):
    """Walls and obstacles that exchange gas with the air; the others are impermeable."""

    walls: tuple[GasWall, ...] = ()
    """Faces of the room, or regions of them, that exchange gas with the air."""
    obstacles: tuple[GasObstacle, ...] = ()
    """Obstacles that exchange gas with the air."""

    @consistency_check
    def _not_empty(self) -> Iterator[str]:
        if not self.walls and not self.obstacles:
            yield "names no walls and no obstacles"


def inflow_faults(where: str, inflow: tuple[Inflow, ...], context: Context) -> Iterator[str]:
    """Yield errors of inflow concentrations whose opening is unknown, closed, or listed twice."""
    openings = context.scenario.openings
    for n, entry in enumerate(inflow):
        path = f"{where}[{n}].opening"
        if entry.opening >= len(openings):
            allowed = f"use 0 to {len(openings) - 1}" if openings else "there are none"
            yield f"{path}: there is no wind.openings[{entry.opening}]; {allowed}"
        elif not openings[entry.opening].passes:
            yield f"{path}: no air flows through wind.openings[{entry.opening}] ({openings[entry.opening].label})"
        elif any(entry.opening == other.opening for other in inflow[:n]):
            yield f"{path}: wind.openings[{entry.opening}] has a concentration already; remove one"
