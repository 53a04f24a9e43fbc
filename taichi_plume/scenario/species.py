"""Properties of gases: molar mass, diffusivity, vapour pressure (Antoine equation) and latent heat."""

from dataclasses import dataclass, field
from math import exp
from typing import Literal

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
    Only for evaporation from a liquid: antoine, (A, B, C) of log10(p/Pa) = A - B/(T/K + C);
    vapour_pressure [Pa] at the liquid's temperature, if there is no Antoine equation; latent_heat [J/kg].
    """

    name: str
    molar_mass: float
    diffusivity: float
    antoine: tuple[float, float, float] | None = field(default=None, compare=False)
    vapour_pressure: float | None = field(default=None, compare=False)
    latent_heat: float | None = field(default=None, compare=False)

    @property
    def ppm_per_density(self) -> float:
        """Factor from density [kg/m³] to mole fraction [ppm], by the ideal gas law: 10⁶ R T / (M p)."""
        return 1e6 * GAS_CONSTANT * TEMPERATURE / (self.molar_mass * PRESSURE)

    @property
    def weight_per_density(self) -> float:
        """Relative change of the air's density per kg/m³ of the gas: (M/M_air - 1) x, with its mole fraction x."""
        return (self.molar_mass / AIR_MOLAR_MASS - 1.0) * 1e-6 * self.ppm_per_density

    def saturation(self, temperature: float, liquid: float) -> float:
        """Return the vapour pressure [Pa] at `temperature` [K] by the Antoine or the Clausius-Clapeyron equation.

        liquid: temperature [K] of `vapour_pressure`.
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


# Molar masses: IUPAC standard atomic weights. Antoine's constants as handbooks give them, for mmHg and °C; latent heats
# at 25 °C. Diffusivities in air at 25 °C and 1 atm, each marked with where it is from:
#   F  Ferri et al., Robotics and Autonomous Systems 57 (2009) 393-402
#   H  handbook values, which spread over 1.05-1.24e-5 m²/s; we take 1.10e-5
#   L  Lugg, Analytical Chemistry 40 (1968) 1072-1077, measured at 25 °C
#   M  Massman, Atmospheric Environment 32 (1998) 1111-1127, eq D = D0 (T/T0)^1.81
#   R  Marrero & Mason, J. Phys. Chem. Ref. Data 1 (1972) 3-118, as the CRC Handbook tabulates it, with T^1.75
#   V  Fuller, Ensley & Giddings, J. Phys. Chem. 73 (1969) 3679-3685: estimated from diffusion volumes, within some 5 %
_A, _C = 2.124903, -273.15  # log10 of Pa per mmHg; K of 0 °C


def _liquid(
    name: str, molar_mass: float, diffusivity: float, antoine: tuple[float, float, float], latent_heat: float
) -> Species:
    """Return a species that is a liquid, from the constants of its Antoine equation for mmHg and °C."""
    a, b, c = antoine
    return Species(name, molar_mass, diffusivity, (a + _A, b, c + _C), latent_heat=latent_heat)


_KNOWN = (
    _liquid("ethanol", 46.069e-3, 1.19e-5, (8.20417, 1642.89, 230.300), 0.918e6),  # F
    _liquid("acetone", 58.080e-3, 1.10e-5, (7.11714, 1210.595, 229.664), 0.52e6),  # H
    _liquid("methanol", 32.042e-3, 1.520e-5, (8.08097, 1582.271, 239.726), 1.168e6),  # L
    _liquid("1-propanol", 60.096e-3, 0.993e-5, (7.84767, 1499.21, 204.64), 0.790e6),  # L
    _liquid("2-propanol", 60.096e-3, 1.013e-5, (8.11778, 1580.92, 219.61), 0.755e6),  # L
    _liquid("ethyl_acetate", 88.106e-3, 0.861e-5, (7.10179, 1244.950, 217.881), 0.404e6),  # L
    _liquid("hexane", 86.178e-3, 0.732e-5, (6.91058, 1189.640, 226.280), 0.366e6),  # L
    _liquid("benzene", 78.114e-3, 0.932e-5, (6.87987, 1196.760, 219.161), 0.433e6),  # L
    _liquid("toluene", 92.141e-3, 0.849e-5, (6.95087, 1342.31, 219.187), 0.413e6),  # L
    Species("methane", 16.043e-3, 2.287e-5),  # M
    Species("propane", 44.097e-3, 1.12e-5),  # V
    Species("butane", 58.124e-3, 0.956e-5),  # V
    Species("isobutane", 58.124e-3, 0.956e-5),  # V
    Species("ethylene", 28.054e-3, 1.50e-5),  # V
    Species("isobutylene", 56.108e-3, 0.984e-5),  # V
    Species("hydrogen", 2.016e-3, 7.79e-5),  # R
    Species("ammonia", 17.031e-3, 2.318e-5),  # M
    Species("carbon_monoxide", 28.010e-3, 2.117e-5),  # M
    Species("carbon_dioxide", 44.009e-3, 1.618e-5),  # M
    Species("hydrogen_sulfide", 34.08e-3, 1.65e-5),  # V
    Species("sulfur_dioxide", 64.06e-3, 1.276e-5),  # M
    Species("nitrogen_dioxide", 46.006e-3, 1.595e-5),  # M
    Species("chlorine", 70.90e-3, 1.28e-5),  # V
    Species("helium", 4.0026e-3, 7.18e-5),  # R
    Species("neon", 20.180e-3, 3.04e-5),  # V
    Species("sulfur_hexafluoride", 146.06e-3, 1.013e-5),  # R, from 100 °C
)
SPECIES = {species.name: species for species in _KNOWN}
SpeciesName = Literal[tuple(SPECIES)]  # type: ignore[valid-type]
"""Species that a scenario can name."""
