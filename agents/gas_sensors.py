"""What gas sensors make of a concentration: static laws, from ppm to a signal y and back.

The signal is what lags, drifts and scatters: ln(R_air/R) of a metal oxide, ppm of a linear detector. Both rise with
the concentration and are zero in clean air.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, sqrt
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.scenario.sensors import IdealGasSensor, MoxSensor, PidSensor
from taichi_plume.scenario.species import Species

LN10 = log(10.0)
SPREAD_OF_B = 0.08  # of unit to unit: our choice
# ln R per kelvin and per ln of the relative humidity: order of magnitude of the maker's plots of the TGS sensors
LN_R_PER_KELVIN = -0.015
LN_R_PER_LN_HUMIDITY = -0.25
CALIBRATED_AT = (293.15, 0.65)  # K, relative humidity
WARMING = 900.0  # s, time constant after a cold start: our choice
INJECTED = np.geomspace(5.0, 1000.0, 14)  # ppm, of a calibration
ISOBUTYLENE = "isobutylene"


@dataclass(frozen=True)
class MoxModel:
    """A metal-oxide sensor, R = R_air (1 + c/c0)^-b of ethanol.

    c0 [ppm]; b; rise and decay: time constants [s]; air: range of R_air [ohm]; load: resistor in series [ohm].
    """

    c0: float
    b: float
    rise: float
    decay: float
    air: tuple[float, float]
    load: float = 10e3


# b and c0 from R(300 ppm)/R(50 ppm) and R_air/R(300 ppm) of the data sheets, if nothing else is said. Time constants of
# the TGS 26xx: GADEN (Monroy et al. 2017, doi:10.3390/s17071479), from experiments; the others are our estimates.
MOX_MODELS = {
    # its sheet (1990) tells of hydrogen alone: taken like the TGS 822, of the same make
    "tgs800": MoxModel(c0=0.9, b=0.511, rise=4.0, decay=20.0, air=(10e3, 130e3)),
    "tgs822": MoxModel(c0=0.9, b=0.511, rise=4.0, decay=20.0, air=(19.5e3, 195e3)),
    "tgs2600": MoxModel(c0=0.299, b=0.3196, rise=4.8, decay=18.75, air=(10e3, 90e3)),  # GADEN's power law
    "tgs2620": MoxModel(c0=4.32, b=0.7155, rise=2.96, decay=15.71, air=(21e3, 105e3)),  # GADEN's power law
    # R/R0 = (c/1.62)^-0.644 in common drivers of its sensing element (in the MiCS-6814)
    "mics5524": MoxModel(c0=1.6, b=0.644, rise=1.5, decay=8.0, air=(100e3, 1500e3), load=47e3),
}


@dataclass(frozen=True)
class Calibration:
    """log10 c = k0 + k1 x + k2 x² + k3 x³ with x = log10(R/R_air), c in ppm; x_low: of the least injected c.

    Ferri et al., Robotics and Autonomous Systems 57 (2009) 393-402, eq 1-2.
    """

    k: np.ndarray
    x_low: float

    @staticmethod
    def of(c0: float, b: float) -> "Calibration":
        """Least squares through the resistances at the injected concentrations of a unit."""
        x = -b * np.log10(1.0 + INJECTED / c0)
        return Calibration(np.polynomial.polynomial.polyfit(x, np.log10(INJECTED), 3), float(x[0]))


@ti.data_oriented
class MoxLaw:
    """y = ln(R_air/R) = b ln(1 + c/c0): finite in clean air, a power law far above c0. Units differ in b and R_air.

    units: (n, 2), where each unit lies in the spread of b and of R_air, uniform in (-1, 1).
    """

    def __init__(self, sensor: MoxSensor, units: np.ndarray):
        self.sensor, self.model = sensor, MOX_MODELS[sensor.model]
        self.c0 = self.model.c0
        size = len(units)
        b = self.model.b * np.exp(SPREAD_OF_B * sensor.spread * sqrt(3.0) * units[:, 0])
        low, high = np.log(self.model.air)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        air = np.exp(middle + half * min(sensor.spread, 1.0) * units[:, 1])
        self.b, self.air = ti.field(ti.f32, size), ti.field(ti.f32, size)
        self.b.from_numpy(b.astype(np.float32))
        self.air.from_numpy(air.astype(np.float32))
        self.cubic = sensor.calibration == "cubic"
        self.k: Any = ti.Vector.field(5, ti.f32, size if self.cubic else 1)
        if self.cubic:
            fits = [Calibration.of(self.c0, exponent) for exponent in b]
            self.k.from_numpy(np.array([[*fit.k, fit.x_low] for fit in fits], np.float32))
        self.load = sensor.load or self.model.load
        self.steps = 2.0**sensor.bits - 1.0 if sensor.bits else 0.0
        warmer = (sensor.air_temperature or CALIBRATED_AT[0]) - CALIBRATED_AT[0]
        damper = log((sensor.air_humidity or CALIBRATED_AT[1]) / CALIBRATED_AT[1])
        self.room = -(LN_R_PER_KELVIN * warmer + LN_R_PER_LN_HUMIDITY * damper)

    def offset(self, t: float) -> float:
        """What room and heater add to y at time t [s], in any gas; the calibration knows nothing of it."""
        return self.room + self.sensor.cold_start * exp(-t / WARMING)

    def weights(self, species: Sequence[Species]) -> list[float]:
        """How much a ppm of each species counts."""
        return [self.sensor.sensitivity.get(one.name, 1.0) for one in species]

    @ti.func
    def response(self, n, ppm):
        """Steady y of unit n at a concentration."""
        return self.b[n] * ti.log(1.0 + ppm / self.c0)

    @ti.func
    def resistance(self, n, y):
        """Resistance [ohm] of unit n as the converter sees it."""
        r = self.air[n] * ti.exp(-y)
        if ti.static(self.steps > 0):  # of the voltage over the load, as a share of the supply
            share = ti.round(self.load / (self.load + r) * self.steps) / self.steps
            r = self.load * (1.0 / ti.math.clamp(share, 0.5 / self.steps, 1.0) - 1.0)
        return r

    @ti.func
    def ppm(self, n, r):
        """The concentration that unit n is taken to see at resistance r [ohm]; R_air is that of its clean air."""
        x = ti.log(ti.max(r, 1e-3) / self.air[n])
        c = self.c0 * (ti.exp(-x / ti.static(self.model.b)) - 1.0)
        if ti.static(self.cubic):
            k = self.k[n]
            x = ti.min(x / LN10, 0.0)
            inside = ti.min(x, k[4])
            c = ti.pow(10.0, k[0] + inside * (k[1] + inside * (k[2] + inside * k[3])))
            c *= ti.select(
                x > k[4], x / k[4], 1.0
            )  # a cubic of logarithms has no zero: a line into clean air
        return ti.max(c, 0.0)


@ti.data_oriented
class LinearLaw:
    """y = c of an ideal sensor, or of a photo-ionisation detector in ppm of the gas that it is calibrated for."""

    def __init__(self, sensor: PidSensor | IdealGasSensor):
        self.sensor = sensor
        self.limit = sensor.detection_limit_ppm if isinstance(sensor, PidSensor) else 0.0

    def offset(self, t: float) -> float:
        """What is added to y in any gas: nothing."""
        return 0.0

    def weights(self, species: Sequence[Species]) -> list[float]:
        """How much a ppm of each species counts."""
        if isinstance(self.sensor, IdealGasSensor):
            return [1.0] * len(species)
        factor = {ISOBUTYLENE: 1.0} | self.sensor.correction
        return [factor[self.sensor.calibrated_for] / factor.get(one.name, 1.0) for one in species]

    @ti.func
    def response(self, n, ppm):
        """Steady y at a concentration."""
        return ppm

    @ti.func
    def resistance(self, n, y):
        """There is none; what stands for it is y."""
        return y

    @ti.func
    def ppm(self, n, y):
        """What it reads."""
        return ti.select(y >= self.limit, ti.max(y, 0.0), 0.0)
