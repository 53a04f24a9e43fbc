"""The box that is simulated."""

from typing import Annotated

from pydantic import Field

from taichi_plume.scenario.vocabulary import COMPILED, Length, Model


class Domain(Model):
    """The box that is simulated, with its lower corner at the origin."""

    size: Annotated[tuple[Length, ...], Field(min_length=2, max_length=3), COMPILED]
    """Extent per axis [m]; two numbers make a 2-D run."""
    spacing: Annotated[Length, COMPILED]
    """Edge of the cubic cells [m]; every extent is rounded to whole cells."""
    depth: Length = 1.0
    """Thickness of the slab that a 2-D run stands for [m]: it turns kg/s into kg/m³."""

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(self.size)

    @property
    def shape(self) -> tuple[int, ...]:
        """Cells per axis."""
        return tuple(max(1, round(extent / self.spacing)) for extent in self.size)

    @property
    def extent(self) -> tuple[float, ...]:
        """Extent per axis in whole cells [m]."""
        return tuple(n * self.spacing for n in self.shape)
