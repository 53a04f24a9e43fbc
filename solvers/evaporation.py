"""Evaporation from an open dish in the wind: mass transfer by the Sherwood number, and cooling of the liquid.

    m = Sh D/d A (p M / R T_f) ln(1/(1 - x_s)),    Sh³ = (0.664 Re^1/2 Sc^1/3)³ + (8/pi)³

d and A: diameter and area of the dish. In a wind the dish is a plate with a laminar boundary layer; in still air it is
a disc flush with the floor, which emits 4 D (d/2) c_s. The logarithm is the flow of the vapour away from the liquid
(Stefan flow); x_s is the mole fraction of vapour in the saturated air at the surface. D grows as T^1.75 and is taken,
like the density, at the mean T_f of surface and air.

The heat of evaporation arrives by radiation and by transfer through the air:

    L m/A = (h_rad + Nu k/d) (T - T_s),    Nu as Sh with the Prandtl number

The air far away counts as clean. Rims, and heavy vapour that flows over them, are not modelled.
"""

from math import log1p, pi
from typing import Any

import numpy as np

from taichi_plume.grid.fields import Wind, velocity_at
from taichi_plume.scenario.sources import Dish, Source
from taichi_plume.scenario.species import (
    AIR_HEAT_CAPACITY,
    AIR_HEAT_DIFFUSIVITY,
    AIR_VISCOSITY,
    GAS_CONSTANT,
    PRESSURE,
    TEMPERATURE,
    Species,
)

RADIATION = 5.5  # W/(m² K) between a wet surface and a room a few kelvin warmer: 4 sigma T³ times 0.95


def speed_over(source: Source, wind: Wind, t: float) -> float:
    """Return the wind speed [m/s] over a source's dish at time t [s], half a diameter up, above its boundary layer."""
    assert source.dish is not None
    point = np.array([source.places(t)])
    point[0, 2:] += 0.5 * source.dish.diameter
    return float(np.linalg.norm(velocity_at(wind, point, t)))


class Evaporation:
    """Evaporation rate of a dish of liquid, as a function of the wind speed."""

    def __init__(self, dish: Dish, species: Species):
        self.dish = dish
        self.species = species

    def _transfer(self, speed: float, diffusivity: float) -> float:
        """Return the Sherwood (or Nusselt) number of the dish at a wind speed [m/s] and a diffusivity [m²/s]."""
        reynolds = speed * self.dish.diameter / AIR_VISCOSITY
        forced = 0.664 * reynolds**0.5 * (AIR_VISCOSITY / diffusivity) ** (1 / 3)
        return (forced**3 + (8.0 / pi) ** 3) ** (1 / 3)

    def flux(self, speed: float, surface: float) -> float:
        """Return the evaporation rate per area [kg/(m² s)] at a wind speed [m/s] and a surface temperature [K]."""
        film = 0.5 * (surface + self.dish.temperature)
        D = self.species.diffusivity * (film / TEMPERATURE) ** 1.75
        share = self.species.saturation(surface, self.dish.temperature) / PRESSURE
        pure = PRESSURE * self.species.molar_mass / (GAS_CONSTANT * film)  # kg/m³ of vapour alone
        return self._transfer(speed, D) * D / self.dish.diameter * pure * -log1p(-share)

    def surface(self, speed: float) -> float:
        """Return the temperature [K] of the liquid's surface at a wind speed [m/s], by the heat balance."""
        from scipy.optimize import brentq  # for runs with liquids only

        warm = self.dish.temperature
        if not self.dish.cooling:
            return warm
        assert self.species.latent_heat is not None, self.species.name
        latent = self.species.latent_heat
        conductivity = AIR_HEAT_DIFFUSIVITY * AIR_HEAT_CAPACITY
        air = self._transfer(speed, AIR_HEAT_DIFFUSIVITY) * conductivity / self.dish.diameter

        def surplus(surface: float) -> float:
            return (RADIATION + air) * (warm - surface) - latent * self.flux(speed, surface)

        kelvin: Any = brentq(surplus, 0.5 * warm, warm)
        return kelvin

    def rate(self, speed: float) -> float:
        """Return the evaporation rate of the dish [kg/s] at a wind speed [m/s]."""
        return self.flux(speed, self.surface(speed)) * 0.25 * pi * self.dish.diameter**2
