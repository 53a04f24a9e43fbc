"""Open-path gas lasers (TDLAS): line integral of a gas along the beam, from the robot to the first surface.

The integral uses the midpoint rule, at points no farther apart than the smallest features of the gas. For a Gaussian
of standard deviation s its error is 2 exp(-2 (pi s/h)²) with points h apart, less than 1e-8 for h = s. The end of the
beam is found by sphere tracing and bisection.
"""

from collections.abc import Sequence
from functools import partial
from typing import cast

import numpy as np

from taichi_plume.agents.gas_laws import Law
from taichi_plume.agents.gas_sensors import GasSensors
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin
from taichi_plume.grid.fields import Species
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.sensors import TdlasSensor

STRIDES = 4096  # steps until a beam ends
SAFE = 0.57  # fraction of a distance that is free: between nodes a distance changes by up to sqrt(3) times the path
HALVINGS = 6
MOST_POINTS = 20_000


class Surroundings:
    """Surfaces that stop the beams of lasers and the rays of range sensors.

    level: object whose ti.func ``distance(x)`` returns the distance to the next obstacle [m], negative inside; None
    without obstacles. extent: size of the domain per axis [m]. step: default distance of points along a beam [m]; cell:
    edge of the grid cells [m].
    """

    def __init__(self, level: object, extent: Sequence[float], step: float, cell: float):
        self.level, self.extent, self.step, self.cell = level, tuple(extent), step, cell
        self.stands, self.dim = level is not None, len(self.extent)

    @ti.func
    def reach(self, swarm: Template, x, e, end):
        """Return the length [m] of a beam from x along e, to the first surface or at most `end`."""
        for d in ti.static(range(self.dim)):
            if e[d] > 0.0:
                end = ti.min(end, (self.extent[d] - x[d]) / e[d])
            elif e[d] < 0.0:
                end = ti.min(end, -x[d] / e[d])
        end = ti.max(self._of_walkers(swarm, x, e, end), 0.0)
        if ti.static(self.stands):
            end = self._of_obstacles(x, e, end)
        return end

    @ti.func
    def _of_walkers(self, swarm: Template, x, e, end):
        """Return the length [m] of a beam from x along e, at most `end`, up to the first moving obstacle."""
        level = ti.Vector([e[0], e[1]])
        cosine = ti.max(level.norm(), 1e-6)
        for k in range(swarm.walker_count):
            to = swarm.discs[k] - ti.Vector([x[0], x[1]])
            along = to.dot(level) / cosine
            inside = swarm.disc_radius[k] ** 2 - (to.norm_sqr() - along**2)
            if along > 0.0 and inside > 0.0:
                end = ti.min(end, (along - ti.sqrt(inside)) / cosine)
        return end

    @ti.func
    def _of_obstacles(self, x, e, end):
        """Return the length [m] of a beam from x along e, at most `end`, up to the first obstacle."""
        free, s, strides = 0.0, 0.0, 0
        least = ti.static(0.1 * self.cell)
        while s < end and strides < STRIDES:
            strides += 1
            away = self.level.distance(x + s * e)
            if away > 0.0:
                free = s
                s += ti.max(SAFE * away, least)
            else:
                end = s
                for _ in range(HALVINGS):
                    middle = 0.5 * (free + end)
                    if self.level.distance(x + middle * e) > 0.0:
                        free = middle
                    else:
                        end = middle
        return end


class LineSensors(GasSensors):
    """Laser gas sensors of several groups: readings are the beam's integral [ppm m] or mean [ppm], `true_ppm` the mean.

    around: surfaces that stop the beams.
    """

    def __init__(
        self,
        members: Members,
        law: type[Law],
        dim: int,
        tick: float,
        species: Sequence[Species],
        slot: int,
        around: Surroundings,
        background: Sequence[float] = (),
    ):
        super().__init__(members, law, dim, tick, species, slot, background=background)
        self.around = around
        self.beam = Parameters(members, partial(_beam, slot, around.step))
        self.length = ti.field(ti.f32, members.size)  # length of each beam [m]
        # beams from the believed poses, for gas maps: start and vector to the end [m], and whether the reading is new
        self.beam_start, self.beam_way = (ti.vector_field(dim, ti.f32, members.size) for _ in range(2))
        self.beam_is_new = ti.field(ti.i32, members.size)
        gives = [cast(TdlasSensor, group.model.sensors.noses[slot]).gives for group in members.groups]
        self.gives_mean = np.repeat(np.array(gives) == "mean", [group.size for group in members.groups])

    @ti.func
    def direction(self, n, i, t):
        """Return the unit vector of the beam of sensor n, on robot i, at time t [s]."""
        swept = self.beam.per_span[n] * t
        swept -= 2.0 * ti.floor(0.5 * swept)
        swept = ti.min(swept, 2.0 - swept) - 0.5  # from -1/2 to 1/2 and back
        level = cos_sin(self.swarm.heading[i] + self.beam.bearing[n] + self.beam.span[n] * swept)
        e = ti.Vector.zero(ti.f32, self.dim)
        e[0], e[1] = level[0], level[1]
        if ti.static(self.dim == 3):
            up = cos_sin(self.beam.tilt[n])
            e = ti.Vector([up[0] * level[0], up[0] * level[1], up[1]])
        return e

    @ti.func
    def exposure(self, gas: Template, n, i, t, tick, deviate):
        """Return the gas integral along the beam of sensor n, on robot i, at time t [s], by species weights [ppm m]."""
        x, e = self.place(n, i), self.direction(n, i, t)
        end = self.around.reach(self.swarm, x, e, self.beam.range[n])
        count = ti.math.clamp(ti.cast(ti.ceil(end * self.beam.per_step[n]), ti.i32), 1, MOST_POINTS)
        step, total = end / count, 0.0
        for k in range(count):
            ppm = ti.max(gas.ppm(x + (k + 0.5) * step * e, t), 0.0)
            for s in ti.static(range(self.species)):
                total += self.p.weights[n, s] * ppm[s]
        self.length[n] = end
        self.true_ppm[i] = total / count
        if ti.static(self.first):
            self._show_beam(n, i, x, end * e)
            self.beam_is_new[n] = self.is_due(n, tick)
        return total * step

    @ti.func
    def _show_beam(self, n, i, x, way):
        """Write the beam of sensor n, on robot i, from x along `way` [m], as seen from the robot's believed pose."""
        turn = cos_sin(self.swarm.believed_heading[i] - self.swarm.heading[i])
        place = self.swarm.believed_position[i]
        off = ti.Vector([x[0], x[1]]) - self.swarm.position[i]
        start, beam = x, way
        start[0] = place[0] + turn[0] * off[0] - turn[1] * off[1]
        start[1] = place[1] + turn[1] * off[0] + turn[0] * off[1]
        beam[0] = turn[0] * way[0] - turn[1] * way[1]
        beam[1] = turn[1] * way[0] + turn[0] * way[1]
        self.beam_start[n], self.beam_way[n] = start, beam

    @ti.func
    def clean(self, n):
        return self.p.clean[n] * self.length[n]

    @ti.func
    def read(self, n, i, tick, r, ppm):
        if self.is_due(n, tick):
            per = 1.0
            if self.beam.gives_mean[n] == 1:
                per = ti.max(self.length[n], 1e-3)
            excess = ppm / per
            if ti.static(self.zeroed):
                excess = ti.max(ppm - self.clean_ppm(n), 0.0) / per
            self.write(i, ppm / per, excess)


def _beam(slot: int, step: float, group: GroupRange) -> Numbers:
    """Return the beam parameters of a group's laser sensors for kernels."""
    sensor = cast(TdlasSensor, group.model.sensors.noses[slot])
    span = np.radians(sensor.sweep_deg)
    return {
        "range": sensor.range,
        "bearing": np.radians(sensor.bearing_deg),
        "tilt": np.radians(sensor.tilt_deg),
        "span": span,
        "per_span": np.radians(sensor.sweep_rate_deg) / span if span else 0.0,
        "per_step": 1.0 / (sensor.step or step),
        "gives_mean": sensor.gives == "mean",
    }
