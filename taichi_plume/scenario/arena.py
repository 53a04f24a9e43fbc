"""The part of the floor for the robots."""

from collections.abc import Iterator
from typing import Annotated

from taichi_plume.scenario.context import Context
from taichi_plume.scenario.vocabulary import COMPILED, Model, Point2


class Arena(Model):
    """Part of the floor that the robots do not leave: its edges stop them as walls do, air passes them."""

    low: Annotated[Point2, COMPILED]
    """Lower corner of the part of the floor, x and y."""
    high: Annotated[Point2, COMPILED]
    """Upper corner of the part of the floor, x and y."""

    @property
    def size(self) -> tuple[float, float]:
        """Edges [m]."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]

    def fault(self, extent: tuple[float, ...]) -> str | None:
        """What is wrong with it on a floor of that extent [m]."""
        for axis in range(2):
            low, high = self.low[axis], self.high[axis]
            if not 0 <= low < high <= extent[axis] + 1e-9:
                return (
                    f"along {'xy'[axis]} low must be below high, both on the floor from 0 to {extent[axis]:g} m, "
                    f"got {low:g} and {high:g} m"
                )
        return None

    def problems(self, where: str, context: Context) -> Iterator[str]:
        fault = self.fault(context.domain.extent)
        if fault:
            yield f"{where}: {fault}"
