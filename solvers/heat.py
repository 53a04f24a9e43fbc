"""Heat equation of the air (temperature): convection (advection), diffusion, heaters, exchange with surfaces.

    dT/dt + div(u T) = div((alpha + nu_t/Pr_t) grad T) + P/(rho c_p V)

A surface of temperature T_s heats its cells by k (T_s - T) per area: k = h/(rho c_p) for a given heat transfer
coefficient h, else alpha/(dx/2), or beyond the conductive layer, with a turbulence model, the value of
`wall_law.transfer_velocity`. All other surfaces are adiabatic.
"""

from collections.abc import Callable, Sequence
from math import floor, inf
from typing import cast

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.heat import Heat
from taichi_plume.scenario.opening_base import Vent
from taichi_plume.solvers.convection import LIMITED
from taichi_plume.solvers.openings import VENTS, Patch
from taichi_plume.solvers.release import Release
from taichi_plume.solvers.surface_exchange import Surface, SurfaceExchange
from taichi_plume.solvers.transport import Scalar, Transport

WIDTH, DURATION = 0.5, 3.0  # fitted to trials of a source; durations of 2 and 5 differ by no more than seeds


class HeatPuffs:
    """Unsteady release of heat that makes the plume above a heater turbulent.

    Warm air that rises from rest is unstable, but nothing on a grid disturbs it: above an evenly warmed heater the
    plume stays laminar for metres and entrains too little air. Real heat sources release warm air in puffs, about as
    often as air rises through the source (Cetegen & Kasper 1996, Phys. Fluids 8, 2974).

    A puff warms the cells of a heater around a random place with a Gaussian kernel, whose standard deviation is WIDTH
    R, R being the radius of the heater. A puff lasts DURATION R/U, with U = (g beta P/(rho c_p R))^(1/3), the speed
    that air gains over R. R is at least one cell here. The shares of all cells sum to 1 at any moment, so the power is
    exact. The ball is spread by the kernel of `release`, which adds up to 5/6 cell² to its variance along an axis: with
    the ball's own width, the plume of a heater of three cells carries 0.7 to 0.8 of the flow rate with this spread. The
    seed and the number of a puff determine it, so there is no state.
    """

    def __init__(self, release: Release, heat: Heat, seed: int):
        """release: of the heaters of `heat`."""
        self.release = release
        self._periods = np.where(release.grid.periodic, release.grid.shape, np.inf)
        self._share, self._seed = heat.unsteadiness, seed
        self._radii = [max(heater.radius, self.release.grid.dx) for heater in heat.heaters]
        self._rates = [
            heat.rising_speed(heater.power, radius) / (DURATION * radius)
            for heater, radius in zip(heat.heaters, self._radii, strict=True)
        ]  # puffs per second
        self._numbers: list[int] = []  # numbers of the present puffs

    def advance(self, t: float) -> None:
        """Set the shares of the heaters' cells by the puffs at time t [s]."""
        numbers = [floor(t * rate) for rate in self._rates]
        if self._share > 0.0 and numbers != self._numbers:
            self._numbers = numbers
            self.release.set_shares([self.shares(n, number) for n, number in enumerate(numbers)])

    def shares(self, n: int, number: int) -> np.ndarray:
        """Return the share of heater n's power that each of its cells receives during puff `number`."""
        cells, even = self.release.balls[n]
        rng = generator(self._seed, f"heaters[{n}] puff {number}")
        apart = np.abs(cells - cells[rng.choice(len(even), p=even / even.sum())])
        square = (np.minimum(apart, self._periods - apart) ** 2).sum(axis=-1)
        puff = even * np.exp(-0.5 * square * (self.release.grid.dx / (WIDTH * self._radii[n])) ** 2)
        return (1.0 - self._share) * even + self._share * even.sum() * puff / puff.sum()


def _temperature(vent: Patch) -> float | None:
    """Return the temperature [K] of the air that flows in through an opening, None if it is not given."""
    return cast(Vent, vent.opening).temperature


class HeatSolver:
    """Temperature of the air on the grid of a flow. Field theta: T - reference [K]."""

    STATE = ("transport", "heaters_joule", "initial_joule", "surfaces")

    def __init__(
        self,
        heat: Heat,
        grid: Grid,
        wind: Carrier,
        patches: Sequence[Patch],
        air: Air,
        scalar: Scalar | None = None,
        seed: int = 0,
    ):
        """patches: openings of the wind; scalar: theta, if the flow has buoyancy. Raises ValueError for a heater or a
        surface that touches no air.
        """
        self.grid, self.air = grid, air
        self.reference, self.capacity, self.heaters = heat.reference, heat.capacity, heat.heaters
        self.heaters_joule = self.initial_joule = 0.0
        self.release = self.puffs = None
        if heat.heaters:
            blurred = wind.nu is not None and heat.unsteadiness > 0.0
            self.release = Release("heaters", heat.heaters, grid, air, air.room, blurred)
            self.puffs = None if wind.nu is None else HeatPuffs(self.release, heat, seed)
        self._vents = [patch for patch in patches if patch.kind in VENTS]
        self.surfaces: SurfaceExchange | None = None
        if heat.walls or heat.obstacles:
            surfaces = [
                Surface(
                    None if wall.transfer is None else wall.transfer / heat.capacity,
                    inf,
                    wall.temperature - self.reference,
                )
                for wall in (*heat.walls, *heat.obstacles)
            ]
            numbers = [obstacle.number for obstacle in heat.obstacles]
            self.surfaces = SurfaceExchange(
                grid, wind, air, heat.walls, numbers, self._vents, surfaces, heat.diffusivity
            )

        scalar, scheme = scalar or Scalar(grid), LIMITED["koren"]
        given = [(vent, _temperature(vent)) for vent in self._vents]
        inflow = [(vent, kelvin - self.reference) for vent, kelvin in given if kelvin is not None]
        self.transport = Transport(
            grid, wind, air, scheme, scalar, heat.diffusivity, heat.prandtl_turbulent, self.release,
            self.surfaces, bool(inflow),
        )  # fmt: skip
        self.theta = scalar.q
        if inflow:
            self.transport.set_inflow(inflow)

    def start_from(self, temperature: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set theta from a function of points (..., dim) [m] to temperatures [K]; 0 in obstacles."""
        solid, reference = self.air.solid, self.reference
        self.transport.start_from(lambda points: np.where(solid, 0.0, temperature(points) - reference))
        self.initial_joule = self.transport.inside() * self.capacity

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """Heat, carry and diffuse from t to t + dt [s], in enough steps to create no new extrema."""
        steps = self.transport.steps(dt)
        h = dt / steps
        if self.puffs is not None:
            self.puffs.advance(t)
        if self.release is not None:
            self.release.set_amounts([heater.power * h / self.capacity for heater in self.heaters])
        self.heaters_joule += sum(heater.power for heater in self.heaters) * dt
        for _ in range(steps):
            self.transport.step(h)

    # ---------------------------------------------------------------- budget and diagnostics

    def budget(self) -> dict[str, float]:
        """Return the heat balance [J] above the reference by name: initial, if any, from heaters, from surfaces, in the
        air, and lost through the openings.
        """
        return {
            **({"initial_J": self.initial_joule} if self.initial_joule else {}),
            "heaters_J": self.heaters_joule,
            "surfaces_J": (self.surfaces.given() if self.surfaces else 0.0) * self.capacity,
            "in_air_J": self.transport.inside() * self.capacity,
            "outflow_J": self.transport.outflow() * self.capacity,
        }

    def diagnostics(self) -> dict[str, float]:
        """Return the temperature of the coldest and the warmest cell [K] and the heat balance [J], by name."""
        theta = self.grid.read(self.theta)[~self.air.solid]
        return {
            "coldest_K": self.reference + float(theta.min()),
            "warmest_K": self.reference + float(theta.max()),
            **{f"heat_{name}": value for name, value in self.budget().items()},
        }
