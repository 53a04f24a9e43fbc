"""Metal-oxide gas sensors: response, time constants and load resistor by the maker's name; their section of a scenario.

To add a sensor: an entry in `MOX_MODELS`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import exp, log
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.quantities import number, quantity
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.gas_sensors import GasSensor, Signal
from taichi_plume.scenario.vocabulary import Model

SomeShare = Annotated[float, *number(0.01, 0.99)]
ElectronVolts = Annotated[float, *number(0, 5, "eV")]
FilmTemperature = Annotated[float, *quantity("K", least=250, likely="degC", most=1500)]

# ln R per kelvin and per ln of the relative humidity: order of magnitude of the maker's plots of the TGS sensors
LN_R_PER_KELVIN = -0.015
LN_R_PER_LN_HUMIDITY = -0.25
CALIBRATED_AT = (293.15, 0.65)  # K, relative humidity

# An n-type oxide conducts better as a reducing gas takes oxygen from its surface. These take none, or bring more, which
# raises the resistance: the law has no such term, and the signal stays at zero.
INERT = frozenset({"helium", "neon", "sulfur_hexafluoride", "carbon_dioxide"})
OXIDISING = frozenset({"chlorine", "nitrogen_dioxide", "sulfur_dioxide"})


@dataclass(frozen=True)
class MoxModel:
    """A metal-oxide sensor, R = R_air (1 + c/c0)^-b of one gas.

    c0 [ppm]; b; rise and decay: time constants [s]; air: range of R_air [ohm]; load: resistor in series [ohm]. gas: the
    gas of c0 and b, in ppm of which the sensor reads by default; others: c0 [ppm] and b of other gases; filtered:
    gases without response, unlike for other sensors of the kind.
    """

    c0: float
    b: float
    rise: float
    decay: float
    air: tuple[float, float]
    load: float = 10e3
    gas: str = "ethanol"
    others: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    filtered: frozenset[str] = frozenset()

    def curve(self, gas: str) -> tuple[float, float] | None:
        """Return c0 [ppm] and b of the response (1 + c/c0)^-b to a gas; None if the data sheet has none."""
        return (self.c0, self.b) if gas == self.gas else self.others.get(gas)

    def feels(self, gas: str) -> bool:
        """Return whether the sensor may respond to a gas: a known curve, or neither inert, oxidising nor filtered."""
        return gas in (self.gas, *self.others) or gas not in INERT | OXIDISING | self.filtered


# b and c0 from R(300 ppm)/R(50 ppm) and R_air/R(300 ppm) of the data sheets, if nothing else is said. Time constants of
# the TGS 26xx: GADEN (Monroy et al. 2017, doi:10.3390/s17071479), from experiments; the others are our estimates.
# GADEN's lag acts on R, ours on ln R, which recovers more slowly from strong gas. Recorded sensors (validation case
# sensor_records) recover faster than most of these decay times, but their models are not published.
# Of other gases: GADEN's power laws, fitted to the sheets, c0 being where a law meets the resistance in clean air.
# c0 [ppm] and b of other gases than the model's own
OTHERS: dict[str, dict[str, tuple[float, float]]] = {
    # isobutane as common drivers fit the sheet
    "tgs2600": {"methane": (1.278, 0.07284), "hydrogen": (0.3385, 0.3532), "isobutane": (0.3556, 0.2996)},
    "tgs2602": {"hydrogen_sulfide": (0.0557, 0.3385), "ammonia": (0.585, 0.29)},
    "tgs2610": {"ethanol": (105.3, 0.5008), "hydrogen": (45.8, 0.4888)},
    "tgs2611": {"ethanol": (122.6, 0.3658), "hydrogen": (72.1, 0.3614)},
    "tgs2612": {"ethanol": (182.9, 0.09115)},
    "tgs2620": {"methane": (36.0, 0.4877), "hydrogen": (1.316, 0.5546)},
    "mics5524": {"carbon_monoxide": (4.385, 0.848), "hydrogen": (0.73, 0.5556), "methane": (631.0, 0.2292)},
}
# A filter keeps hydrogen and most vapours of solvents away from the TGS 2612
FILTERED = frozenset({"hydrogen"})
# c0, b, rise, decay and range of R_air of each model
MOX_MODELS: dict[str, MoxModel] = {
    # its data sheet (1990) has hydrogen only; other gases as of the TGS 822, of the same maker
    "tgs800": MoxModel(0.9, 0.511, 4.0, 20.0, (10e3, 130e3)),
    "tgs822": MoxModel(0.9, 0.511, 4.0, 20.0, (19.5e3, 195e3)),
    # c0: GADEN's power law
    "tgs2600": MoxModel(0.299, 0.3196, 4.8, 18.75, (10e3, 90e3), others=OTHERS["tgs2600"]),
    # R/R_air = (c/c0)^-b as common drivers fit the sheet; time constants of the TGS 2600
    "tgs2602": MoxModel(0.541, 0.4324, 4.8, 18.75, (10e3, 100e3), others=OTHERS["tgs2602"]),
    "tgs2610": MoxModel(29.9, 0.5372, 3.44, 6.35, (7e3, 70e3), 10e3, "methane", OTHERS["tgs2610"]),
    "tgs2611": MoxModel(31.15, 0.4289, 3.44, 6.35, (6e3, 60e3), 10e3, "methane", OTHERS["tgs2611"]),
    "tgs2612": MoxModel(
        30.12, 0.5916, 3.44, 6.35, (13e3, 133e3), 10e3, "methane", OTHERS["tgs2612"], FILTERED
    ),
    # c0: GADEN's power law
    "tgs2620": MoxModel(4.32, 0.7155, 2.96, 15.71, (21e3, 105e3), others=OTHERS["tgs2620"]),
    # R/R_air = (c/c0)^-b in common drivers of its sensing element (in the MiCS-6814)
    "mics5524": MoxModel(1.6, 0.644, 1.5, 8.0, (100e3, 1500e3), 47e3, others=OTHERS["mics5524"]),
}
MoxName = Literal[tuple(MOX_MODELS)]  # type: ignore[valid-type]


# Dennler et al., Science Advances 10 (2024) eadp1764: onset and recovery of metal oxides on micro hot plates, switched
# between 150 and 400 degC twenty times a second. They are taken for time constants. The activation energy is our
# estimate, of the order that desorption from oxides has.
ONSET, RECOVERY = 0.087, 0.106  # s
BOLTZMANN = 8.617333e-5  # eV/K


class Heater(Model):
    """A heater that is switched between two temperatures: the film reacts while hot, hardly while cold."""

    period: si.Wait = 0.05
    """Time of a cycle, first hot, then cold. There is one reading per cycle, at the end of its hot part."""
    hot_share: SomeShare = 0.5
    """Share of a cycle that is hot."""
    hot: FilmTemperature = 673.15
    """Temperature of the film while hot."""
    cold: FilmTemperature = 423.15
    """Temperature of the film while cold."""
    activation_energy: ElectronVolts = 0.3
    """Ratio of the reaction rates, cold over hot: exp(-E (1/T_cold - 1/T_hot)/k)."""

    @property
    def slowness(self) -> float:
        """Reaction rate of the film while cold over that while hot (Arrhenius law)."""
        return exp(-self.activation_energy / BOLTZMANN * (1.0 / self.cold - 1.0 / self.hot))

    def errors(self, where: str, context: Context) -> Iterator[str]:
        if self.hot <= self.cold:
            yield f"{where}.hot: {self.hot:g} K must be above cold: {self.cold:g} K"


class MoxSensor(GasSensor):
    """A metal-oxide gas sensor: a resistance that falls with a power of the concentration, and lags.

    R = R_air (1 + sum of e_i / c0)^-b over the gases i of the mixture; e_i is what c_i counts in ppm of the model's own
    gas, c_i times its `sensitivity` or, where the data sheet has a curve of the gas, the ppm with the same R.
    """

    kind: Literal["mox"]
    model: MoxName = "mics5524"
    """Which metal-oxide sensor, by the maker's name: its response, lag and load resistor."""
    noise: si.Intensity = 0.003
    """Noise of a sample, as standard deviation of ln R."""
    reading_noise: si.Intensity = 0.0
    """Noise of a reading that averaging its samples does not remove, as standard deviation of ln R. Its sources
    vary more slowly than the samples are taken: 1/f noise of the sensor, its supply and converter, temperature and
    motion of the air at its film. Flicker noise is the largest of resistive sensors at low frequencies (Scandurra et
    al. 2024)."""
    sensitivity: dict[str, si.Coefficient] = Field(default_factory=dict)
    """Response to a species over that to the gas of its model, by the species' name. Unless given, by the curve of the
    data sheet, if any; 0 for gases to which no metal oxide responds; else 1."""
    calibrated_for: Annotated[str, Field(min_length=1)] | None = None
    """Gas in ppm of which it reads. Unless given ethanol, for the TGS 2610, 2611 and 2612 methane."""
    calibration: Literal["model", "cubic", "extrapolated_cubic"] = "model"
    """Conversion of a resistance to ppm: by the model's own law, or by a cubic in log R. The cubic is fitted to each
    unit from 5 to 1000 ppm. Below 5 ppm, `cubic` goes on as a line to 0 in clean air; `extrapolated_cubic` is the cubic
    itself, which reads above 0 in clean air: 0.5 ppm of a TGS 800."""
    gives: Literal["ppm", "ratio", "rank"] = "ppm"
    """Kind of reading. ppm: by the calibration. The others need none: ratio is R0/R - 1, with R0 the largest resistance
    so far; rank is the share of the robot's readings within `memory` that are clearly lower (Jin et al. 2026).
    Thresholds of algorithms then count in this number."""
    memory: si.Wait = 60.0
    """Time whose readings a rank compares with the present one."""
    tied: si.Intensity = 0.02
    """Difference in ln R below which two readings have the same rank, so that noise has none."""
    spread: si.Intensity = 0.0
    """Differences between units, over those of the data sheet: R_air over its range, the exponent b by 8 %. 0 makes
    all alike, 1 as different as the sheet allows."""
    drift: si.Intensity = 0.0
    """Random walk of ln R_air, in the root of an hour; data sheets would allow about 0.02."""
    slow_share: si.Fraction = 0.0
    """Share of the signal that recovers by `slow_decay_time`, the rest by `decay_time`; 0.4 with 5 s and 40 s is
    common."""
    slow_decay_time: si.Duration = 40.0
    """Time constant of the slow part of the recovery; without a `slow_share` there is none."""
    heater: Heater | None = None
    """Cycles of its heater, which make it fast; unless given, it is heated steadily. The default time constants, in
    the mean of a cycle, are then 87 ms up and 106 ms down."""
    cold_start: si.Intensity = 0.0
    """Deficit of ln R when the sensor is switched on, at t = 0; its time constant is 15 min. 0.2 is common."""
    air_temperature: si.Temperature | None = None
    """Temperature of the room: R falls by 1.5 % per kelvin. Unless given 20 degC, at which R_air and calibration were
    taken."""
    air_humidity: Annotated[float, Field(ge=0.05, le=1)] | None = None
    """Relative humidity of the room, as a share: R goes with its power -0.25. Unless given 0.65, as for R_air and
    calibration."""
    bits: Annotated[int, Field(ge=4, le=24)] | None = None
    """Resolution of the converter that reads the voltage over `load`; unless given, it does not round."""
    load: si.Resistance | None = None
    """Resistor in series with the sensor; unless given 10 kOhm, for the MiCS 47 kOhm."""

    law: ClassVar[Literal["mox", "linear", "line"]] = "mox"

    @property
    def signal(self) -> Signal:
        """Lag and noise of the logarithm ln(R_air/R) of the sensor's resistance."""
        model = MOX_MODELS[self.model]
        rise, decay = self._lags(*((ONSET, RECOVERY) if self.heater else (model.rise, model.decay)))
        warmer = (self.air_temperature or CALIBRATED_AT[0]) - CALIBRATED_AT[0]
        damper = log((self.air_humidity or CALIBRATED_AT[1]) / CALIBRATED_AT[1])
        return Signal(
            rise,
            decay,
            self.noise,
            self.reading_noise,
            self.drift,
            self.slow_share,
            self.slow_decay_time,
            room=-(LN_R_PER_KELVIN * warmer + LN_R_PER_LN_HUMIDITY * damper),
            cold_start=self.cold_start,
        )

    @property
    def cycled(self) -> bool:
        return self.heater is not None

    def curve(self, species: str) -> tuple[float, float] | None:
        """Return c0 [ppm] and b of the response (1 + c/c0)^-b to a single species; None without any response."""
        model = MOX_MODELS[self.model]
        if species in self.sensitivity:
            share = self.sensitivity[species]
            return (model.c0 / share, model.b) if share else None
        return model.curve(species) or ((model.c0, model.b) if model.feels(species) else None)

    def weight(self, species: str) -> float:
        """Return the ppm of the model's own gas to which 1 ppm of a species is equal; for another b, see `bend`."""
        model, curve = MOX_MODELS[self.model], self.curve(species)
        if curve is None or species in self.sensitivity:
            return self.sensitivity.get(species, 0.0)
        return model.c0 if self.bend(species) else model.c0 / curve[0]

    def bend(self, species: str) -> tuple[float, float] | None:
        curve, b = self.curve(species), MOX_MODELS[self.model].b
        return None if curve is None or curve[1] == b else (curve[0], curve[1] / b)

    def reads(self, species: str, ppm: float) -> float:
        felt, read = self.curve(species), self.reading_curve
        if self.gives == "ratio" and felt is not None:
            return (1.0 + ppm / felt[0]) ** felt[1] - 1.0
        if felt is None or felt[1] == read[1]:
            return 0.0 if felt is None else ppm * (read[0] / felt[0])
        return read[0] * ((1.0 + ppm / felt[0]) ** (felt[1] / read[1]) - 1.0)

    @property
    def bends_at(self) -> float:
        return 1.0 if self.gives == "ratio" else self.reading_curve[0]

    @property
    def reading_curve(self) -> tuple[float, float]:
        """c0 [ppm] and b of the response to the gas for which the sensor is calibrated."""
        model = MOX_MODELS[self.model]
        return self.curve(self.calibrated_for or model.gas) or (model.c0, model.b)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        model, gas = MOX_MODELS[self.model], self.calibrated_for
        known = {model.gas, *model.others, *(name for name, share in self.sensitivity.items() if share)}
        if gas is not None and gas not in known:
            yield f"{where}.calibrated_for: no curve of '{gas}'; add a sensitivity, or use {', '.join(sorted(known))}"

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        gases, model = {gas.vapour.name for _, gas in context.scenario.gases}, MOX_MODELS[self.model]
        for name in sorted(set(self.sensitivity) - gases):
            yield f"{where}.sensitivity: '{name}' is not in the air of this scenario; is its name right?"
        for name in sorted(gases - set(self.sensitivity) - {"acetone"}):
            if not model.feels(name):
                yield f"{where}.kind: a metal oxide does not respond to '{name}': it reads clean air"
            elif model.curve(name) is None:
                yield f"{where}.sensitivity: unknown for '{name}', which is taken for {model.gas}; give a value"
