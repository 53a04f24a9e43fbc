"""The box that is simulated."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from taichi_plume.scenario.vocabulary import COMPILED, Length, Model

ROUNDING = 0.1  # of an extent: more is a scenario for another domain than the one written


class Domain(Model):
    """The box that is simulated, with its lower corner at the origin."""

    size: Annotated[tuple[Length, ...], Field(min_length=2, max_length=3), COMPILED]
    """Lengths of the room along x and y, and in 3-D along z. Two numbers make a 2-D run, seen from above; three a 3-D
    one."""
    spacing: Annotated[Length, COMPILED]
    """Edge of the square or cubic cells of the grid. Half of it shows finer eddies and smaller objects, and takes
    about 8 times as long in 2-D and 16 times in 3-D. The size is rounded to whole cells."""
    depth: Annotated[Length, COMPILED] = 1.0
    """Thickness of the layer of air that a 2-D run stands for. It decides how many ppm a source of so many mg/s
    makes: twice the depth halves them. Without effect in 3-D."""

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

    @property
    def box(self) -> str:
        """Where its floor is, in words."""
        width, length = self.extent[:2]
        return f"x 0 to {width:.4g} m, y 0 to {length:.4g} m"

    def rounded(self, where: str) -> Iterator[str]:
        """What becomes of its size in whole cells, where that is another domain."""
        for axis, (extent, n) in enumerate(zip(self.size, self.shape, strict=True)):
            if n < 2:
                advice = "; two numbers in domain.size make a 2-D run" if axis == 2 else ""
                yield (
                    f"{where}.size[{axis}]: {extent:g} m is fewer than two cells of {self.spacing:g} m; "
                    f"lower domain.spacing to {extent / 4:.3g} m or less{advice}"
                )
            elif abs(n * self.spacing - extent) > ROUNDING * extent:
                yield (
                    f"{where}.size[{axis}]: {extent:g} m in cells of {self.spacing:g} m becomes "
                    f"{n * self.spacing:g} m; choose a spacing that divides it, such as {extent / n:.4g} m"
                )
