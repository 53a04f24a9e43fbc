"""What the robots measure: gas with lagging, noisy sensors, and wind with anemometers that have a threshold."""

from collections.abc import Callable, Sequence
from math import exp
from typing import cast

import taichi as ti

from taichi_plume.agents.anemometers import Anemometers
from taichi_plume.agents.few import few
from taichi_plume.agents.gas_laws import LAWS
from taichi_plume.agents.gas_sensors import GasSensors
from taichi_plume.agents.heated_sensors import HeatedSensors
from taichi_plume.agents.line_sensors import LineSensors, Surroundings
from taichi_plume.agents.members import Members
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.fields import Odour, Species, Wind
from taichi_plume.grid.kernels import Template, on_cpu

STRIP = 16  # sensors whose numbers are worked out together on a CPU: LLVM vectorises loops that store nothing global
WARMING = 900.0  # s, time constant after a cold start: our choice


@ti.data_oriented
class Sensors:
    """The sensors of all robots, measuring in one launch for each law: what they are like is read when they measure.

    Robots of several gas sensors measure with the first, and the anemometer, in the same launch as those of one; with
    each further one, of `others`, in one of its own. dim: of gas and wind; in 3-D the sensors sit at their heights.
    tick: control period [s]. species: of the gas. around: makes what stops the beams of lasers, if there are any.
    """

    STATE: tuple[str, ...] = ("noses", "vanes")

    def __init__(
        self,
        swarm: Swarm,
        dim: int,
        tick: float,
        species: Sequence[Species],
        around: Callable[[], Surroundings] | None = None,
    ):
        self.count = swarm.count
        self.strip = STRIP if on_cpu() else 1
        alike: dict[tuple[int, str, bool], list[int]] = {}
        for group in swarm.groups:
            for slot, sensor in enumerate(group.model.sensors.noses):
                alike.setdefault((slot, sensor.law, sensor.cycled), []).append(group.number)
        members = {key: Members(swarm, numbers) for key, numbers in alike.items()}
        stops = around() if around and any(law == "line" for _, law, _ in alike) else None
        made = {}
        for (slot, law, cycled), some in members.items():
            all_alike = some, LAWS[law], dim, tick, species, slot
            if law == "line":
                made[slot, law, cycled] = LineSensors(*all_alike, cast(Surroundings, stops))
            else:
                made[slot, law, cycled] = (HeatedSensors if cycled else GasSensors)(*all_alike)
        self.noses = tuple(one for (slot, *_), one in made.items() if slot == 0)
        self.vanes = tuple(Anemometers(some, dim, tick) for (slot, *_), some in members.items() if slot == 0)
        self.others = tuple(one for (slot, *_), one in made.items() if slot > 0)
        if self.others:
            self.STATE = (*self.STATE, "others")
        self.begin()

    def begin(self) -> None:
        """Set the numbers that the groups give; clean and still air before."""
        for one in (*self.noses, *self.vanes, *self.others):
            one.begin()

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update all readings at tick `tick` (from 1 on), time t [s]."""
        if self.count:
            for nose, vane in zip(self.noses, self.vanes, strict=True):
                self._sense(nose, vane, gas, wind, tick, t, exp(-t / WARMING))
            for nose in self.others:
                self._sense(nose, None, gas, wind, tick, t, exp(-t / WARMING))

    @ti.kernel
    def _sense(
        self, nose: Template, vane: Template, gas: Template, wind: Template, tick: int, t: float, cold: float
    ):
        ti.loop_config(serialize=ti.static(few(nose.members.size)))
        for k in range((nose.members.size + self.strip - 1) // self.strip):
            self.sense_strip(nose, vane, gas, wind, k * self.strip, tick, t, cold)

    @ti.func
    def renew(self, i, unit):
        """The sensors of robot i of the only group are put back to the begin of a run; unit: which one, from 0 to 1."""
        self.noses[0].renew(i, unit)
        self.vanes[0].renew(i)
        for nose in ti.static(self.others):
            nose.renew(i, unit)

    @ti.func
    def sense_strip(
        self, nose: Template, vane: Template, gas: Template, wind: Template, first, tick, t, cold
    ):
        """Measure with a strip of gas sensors, from the first one on, and of anemometers, if any; those of trials that
        rest do not.
        """
        last = nose.members.size - 1
        count = ti.min(self.strip, last + 1 - first)
        noise, drift = ti.Vector([0.0] * self.strip), ti.Vector([0.0] * self.strip)
        own = ti.Vector([0.0] * self.strip)
        across, along = ti.Vector([0.0] * self.strip), ti.Vector([0.0] * self.strip)
        y, r = ti.Vector([0.0] * self.strip), ti.Vector([0.0] * self.strip)
        for m in range(self.strip):
            n = ti.min(first + m, last)
            noise[m], drift[m], own[m] = nose.draw(n, tick)
            if ti.static(nose.first):
                across[m], along[m] = vane.draw(n, tick)
        for m in range(count):
            n = first + m
            i = nose.members.robot[n]
            if nose.swarm.takes_part(i):
                now, at = nose.swarm.clock(i, tick, t)
                y[m] = nose.smell(gas, n, i, at)
                if ti.static(nose.first):
                    vane.feel(wind, n, i, now, at, ti.Vector([across[m], along[m]]))
        for m in range(self.strip):
            y[m] = nose.law.response(ti.min(first + m, last), y[m])
        for m in range(count):
            i = nose.members.robot[first + m]
            if nose.swarm.takes_part(i):
                now, at = nose.swarm.clock(i, tick, t)
                warm = cold
                if ti.static(nose.swarm.apart):
                    warm = ti.exp(-at / WARMING)
                y[m] = nose.lag(first + m, now, warm, y[m], noise[m], drift[m], own[m])
        for m in range(self.strip):
            n = ti.min(first + m, last)
            r[m] = nose.law.resistance(n, y[m])
            y[m] = nose.law.ppm(n, r[m])
        for m in range(count):
            n = first + m
            i = nose.members.robot[n]
            if nose.swarm.takes_part(i):
                nose.read(n, i, nose.swarm.clock(i, tick, t)[0], r[m], y[m])
