"""Screens of a scenario: slabs across the domain that let air through against a pressure drop."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, span
from taichi_plume.scenario.palette import HONEYCOMB, rgb
from taichi_plume.scenario.vocabulary import Axis, Color, not_both
from taichi_plume.scenario.windows import Window


class Screen(Window):
    """A permeable slab across `axis` with its middle at `at`."""

    color: ClassVar[Color] = rgb(HONEYCOMB)
    axis: Axis
    """Axis through the screen, across which it stands."""
    at: si.Coordinate
    """Position of the middle of the screen along that axis."""
    thickness: si.Distance = 0.05
    """Thickness along the axis, in whole cells and at least one."""
    transverse: si.Coefficient = 1000.0
    """Resistance along the screen over that through the screen. Large values straighten the flow; 1 for thin sheets."""

    @property
    def normal(self) -> int:
        return "xyz".index(self.axis)

    def level(self, extent: tuple[float, ...]) -> float:
        return self.at

    def losses(self, viscosity: float) -> tuple[float, float]:
        """Return a [m/s] and b [-] of the pressure drop over the density, (a + b |u|) u, at air velocity u [m/s]."""
        raise NotImplementedError

    def errors(self, where: str, context: Context) -> Iterator[str]:
        domain = context.domain
        half = max(self.thickness, domain.spacing) / 2
        low, high = half + domain.spacing, domain.extent[self.normal] - half - domain.spacing
        if not low - 1e-6 <= self.at <= high + 1e-6:
            yield (
                f"{where}.at: {self.axis} = {self.at:g} m leaves less than a cell of air on each side; use "
                f"{span(self.axis, low, high)}"
                if low <= high
                else f"{where}.thickness: {2 * half:g} m does not fit in the domain; make it thinner"
            )
        beyond = self.beyond(domain)
        if beyond:
            yield f"{where}: reaches beyond the domain: {beyond.replace('the face has', 'the domain has')}"
        elif not len(self.covered(domain)):
            yield (
                f"{where}: is smaller than a cell of {domain.spacing:g} m and covers none; "
                "make it larger or lower domain.spacing"
            )


class Straightener(Screen):
    """A honeycomb flow straightener: friction in its channels, and pressure losses at their ends."""

    kind: Literal["honeycomb"]
    loss_coefficient: si.Coefficient | None = None
    """Pressure drop over the dynamic pressure: more evens the flow out more. 2 unless `cell` is given."""
    cell: si.Length | None = None
    """Width of a channel, in place of the loss coefficient. The drop is then that of laminar friction in hexagons, f
    Re = 60.2 (Shah & London 1978, Laminar Flow Forced Convection in Ducts), and 1.2 dynamic pressures at both ends.
    """

    _one_loss = not_both("loss_coefficient", "cell")

    def losses(self, viscosity: float) -> tuple[float, float]:
        if self.cell is None:
            return 0.0, (2.0 if self.loss_coefficient is None else self.loss_coefficient) / 2.0
        return 60.2 / 2.0 * viscosity * self.thickness / self.cell**2, 0.6


class Perforated(Screen):
    """A thin sheet with holes or a wire gauze."""

    kind: Literal["perforated"]
    loss_coefficient: si.Coefficient = 2.0
    """Pressure drop over the dynamic pressure: more evens the flow out more."""
    thickness: si.Distance = 0.0
    transverse: si.Coefficient = 1.0

    def losses(self, viscosity: float) -> tuple[float, float]:
        return 0.0, self.loss_coefficient / 2.0


AnyScreen = Annotated[Straightener | Perforated, Field(discriminator="kind")]
