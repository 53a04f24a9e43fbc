"""Boundary conditions of gas and heat: walls, obstacles and openings that exchange them with the air."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Protocol

from pydantic import Field, model_validator

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.vocabulary import Model, exactly_one
from taichi_plume.scenario.windows import Region

Number = Annotated[int, Field(ge=0, le=1_000_000)]
"""Index in a list of the scenario, counted from 0."""


class Numbered(Protocol):
    """A section that names an obstacle by its number."""

    @property
    def number(self) -> int:
        """Index in `obstacles`."""
        ...


def wall_faults(where: str, walls: Sequence[Region], context: Context) -> Iterator[str]:
    """Yield errors of wall regions: they have to lie on faces that are walls, and must not overlap."""
    for n, wall in enumerate(walls):
        yield from wall.on_its_face(f"{where}[{n}]", context)
        for m, opening in enumerate(context.scenario.openings):
            if opening.wraps == wall.face[0]:
                yield (
                    f"{where}[{n}].face: there is no wall {wall.face}, wind.openings[{m}] makes axis {opening.wraps} "
                    "periodic; remove one of them"
                )
        for m, other in enumerate(walls[:n]):
            if wall.overlaps(other, context.domain):
                yield (
                    f"{where}[{n}]: overlaps {where}[{m}] on face {wall.face}; "
                    "give both a center and a size that leave them apart"
                )


def obstacle_faults(where: str, obstacles: Sequence[Numbered], what: str, context: Context) -> Iterator[str]:
    """Yield errors about unknown obstacles, and obstacles with two entries; what: noun of an entry."""
    count = len(context.scenario.obstacles)
    for n, obstacle in enumerate(obstacles):
        path = f"{where}[{n}].number"
        if obstacle.number >= count:
            allowed = f"use 0 to {count - 1}" if count else "there are none"
            yield f"{path}: there is no obstacles[{obstacle.number}]; {allowed}"
        elif any(obstacle.number == other.number for other in obstacles[:n]):
            yield f"{path}: obstacles[{obstacle.number}] has a {what} already; remove one"


class ConcentrationAt(Model):
    """Change of the inflow: from `at` on, air comes in with `concentration`."""

    at: si.Time
    """Time when the change starts. The robots start at 0, the warm-up is before."""
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

    @model_validator(mode="after")
    def _ordered(self) -> "Inflow":
        times = [step.at for step in self.schedule]
        if times != sorted(times):
            raise fault("schedule must be ordered by 'at'")
        return self

    def at(self, t: float) -> float:
        """Return the concentration [ppm] at time t [s]."""
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


class GasObstacle(GasSurface):
    """An obstacle that exchanges gas with the air."""

    number: Number
    """Index of the obstacle in `obstacles`, counted from 0."""


class GasSurfaces(Model):
    """Walls and obstacles that exchange gas with the air; the others are impermeable."""

    walls: tuple[GasWall, ...] = ()
    """Faces of the room, or regions of them, that exchange gas with the air."""
    obstacles: tuple[GasObstacle, ...] = ()
    """Obstacles that exchange gas with the air."""

    @model_validator(mode="after")
    def _not_empty(self) -> "GasSurfaces":
        if not self.walls and not self.obstacles:
            raise fault("names no walls and no obstacles")
        return self

    def problems(self, where: str, context: Context) -> Iterator[str]:
        yield from wall_faults(f"{where}.walls", self.walls, context)
        yield from obstacle_faults(f"{where}.obstacles", self.obstacles, "surface", context)


def inflow_faults(where: str, inflow: tuple[Inflow, ...], context: Context) -> Iterator[str]:
    """Yield errors about unknown or closed openings, and openings with two entries."""
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
