"""Gases the simulator knows: what a vapour needs to disperse and to be read in ppm."""

from dataclasses import dataclass, field
from math import exp

GAS_CONSTANT = 8.314462618  # J/(mol K), CODATA 2018
TEMPERATURE = 298.15  # K: the reference state of every ppm in the simulator
PRESSURE = 101325.0  # Pa
AIR_MOLAR_MASS = 28.965e-3  # kg/mol, dry
AIR_DENSITY = PRESSURE * AIR_MOLAR_MASS / (GAS_CONSTANT * TEMPERATURE)  # kg/m³
AIR_VISCOSITY = 1.562e-5  # m²/s
AIR_HEAT_DIFFUSIVITY = 2.2e-5  # m²/s
AIR_HEAT_CAPACITY = 1006.0 * AIR_DENSITY  # J/(m³ K)


@dataclass(frozen=True)
class Species:
    """A vapour in air at 25 °C and 1 atm.

    name: as written in scenarios; molar_mass [kg/mol]; diffusivity [m²/s] in air.
    What only matters where its liquid evaporates: antoine, (A, B, C) of log10(p/Pa) = A - B/(T/K + C);
    vapour_pressure [Pa] at the liquid's temperature, where there is no Antoine equation; latent_heat [J/kg].
    """

    name: str
    molar_mass: float
    diffusivity: float
    antoine: tuple[float, float, float] | None = field(default=None, compare=False)
    vapour_pressure: float | None = field(default=None, compare=False)
    latent_heat: float | None = field(default=None, compare=False)

    @property
    def ppm_per_density(self) -> float:
        """ppm per kg/m³: the ideal gas law, ppm = 10⁶ c R T / (M p)."""
        return 1e6 * GAS_CONSTANT * TEMPERATURE / (self.molar_mass * PRESSURE)

    @property
    def weight_per_density(self) -> float:
        """Relative change of the air's density per kg/m³: (M/M_air - 1) x of a mole fraction x."""
        return (self.molar_mass / AIR_MOLAR_MASS - 1.0) * 1e-6 * self.ppm_per_density

    def saturation(self, temperature: float, liquid: float) -> float:
        """Pressure [Pa] of the vapour over its liquid at `temperature` [K]; liquid: where `vapour_pressure` holds [K].

        By Antoine's equation, or that of Clausius and Clapeyron.
        """
        if self.antoine is not None:
            a, b, c = self.antoine
            return 10.0 ** (a - b / (temperature + c))
        assert self.vapour_pressure is not None, self.name
        if temperature == liquid:
            return self.vapour_pressure
        assert self.latent_heat is not None, self.name
        kelvin = self.latent_heat * self.molar_mass / GAS_CONSTANT
        return self.vapour_pressure * exp(kelvin * (1.0 / liquid - 1.0 / temperature))


# Molar masses: IUPAC standard atomic weights. Diffusivity of ethanol: Ferri et al., Robotics and Autonomous
# Systems 57 (2009) 393-402; of acetone: handbook values spread over 1.05-1.24e-5 m²/s, we take 1.10e-5. Antoine's
# constants as handbooks give them, for mmHg and °C; latent heats at 25 °C.
_A, _C = 2.124903, -273.15  # log10 of Pa per mmHg; K of 0 °C
SPECIES = {
    "ethanol": Species(
        "ethanol", 46.069e-3, 1.19e-5, (8.20417 + _A, 1642.89, 230.300 + _C), latent_heat=0.918e6
    ),
    "acetone": Species(
        "acetone", 58.080e-3, 1.10e-5, (7.11714 + _A, 1210.595, 229.664 + _C), latent_heat=0.52e6
    ),
}
