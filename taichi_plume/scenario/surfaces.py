"""Walls and obstacles that a section names because they exchange something with the air: checks of their places."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Protocol

from pydantic import Field

from taichi_plume.scenario.context import Context
from taichi_plume.scenario.windows import Region

Number = Annotated[int, Field(ge=0, le=1_000_000)]
"""Place in a list of the scenario, counted from 0."""


class Numbered(Protocol):
    """Names an obstacle by its number."""

    @property
    def number(self) -> int:
        """Its place in `obstacles`."""
        ...


def wall_faults(where: str, walls: Sequence[Region], context: Context) -> Iterator[str]:
    """What is wrong with walls: they have to lie on their faces, where these are walls, and apart."""
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
    """What is wrong with obstacles: there have to be such, and each be named once; what: it is given."""
    count = len(context.scenario.obstacles)
    for n, obstacle in enumerate(obstacles):
        path = f"{where}[{n}].number"
        if obstacle.number >= count:
            allowed = f"use 0 to {count - 1}" if count else "there are none"
            yield f"{path}: there is no obstacles[{obstacle.number}]; {allowed}"
        elif any(obstacle.number == other.number for other in obstacles[:n]):
            yield f"{path}: obstacles[{obstacle.number}] has a {what} already; remove one"
