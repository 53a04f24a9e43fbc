"""Gas sensors that read in ppm by themselves: photo-ionisation detectors, and ideal ones."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field

from taichi_plume.scenario.context import Context
from taichi_plume.scenario.gas_sensors import GasSensor, Signal
from taichi_plume.scenario.vocabulary import Ppm, SomeCoefficient

PID_LAG = 0.5  # s: our choice
ISOBUTYLENE = "isobutylene"
# Concentration over that of isobutylene which gives a 10.6 eV lamp the same signal: RAE Systems, Technical Note TN-106.
# What is in `UNSEEN` takes more than 10.6 eV to be ionised.
PID_FACTORS = {
    ISOBUTYLENE: 1.0,
    "ethanol": 10.0,
    "acetone": 1.1,
    "1-propanol": 5.0,
    "2-propanol": 6.0,
    "ethyl_acetate": 4.6,
    "hexane": 4.3,
    "benzene": 0.53,
    "toluene": 0.5,
    "butane": 67.0,
    "isobutane": 100.0,
    "ethylene": 9.0,
    "ammonia": 9.7,
    "hydrogen_sulfide": 3.3,
    "nitrogen_dioxide": 16.0,
}
UNSEEN = frozenset(
    {
        "methanol",
        "methane",
        "propane",
        "hydrogen",
        "carbon_monoxide",
        "carbon_dioxide",
        "sulfur_dioxide",
        "chlorine",
        "helium",
        "neon",
        "sulfur_hexafluoride",
    }
)


class PidSensor(GasSensor):
    """A photo-ionisation detector: linear, nearly without lag; its reading is in ppm of `calibrated_for`."""

    kind: Literal["pid"]
    noise_ppm: Ppm = 0.05
    """Noise of a sample, as standard deviation."""
    detection_limit_ppm: Ppm = 0.1
    """Smallest concentration that it tells: below, the reading is zero."""
    correction: dict[str, SomeCoefficient] = Field(default_factory=dict)
    """Concentration of a species over that of isobutylene which gives the same signal, by the species' name. Unless
    given, from the list of a maker, of a 10.6 eV lamp: ethanol 10, acetone 1.1."""
    calibrated_for: str = ISOBUTYLENE
    """Species that it reads rightly; others by the ratio of their corrections."""

    @property
    def signal(self) -> Signal:
        """Of its reading [ppm]."""
        return Signal(*self._lags(PID_LAG, PID_LAG), noise=self.noise_ppm)

    def weight(self, species: str) -> float:
        """How much a ppm of a species counts."""
        if species in UNSEEN and species not in self.correction:
            return 0.0
        return self.factors[self.calibrated_for] / self.factors.get(species, 1.0)

    @property
    def factors(self) -> dict[str, float]:
        """Of all species that it knows."""
        return PID_FACTORS | self.correction

    def problems(self, where: str, context: Context) -> Iterator[str]:
        """What it is calibrated for has to have a factor."""
        if self.calibrated_for not in self.factors:
            yield (
                f"{where}.calibrated_for: there is no correction for '{self.calibrated_for}'; add one, or use "
                f"{', '.join(self.factors)}"
            )

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        """What is in the air should have a factor."""
        for name in sorted({gas.vapour.name for _, gas in context.scenario.gases} - set(self.factors)):
            if name in UNSEEN:
                yield f"{where}.kind: a lamp of 10.6 eV does not ionise '{name}': it counts as clean air"
            else:
                yield f"{where}.correction: has no factor for '{name}', which is taken for {ISOBUTYLENE}"


class IdealGasSensor(GasSensor):
    """Reads the true concentration of all species together, with an optional lag and noise."""

    kind: Literal["ideal"]
    noise_ppm: Ppm = 0.0
    """Noise of a sample, as standard deviation."""

    detection_limit_ppm: ClassVar[float] = 0.0

    @property
    def signal(self) -> Signal:
        """Of its reading [ppm]."""
        return Signal(*self._lags(0.0, 0.0), noise=self.noise_ppm)

    def weight(self, species: str) -> float:
        """All count alike."""
        return 1.0
