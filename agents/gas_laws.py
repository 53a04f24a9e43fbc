"""Static laws (transfer functions) of gas sensors: from ppm to a signal y, and back by the calibration.

Lag, drift and noise act on the signal y: ln(R_air/R) of a metal oxide, ppm of a linear detector. Both rise with the
concentration and are zero in clean air.
"""

from dataclasses import dataclass
from functools import partial
from math import sqrt
from typing import Protocol, cast

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import exp, log
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.sensors import IdealGasSensor, MoxSensor, PidSensor, TdlasSensor

LN10 = float(np.log(10.0))
SPREAD_OF_B = 0.08  # standard deviation from unit to unit: our choice
UNITS = 256  # sensor units prepared for environments; each episode takes one
DIFFER = ("b", "air", "k0", "k1", "k2", "k3", "x_low")  # parameters in which units differ
INJECTED = np.geomspace(5.0, 1000.0, 14)  # ppm, concentrations injected in a calibration


class Law(Protocol):
    """Static law of all gas sensors of a kind, from concentration to signal y and back. The ti.funcs take the index n
    of a robot among the robots with such a sensor. slot: number of the gas sensor on each robot.
    """

    HAS_RESISTANCE: bool

    def __init__(self, members: Members, slot: int = 0): ...

    def renew(self, n, unit):
        """ti.func: exchange the sensor unit of robot n at the start of an episode; unit: random, from 0 to 1."""
        ...

    def response(self, n, ppm):
        """ti.func: return the steady signal y at a concentration [ppm] weighted by the sensitivity to each species."""
        ...

    def resistance(self, n, y):
        """ti.func: return the measured quantity for the signal y: a resistance [ohm] if the sensor has one, else y."""
        ...

    def ppm(self, n, r):
        """ti.func: return the calibrated reading [ppm] for the measured quantity r."""
        ...


@dataclass(frozen=True)
class Calibration:
    """Calibration curve log10 c = k0 + k1 x + k2 x² + k3 x³ with x = log10(R/R_air), c in ppm; x_low: x of the smallest
    injected c. Ferri et al., Robotics and Autonomous Systems 57 (2009) 393-402, eq 1-2.
    """

    k: np.ndarray
    x_low: float

    @staticmethod
    def of(c0: float, b: float) -> "Calibration":
        """Return the least-squares fit to R/R_air = (1 + c/c0)^-b at the injected concentrations."""
        x = -b * np.log10(1.0 + INJECTED / c0)
        return Calibration(np.polynomial.polynomial.polyfit(x, np.log10(INJECTED), 3), float(x[0]))


class MoxLaw:
    """Metal-oxide law y = ln(R_air/R) = b ln(1 + c/c0), a power law far above c0. Units differ in b and R_air."""

    HAS_RESISTANCE: bool = True

    def __init__(self, members: Members, slot: int = 0):
        self.cubic = any(_mox(group, slot).calibration != "model" for group in members.groups)
        self.p = Parameters(members, partial(_units, members.swarm, slot))
        self.box = ti.field(ti.f32, (UNITS, len(DIFFER)))  # parameters of the prepared units
        self.different = tuple(getattr(self.p, name) for name in DIFFER)
        if members.swarm.episodes is not None:
            rng = generator(members.swarm.seed, numbered("box of units", slot))
            drawn = _of_units(_mox(members.swarm.groups[0], slot), _drawn(rng, UNITS))
            self.box.from_numpy(np.stack([np.broadcast_to(drawn[name], UNITS) for name in DIFFER], axis=1))

    @ti.func
    def renew(self, n, unit):
        u = ti.min(ti.cast(unit * UNITS, ti.i32), UNITS - 1)
        for k in ti.static(range(len(DIFFER))):
            self.different[k][n] = self.box[u, k]

    @ti.func
    def response(self, n, ppm):
        return self.p.b[n] * log(1.0 + ppm * self.p.per_c0[n])

    @ti.func
    def resistance(self, n, y):
        """Return robot n's sensor resistance [ohm] at the signal y, as rounded by the converter to digits."""
        r = self.p.air[n] * exp(-y)
        if self.p.steps[n] > 0.0:  # of the voltage over the load, as a share of the supply
            load, step = self.p.load[n], self.p.per_step[n]
            share = ti.round(load / (load + r) * self.p.steps[n]) * step
            r = load * (1.0 / ti.math.clamp(share, 0.5 * step, 1.0) - 1.0)
        return r

    @ti.func
    def ppm(self, n, r):
        """Return the concentration [ppm] of the calibration gas at the resistance r [ohm] of the sensor of robot n, at
        least 0.
        """
        x = log(ti.max(r, 1e-3) / self.p.air[n])
        c = self.p.c1[n] * exp(-x * self.p.per_b[n]) - self.p.c1[n]
        if ti.static(self.cubic):
            if self.p.cubic[n] == 1:
                x = ti.min(x / LN10, 0.0)
                low = self.p.x_low[n]
                inside = ti.min(x, low)
                k2 = self.p.k2[n] + inside * self.p.k3[n]
                c = exp(LN10 * (self.p.k0[n] + inside * (self.p.k1[n] + inside * k2)))
                # a cubic of logarithms never reaches 0 ppm: continue by a line into clean air
                c *= ti.select(x > low, x / low, 1.0)
        return ti.max(c, 0.0)


class LinearLaw:
    """Law y = c of an ideal gas sensor, or of a photo-ionisation detector in ppm of its calibration gas."""

    HAS_RESISTANCE: bool = False

    def __init__(self, members: Members, slot: int = 0):
        self.p = Parameters(members, lambda group: {"limit": _linear(group, slot).detection_limit_ppm})

    @ti.func
    def renew(self, n, unit):
        """Do nothing: all units of a linear sensor are alike."""

    @ti.func
    def response(self, n, ppm):
        return ppm

    @ti.func
    def resistance(self, n, y):
        """Return the signal y unchanged, as a linear sensor has no resistance."""
        return y

    @ti.func
    def ppm(self, n, r):
        return ti.select(r >= self.p.limit[n], ti.max(r, 0.0), 0.0)


class LineLaw(LinearLaw):
    """Law of a laser gas sensor: y is the integral along the beam of the gas to which the laser is tuned [ppm m]."""

    def __init__(self, members: Members, slot: int = 0):
        def numbers(group: GroupRange) -> Numbers:
            sensor = cast(TdlasSensor, group.model.sensors.noses[slot])
            return {"limit": sensor.detection_limit_ppm_m, "largest": sensor.largest_ppm_m}

        self.p = Parameters(members, numbers)

    @ti.func
    def ppm(self, n, r):
        """Return the measured integral [ppm m], zero below the detection limit and at most the range of the laser."""
        return ti.select(r >= self.p.limit[n], ti.math.clamp(r, 0.0, self.p.largest[n]), 0.0)


LAWS: dict[str, type[Law]] = {"mox": MoxLaw, "linear": LinearLaw, "line": LineLaw}
"""Classes of static laws, by the value `law` of a gas sensor."""


def numbered(name: str, slot: int) -> str:
    """Return the name of a sensor's random stream: `name`, with the number `slot` appended unless slot is 0."""
    return f"{name} {slot}" if slot else name


def _units(swarm: Swarm, slot: int, group: GroupRange) -> Numbers:
    """Return the parameters of a group's metal-oxide sensors, with random deviations from unit to unit."""
    if swarm.episodes is not None:  # each episode takes one of the prepared units
        return _of_units(_mox(group, slot), np.zeros((group.size, 2)))
    draws = group.generators(swarm.seed, numbered("units", slot))
    return _of_units(_mox(group, slot), np.concatenate([_drawn(rng, group.count) for rng in draws]))


def _drawn(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return random deviations of `count` sensor units in b and in R_air, (count, 2), uniform from -1 to 1."""
    return rng.uniform(-1.0, 1.0, (count, 2))


def _of_units(sensor: MoxSensor, units: np.ndarray) -> Numbers:
    """Return the kernel parameters of metal-oxide sensors; units: deviations of each unit in b and R_air, (n, 2)."""
    model, (c1, b1) = MOX_MODELS[sensor.model], sensor.reading_curve
    b = model.b * np.exp(SPREAD_OF_B * sensor.spread * sqrt(3.0) * units[:, 0])
    low, high = np.log(model.air)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    cubic = sensor.calibration != "model"
    k = _fits(c1, b * (b1 / model.b)) if cubic else np.zeros((len(units), 5))
    if sensor.calibration == "extrapolated_cubic":
        k[:, 4] = 0.0  # x of clean air: no line
    steps = 2.0 ** (sensor.bits or 0) - 1.0
    return {
        "per_c0": 1.0 / model.c0,
        "b": b,
        "c1": c1,  # c0 of the calibration gas
        "per_b": 1.0 / b1,  # of the sensor model: a calibration without fit does not know the unit
        "air": np.exp(middle + half * min(sensor.spread, 1.0) * units[:, 1]),
        "load": sensor.load or model.load,
        "steps": steps,  # of the converter, 0 without rounding
        "per_step": 1.0 / max(steps, 1.0),
        "cubic": cubic,
        **{name: k[:, n] for n, name in enumerate(("k0", "k1", "k2", "k3", "x_low"))},
    }


def _fits(c0: float, b: np.ndarray) -> np.ndarray:
    """Return the calibration coefficients k0 to k3 and x_low of each unit with exponent b, (units, 5)."""
    different, which = np.unique(b, return_inverse=True)
    fits = [Calibration.of(c0, exponent) for exponent in different]
    return np.array([[*fit.k, fit.x_low] for fit in fits])[which]


def _mox(group: GroupRange, slot: int) -> MoxSensor:
    return cast(MoxSensor, group.model.sensors.noses[slot])


def _linear(group: GroupRange, slot: int) -> PidSensor | IdealGasSensor:
    return cast("PidSensor | IdealGasSensor", group.model.sensors.noses[slot])
