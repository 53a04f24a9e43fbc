"""Buoyancy (Boussinesq) in a scenario: heaters, surfaces of given temperature (Dirichlet) and heavy gas."""

from collections.abc import Iterator
from math import copysign, pi, sqrt
from typing import Annotated, ClassVar

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Located
from taichi_plume.scenario.initial_conditions import InitialHeat
from taichi_plume.scenario.surfaces import OnObstacle, Surfaces
from taichi_plume.scenario.vocabulary import AT_START, Model, consistency_check
from taichi_plume.scenario.windows import Region


class Heater(Located):
    """A ball (in 2-D a disc) that warms the air evenly over its volume: a person, a computer, a lamp."""

    what: ClassVar[str] = "heater"
    power: si.Power
    """Convective heat into the air; negative cools. Radiated heat does not count: half of a person's 100 W."""
    radius: si.Length = 0.1
    """Radius of the ball (in 2-D the disc) of air that is warmed evenly."""


class TemperedSurface(Model):
    """A surface of constant temperature."""

    temperature: si.Temperature
    """Constant temperature of the surface."""
    transfer: si.HeatTransfer | None = None
    """Heat transfer coefficient. Unless given, that of the wind beside the surface, and at least conduction across half
    a cell. Where only heat moves the air, a wall passes 1 to 4 W/(m² K)."""


class TemperedWall(TemperedSurface, Region):
    """A face of the domain, or a region of it, with a temperature; where an opening is, there is no wall."""


class TemperedObstacle(TemperedSurface, OnObstacle):
    """An obstacle with a temperature."""


class Heat(Surfaces):
    """Temperature of the air. Unnamed walls and obstacles are adiabatic."""

    what: ClassVar[str] = "temperature"
    reference: si.Temperature = 298.15
    """Temperature of the air at the start, of the still air outside and of inflowing air."""
    expansion: si.Expansion | None = None
    """Relative change of the volume per kelvin; unless given, an ideal gas's: 1/reference."""
    diffusivity: si.Diffusivity = 2.2e-5
    """Diffusivity of heat in still air."""
    prandtl_turbulent: si.Prandtl = 0.85
    """Turbulent Prandtl number: eddy viscosity over eddy diffusivity of heat. A smaller one mixes heat more."""
    capacity: si.HeatCapacity = 1191.0
    """Heat per volume and kelvin, density times c_p; the default is air at 25 °C."""
    walls: tuple[TemperedWall, ...] = ()
    """Faces of the room, or regions of them, that keep a temperature. Others are adiabatic."""
    obstacles: tuple[TemperedObstacle, ...] = ()
    """Obstacles that keep a temperature. Others are adiabatic."""
    heaters: tuple[Heater, ...] = ()
    """Balls of warmed air, such as around a person, a computer or a lamp."""
    unsteadiness: si.Fraction = 1.0
    """Fraction of each heater's power that leaves in puffs, the rest evenly. A puff warms a part of the ball half
    as wide as the ball; the next one, at another random place, follows when air has risen through the ball. This
    disturbance makes the plume above turbulent. It has no effect with `turbulence: {kind: none}`."""
    initial: Annotated[InitialHeat | None, AT_START] = None
    """Temperature at the start of the warm-up; unless given, all of the air has the reference temperature."""

    @property
    def volume_expansion(self) -> float:
        """Thermal expansion coefficient of the air [1/K]: `expansion`, by default 1 / reference temperature."""
        return 1.0 / self.reference if self.expansion is None else self.expansion

    def rising_speed(self, power: float, length: float) -> float:
        """Return the updraught speed [m/s] that air gains over a length [m] above a heater of this power [W]."""
        return (9.81 * self.volume_expansion * abs(power) / (self.capacity * length)) ** (1 / 3)

    def top_speed(self, length: float) -> float:
        """Return the largest expected buoyant speed [m/s] over a length [m], at warm surfaces or above heaters."""
        surfaces = [*self.walls, *self.obstacles]
        differences = [abs(surface.temperature - self.reference) for surface in surfaces]
        rise = 9.81 * self.volume_expansion
        power = max((abs(heater.power) for heater in self.heaters), default=0.0)
        return max(
            sqrt(rise * max(differences, default=0.0) * length),
            self.rising_speed(power, length),
        )

    @property
    def likely(self) -> list[float]:
        """Expected temperatures of the air [K]: reference, surfaces, and an estimate above each heater.

        The heat rises through the heater's width with the speed gained over its radius. The estimate is twice the mean.
        """
        temperatures = [self.reference, *(surface.temperature for surface in (*self.walls, *self.obstacles))]
        for heater in self.heaters:
            heat, r = abs(heater.power) / self.capacity, heater.radius
            speed = self.rising_speed(heater.power, r)
            if speed > 0.0:
                temperatures.append(self.reference + copysign(2 * heat / (pi * r**2 * speed), heater.power))
        return temperatures


class Buoyancy(Model):
    """Buoyancy by heat and gas (Boussinesq): rho/rho0 = 1 - (T - T0)/T0 + (M/M_air - 1) x."""

    gravity: si.Accelerations | None = None
    """Acceleration of gravity per axis; in 3-D (0, 0, -9.81) unless given. A 2-D run is seen from above, [0, -9.81]
    makes it an upright section."""
    solutal: bool = True
    """Whether the weight of the gas counts: most vapours are heavier than air, and sink."""
    heat: Heat | None = None
    """Temperature of the air and its heat sources; unless given, it is not computed and has no effect."""

    def pull(self, dim: int) -> tuple[float, ...]:
        """Return the gravity vector [m/s²] for `dim` dimensions; by default 9.81 downward along the last axis."""
        return self.gravity or (0.0,) * (dim - 1) + (-9.81,)

    def dimension_errors(self, where: str, dim: int) -> Iterator[str]:
        if dim == 2 and self.gravity is None:
            yield f"{where}.gravity: is missing; give [0, -9.81], which makes a 2-D run an upright section"
        if self.gravity is not None and not any(self.gravity):
            yield f"{where}.gravity: is zero, without any effect; remove {where}, or give a gravity"
        yield from super().dimension_errors(where, dim)

    @consistency_check
    def _acts(self) -> Iterator[str]:
        if not self.solutal and self.heat is None:
            yield "has no effect: give heat, or leave out solutal: false"
