"""Gases the simulator knows: what a vapour needs to disperse and to be read in ppm."""

from dataclasses import dataclass

GAS_CONSTANT = 8.314462618  # J/(mol K), CODATA 2018
TEMPERATURE = 298.15  # K: the reference state of every ppm in the simulator
PRESSURE = 101325.0  # Pa
AIR_MOLAR_MASS = 28.965e-3  # kg/mol, dry
AIR_DENSITY = PRESSURE * AIR_MOLAR_MASS / (GAS_CONSTANT * TEMPERATURE)  # kg/m³


@dataclass(frozen=True)
class Species:
    """A vapour in air at 25 °C and 1 atm.

    name: as written in scenarios; molar_mass [kg/mol]; diffusivity [m²/s] in air.
    """

    name: str
    molar_mass: float
    diffusivity: float

    @property
    def ppm_per_density(self) -> float:
        """ppm per kg/m³: the ideal gas law, ppm = 10⁶ c R T / (M p)."""
        return 1e6 * GAS_CONSTANT * TEMPERATURE / (self.molar_mass * PRESSURE)

    @property
    def weight_per_density(self) -> float:
        """Relative change of the air's density per kg/m³: (M/M_air - 1) x of a mole fraction x."""
        return (self.molar_mass / AIR_MOLAR_MASS - 1.0) * 1e-6 * self.ppm_per_density


# Molar masses: IUPAC standard atomic weights. Diffusivity of ethanol: Ferri et al., Robotics and Autonomous
# Systems 57 (2009) 393-402; of acetone: handbook values spread over 1.05-1.24e-5 m²/s, we take 1.10e-5.
SPECIES = {
    "ethanol": Species("ethanol", 46.069e-3, 1.19e-5),
    "acetone": Species("acetone", 58.080e-3, 1.10e-5),
}
