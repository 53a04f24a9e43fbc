"""Gas sensors: lag and noise of all kinds; photo-ionisation detectors, open-path lasers and ideal sensors."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.vocabulary import Model


@dataclass(frozen=True)
class Signal:
    """Dynamics (lag) and noise of the signal of a gas sensor.

    rise, decay, slow_decay: time constants [s]; slow_share: fraction of the signal that recovers slowly. noise:
    standard deviation of a sample; reading_noise: of a reading, whatever its number of samples; drift: of a random walk
    in the root of an hour. Offsets in any gas: room, by temperature and humidity, and cold_start at t = 0.
    """

    rise: float = 0.0
    decay: float = 0.0
    noise: float = 0.0
    reading_noise: float = 0.0
    drift: float = 0.0
    slow_share: float = 0.0
    slow_decay: float = 0.0
    room: float = 0.0
    cold_start: float = 0.0


class GasSensor(Model):
    """Base class of the gas sensors. A reading is the mean of samples taken evenly since the reading before."""

    rise_time: si.Delay | None = None
    """Time constant of the signal at a rise of gas; unless given, that of the kind or model. 0 follows at once."""
    decay_time: si.Delay | None = None
    """Time constant of the signal at a fall of gas; unless given, that of the kind or model. Metal oxides
    recover slowly, which blurs the edges of a plume."""
    period: si.Wait = 0.1
    """Time between readings; in between the last one holds."""
    averaged: si.Count = 1
    """Samples per reading, taken evenly since the one before: their noise averages out. With 1 the reading is a
    single sample at its end."""
    height: si.Distance = 0.1
    """Height over the floor; 3-D only. Heavy vapour from a source on the floor is met low."""
    ahead: si.Coordinate = 0.0
    """Distance in front of the robot's centre; negative is behind it."""
    left: si.Coordinate = 0.0
    """Distance to the left of the robot's centre; negative is to its right."""

    law: ClassVar[Literal["mox", "linear", "line"]] = "linear"
    """Law of the signal and of the reading: see agents/gas_laws.py."""

    @property
    def signal(self) -> Signal:
        """Time constants of the lag, and noise, of the sensor's signal."""
        raise NotImplementedError

    cycled: ClassVar[bool] = False
    """Whether the sensor works in cycles of a heater."""

    def weight(self, species: str) -> float:
        """Return how much 1 ppm of a species counts in the sensor's response; 0 for a species without effect."""
        raise NotImplementedError

    def bend(self, species: str) -> tuple[float, float] | None:
        """Return c1 [ppm] and p of the response a ((1 + c/c1)^p - 1) to a species, a its `weight`; None if linear."""
        return None

    def reads(self, species: str, ppm: float) -> float:
        """Return the steady reading [ppm] in air with this concentration [ppm] of a single species."""
        return self.weight(species) * ppm

    @property
    def integrates(self) -> bool:
        """Whether the readings are integrals along a beam [ppm m], not values at a point [ppm]."""
        return False

    @property
    def bends_at(self) -> float:
        """Reading c0 [ppm] of a signal that is linear in ln(1 + reading / c0); 0 if it is linear in the reading."""
        return 0.0

    def _lags(self, rise: float, decay: float) -> tuple[float, float]:
        """Return the time constants of rise and decay [s]; the arguments are used where the scenario gives none."""
        return (
            rise if self.rise_time is None else self.rise_time,
            decay if self.decay_time is None else self.decay_time,
        )


PID_LAG = 0.5  # s: our choice
# Makers of hand-held lasers for methane state 1 to 50,000 ppm m, 0.1 s and 30 m. Noise: our choice.
TDLAS_LAG = 0.1 / 2.3026  # s, of which 0.1 s are the time to 90 %
PpmMetres = Annotated[float, *number(0, 1e9, "ppm m")]
SomePpmMetres = Annotated[float, *number(1e-6, 1e12, "ppm m")]
Tilt = Annotated[float, *number(-90, 90, "deg")]
PanAngle = Annotated[float, *number(0, 360, "deg")]
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
    noise_ppm: si.Ppm = 0.05
    """Noise of a sample, as standard deviation."""
    detection_limit_ppm: si.Ppm = 0.1
    """Smallest measured concentration: below, the reading is zero."""
    correction: dict[str, si.SomeCoefficient] = Field(default_factory=dict)
    """Concentration of a species over that of isobutylene which gives the same signal, by the species' name. Unless
    given, from the list of a maker, of a 10.6 eV lamp: ethanol 10, acetone 1.1."""
    calibrated_for: str = ISOBUTYLENE
    """Species for which the reading is right; others by the ratio of their corrections."""

    @property
    def signal(self) -> Signal:
        return Signal(*self._lags(PID_LAG, PID_LAG), noise=self.noise_ppm)

    def weight(self, species: str) -> float:
        if species in UNSEEN and species not in self.correction:
            return 0.0
        return self.factors[self.calibrated_for] / self.factors.get(species, 1.0)

    @property
    def factors(self) -> dict[str, float]:
        """Correction factors by species: ppm of the species that give the same signal as 1 ppm of isobutylene."""
        return PID_FACTORS | self.correction

    def errors(self, where: str, context: Context) -> Iterator[str]:
        if self.calibrated_for not in self.factors:
            known = ", ".join(self.factors)
            yield f"{where}.calibrated_for: no correction for '{self.calibrated_for}'; add one, or use {known}"

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        for name in sorted({gas.vapour.name for _, gas in context.scenario.gases} - set(self.factors)):
            if name in UNSEEN:
                yield f"{where}.kind: a lamp of 10.6 eV does not ionise '{name}': it reads clean air"
            else:
                yield f"{where}.correction: has no factor for '{name}', which is taken for {ISOBUTYLENE}"


class TdlasSensor(GasSensor):
    """A tunable diode laser absorption spectrometer: reads the integral of one gas along its beam, in ppm m.

    The beam ends at the first surface: a wall of the domain, a standing or a moving obstacle. It passes robots.
    """

    kind: Literal["tdlas"]
    species: Annotated[str, Field(min_length=1)] = "methane"
    """Gas to whose absorption line the laser is tuned; others have no effect."""
    gives: Literal["integral", "mean"] = "integral"
    """Kind of reading. integral: along the beam, in ppm m; mean: this over the length of the beam, in ppm."""
    range: si.Length = 30.0
    """Longest beam, if nothing reflects it before."""
    bearing_deg: si.Angle = 0.0
    """Direction of the beam from the robot's heading, to the left."""
    tilt_deg: Tilt = 0.0
    """Angle of the beam over the horizontal; 3-D only."""
    sweep_deg: PanAngle = 0.0
    """Angle through which a pan unit sweeps the beam to and fro, half of it on each side of `bearing_deg`."""
    sweep_rate_deg: si.TurnRate = 30.0
    """Angular speed of the sweep."""
    step: si.Length | None = None
    """Distance of the sample points along the beam. Unless given, an eighth of a cell, or less where
    the gas has finer features."""
    noise_ppm_m: PpmMetres = 1.0
    """Noise of a sample, as standard deviation."""
    detection_limit_ppm_m: PpmMetres = 1.0
    """Smallest measured integral: below, the reading is zero."""
    largest_ppm_m: SomePpmMetres = 50_000.0
    """Largest measured integral; above, the reading is this."""

    law: ClassVar[Literal["mox", "linear", "line"]] = "line"

    @property
    def signal(self) -> Signal:
        return Signal(*self._lags(TDLAS_LAG, TDLAS_LAG), noise=self.noise_ppm_m)

    @property
    def integrates(self) -> bool:
        return self.gives == "integral"

    def weight(self, species: str) -> float:
        return float(species == self.species)

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        gases = sorted({gas.vapour.name for _, gas in context.scenario.gases})
        most = context.scenario.backgrounds.get(self.species, 0.0) * self.range
        if most > self.largest_ppm_m:
            yield (
                f"{where}.largest_ppm_m: {self.largest_ppm_m:g} ppm m is less than the background along the whole "
                f"beam, {most:g} ppm m; raise it, or lower range"
            )
        if self.species not in gases:
            there = f"the gas is {', '.join(gases)}" if gases else "there is no gas"
            yield f"{where}.species: '{self.species}' is not in the air of this scenario, {there}"


class IdealGasSensor(GasSensor):
    """Reads the true concentration of all species together, with an optional lag and noise."""

    kind: Literal["ideal"]
    noise_ppm: si.Ppm = 0.0
    """Noise of a sample, as standard deviation."""

    detection_limit_ppm: ClassVar[float] = 0.0

    @property
    def signal(self) -> Signal:
        return Signal(*self._lags(0.0, 0.0), noise=self.noise_ppm)

    def weight(self, species: str) -> float:
        return 1.0
