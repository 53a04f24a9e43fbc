"""All sensors of the robots: gas sensors, lasers, anemometers and range sensors, with a kernel for each law."""

from collections.abc import Callable, Sequence
from math import exp
from typing import cast

from taichi_plume.agents.anemometers import Anemometers
from taichi_plume.agents.gas_classes import GasClassifier
from taichi_plume.agents.gas_laws import LAWS
from taichi_plume.agents.gas_sensors import GasSensors
from taichi_plume.agents.heated_sensors import HeatedSensors
from taichi_plume.agents.line_sensors import LineSensors, Surroundings
from taichi_plume.agents.members import Members
from taichi_plume.agents.range_sensors import RangeSensors
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.engine.fields import on_cpu
from taichi_plume.grid.fields import Odour, Species, Wind
from taichi_plume.grid.kernels import Template

STRIP = 16  # sensors computed together on a CPU: LLVM vectorises loops without global stores
WARMING = 900.0  # s, time constant of the heater warm-up after a cold start: our choice


class Sensors:
    """Sensors of all robots: gas sensors and anemometers, measured in one launch per law, and range sensors.

    The first gas sensors are measured with the anemometers (`vanes`), each further gas sensor (`others`) in its own
    launch. dim: dimension of gas and wind; in 3-D the sensors sit at their heights. tick: control period [s]. species:
    of the gas. around: returns the surfaces that stop beams; called only if there are lasers or range sensors.
    fluctuates: whether point sensors feel unresolved fluctuations of the gas. background: of each species in clean air
    [ppm], to which the sensors are zeroed; () for none.
    """

    STATE: tuple[str, ...] = ("noses", "vanes")

    @ti.shared_memory()
    def __init__(
        self,
        swarm: Swarm,
        dim: int,
        tick: float,
        species: Sequence[Species],
        around: Callable[[], Surroundings] | None = None,
        fluctuates: bool = False,
        background: Sequence[float] = (),
    ):
        self.count = swarm.count
        self.strip = STRIP if on_cpu() else 1
        alike: dict[tuple[int, str, bool], list[int]] = {}
        for group in swarm.groups:
            for slot, sensor in enumerate(group.model.sensors.noses):
                alike.setdefault((slot, sensor.law, sensor.cycled), []).append(group.number)
        members = {key: Members(swarm, numbers) for key, numbers in alike.items()}
        with_ranges = [group.number for group in swarm.groups if group.model.sensors.ranges]
        stops = None
        if around and (with_ranges or any(law == "line" for _, law, _ in alike)):
            stops = around()
        self.ranges = RangeSensors(Members(swarm, with_ranges), dim, stops) if stops and with_ranges else None
        made = {}
        for (slot, law, cycled), some in members.items():
            all_alike = some, LAWS[law], dim, tick, species, slot
            if law == "line":
                made[slot, law, cycled] = LineSensors(*all_alike, cast(Surroundings, stops), background)
            else:
                kind = HeatedSensors if cycled else GasSensors
                made[slot, law, cycled] = kind(*all_alike, fluctuates, background)
        self.noses = tuple(sensor for (slot, *_), sensor in made.items() if slot == 0)
        self.vanes = tuple(Anemometers(some, dim, tick) for (slot, *_), some in members.items() if slot == 0)
        self.others = tuple(sensor for (slot, *_), sensor in made.items() if slot > 0)
        if self.others:
            self.STATE = (*self.STATE, "others")
        self.classifiers: tuple[GasClassifier, ...] = ()
        if any(background) and self.count and swarm.episodes is None:
            for sensor in (*self.noses, *self.others):
                self._read_clean_air(sensor, sum(background))

    def classify_by(self, classifiers: tuple[GasClassifier, ...]) -> None:
        """Let classifiers distinguish the gases after each measurement."""
        self.classifiers = classifiers
        if classifiers:
            self.STATE = (*self.STATE, "classifiers")

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update all readings from gas and wind at time t [s]; tick: number of the control period, from 1 on."""
        if self.count:
            for sensor, anemometer in zip(self.noses, self.vanes, strict=True):
                self._sense(sensor, anemometer, gas, wind, tick, t, exp(-t / WARMING))
            for sensor in self.others:
                self._sense(sensor, None, gas, wind, tick, t, exp(-t / WARMING))
            for classifier in self.classifiers:
                classifier.classify()
            if self.ranges is not None:
                self.ranges.measure(tick)

    @property
    def lasers(self) -> LineSensors | None:
        """First gas sensors of all robots with lasers; None without."""
        return next((sensor for sensor in self.noses if isinstance(sensor, LineSensors)), None)

    @ti.kernel
    def _read_clean_air(self, sensor: Template, background: float):
        """Write the readings of sensors in clean air, which hold before the first time step; background: sum [ppm]."""
        for n in range(sensor.members.size):
            i = sensor.members.robot[n]
            sensor.measured[i] = sensor.clean_ppm(n)
            sensor.true_ppm[i] = background

    @ti.kernel
    def _sense(
        self,
        sensor: Template,
        anemometer: Template,
        gas: Template,
        wind: Template,
        tick: int,
        t: float,
        cold: float,
    ):
        ti.loop_config(serialize=ti.static(runs_serially(sensor.members.size)))
        for k in range((sensor.members.size + self.strip - 1) // self.strip):
            self.sense_strip(sensor, anemometer, gas, wind, k * self.strip, tick, t, cold)

    @ti.func
    def renew(self, i, unit):
        """Reset the sensors of robot i to the start of a run; unit: random, 0 to 1, selects the sensor units."""
        self.noses[0].renew(i, unit)
        self.vanes[0].renew(i)
        for sensor in ti.static(self.others):
            sensor.renew(i, unit)

    @ti.func
    def sense_strip(
        self, sensor: Template, anemometer: Template, gas: Template, wind: Template, first, tick, t, cold
    ):
        """Measure with a strip of gas sensors and anemometers, if any, from index `first` on, in active trials."""
        last = sensor.members.size - 1
        count = ti.min(self.strip, last + 1 - first)
        noise, drift = ti.Vector([0.0] * self.strip), ti.Vector([0.0] * self.strip)
        own, fluctuation = ti.Vector([0.0] * self.strip), ti.Vector([0.0] * self.strip)
        across, along = ti.Vector([0.0] * self.strip), ti.Vector([0.0] * self.strip)
        y, r = ti.Vector([0.0] * self.strip), ti.Vector([0.0] * self.strip)
        for m in range(self.strip):
            n = ti.min(first + m, last)
            noise[m], drift[m], own[m], fluctuation[m] = sensor.draw(n, tick)
            if ti.static(sensor.first):
                across[m], along[m] = anemometer.draw(n, tick)
        for m in range(count):
            n = first + m
            i = sensor.members.robot[n]
            if sensor.swarm.takes_part(i):
                now, at = sensor.swarm.clock(i, tick, t)
                y[m] = sensor.exposure(gas, n, i, at, now, fluctuation[m])
                if ti.static(sensor.first):
                    anemometer.measure(wind, n, i, now, at, ti.Vector([across[m], along[m]]))
        for m in range(self.strip):
            y[m] = sensor.law.response(ti.min(first + m, last), y[m])
        for m in range(count):
            i = sensor.members.robot[first + m]
            if sensor.swarm.takes_part(i):
                now, at = sensor.swarm.clock(i, tick, t)
                warm = cold
                if ti.static(sensor.swarm.apart):
                    warm = ti.exp(-at / WARMING)
                if ti.static(sensor.zeroed):
                    if now == 1:
                        sensor.settle(first + m)
                y[m] = sensor.lag(first + m, now, warm, y[m], noise[m], drift[m], own[m])
        for m in range(self.strip):
            n = ti.min(first + m, last)
            r[m] = sensor.law.resistance(n, y[m])
            y[m] = sensor.law.ppm(n, r[m])
        for m in range(count):
            n = first + m
            i = sensor.members.robot[n]
            if sensor.swarm.takes_part(i):
                sensor.read(n, i, sensor.swarm.clock(i, tick, t)[0], r[m], y[m])
