"""The plumes of PlumeSim (Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010):
frames of points from files, its Gaussian puff on nodes, its static plume of random points.

All are of a plane; in 3-D they are the same at every height, and their wind is horizontal.
"""

from math import floor, pi, sqrt

import numpy as np
import taichi as ti

from taichi_plume.files.point_frames import PointFrames
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.played import PlumeSimWind, PointPlayback
from taichi_plume.scenario.plumesim import PercentGas, PlumeSimMeander, PlumeSimPuff
from taichi_plume.solvers.point_cloud import PointCloud, within_reach

STATIONS = 20  # of the meandering centre line
TURN = 0.2  # standard deviation of its change of course per station, over their distance

MOST_PERIODS = 1e15
ROUNDING = 1.000001  # of a radius: what is as far counts


def density_per_percent(gas: PercentGas) -> float:
    """Concentration [kg/m³] of one percent of the full scale."""
    return 0.01 * gas.full_scale_ppm / gas.vapour.ppm_per_density


def periods(time: float, period: float) -> int:
    """Whole periods in a time, however long."""
    return floor(min(max(time / period, -MOST_PERIODS), MOST_PERIODS) + 1e-6)


class PointFilm:
    """Keeps a point cloud as frames show it at the time of the clock. value: (n, values) of all their points."""

    def __init__(
        self, frames: PointFrames, model: PointPlayback, value: np.ndarray, extent: tuple[float, ...]
    ):
        self.frames, self.model, self.value = frames, model, value
        self.place = frames.place + np.array(model.offset)
        near = np.concatenate([[0], np.cumsum(within_reach(self.place, extent, frames.cell))])
        room = int(np.diff(near[frames.begin]).max())
        self.cloud = PointCloud(extent, frames.cell, value.shape[1], room)
        self.shown = -1

    def show(self, t: float) -> None:
        """Put the points of simulated time t [s] into the cloud."""
        n = self.frame_at(t)
        if n != self.shown:
            points = self.frames.frame(n)
            self.cloud.set(self.place[points], self.value[points])
            self.shown = n

    def frame_at(self, t: float) -> int:
        """The frame of simulated time t [s]."""
        n = periods(self.model.start + self.model.rate * t, self.frames.period)
        return n % len(self.frames) if self.model.loop else min(max(n, 0), len(self.frames) - 1)


@ti.data_oriented
class PointGas:
    """A gas known at points; satisfies `fields.Gas`."""

    def __init__(
        self,
        gas: PercentGas,
        model: PointPlayback,
        frames: PointFrames,
        extent: tuple[float, ...],
        begin: float = 0.0,
    ):
        """model: how it is played, the gas itself; begin: start of the run [s]."""
        self.species = gas.vapour
        self.film = PointFilm(frames, model, density_per_percent(gas) * frames.percent[:, None], extent)
        self.cloud, self.interpolate = self.film.cloud, model.interpolate
        self.film.show(begin)

    def advance(self, t: float, dt: float) -> None:
        """Show the time t + dt."""
        self.film.show(t + dt)

    def is_finite(self) -> bool:
        """The frames were looked at when they were read."""
        return True

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m]; the time is the player's own."""
        c = 0.0
        if ti.static(self.interpolate):
            c = self.cloud.between(x)[0]
        else:
            c = self.cloud.nearest(x)[0]
        return c


@ti.data_oriented
class PointWind:
    """A wind known at points, zero elsewhere; satisfies `fields.Wind`."""

    def __init__(
        self, wind: PlumeSimWind, frames: PointFrames, extent: tuple[float, ...], begin: float = 0.0
    ):
        self.dim = len(extent)
        self.film = PointFilm(frames, wind, frames.wind, extent)
        self.cloud, self.interpolate = self.film.cloud, wind.interpolate
        self.top_speed = float(np.linalg.norm(frames.wind, axis=1).max())  # m/s
        self.film.show(begin)

    def stable_dt(self, t: float = 0.0) -> float:
        """No limit of its own."""
        return float("inf")

    def advance(self, t: float, dt: float) -> None:
        """Show the time t + dt."""
        self.film.show(t + dt)

    @ti.func
    def velocity(self, x: Template, t: float):
        """Velocity [m/s] at point x [m]; the time is the player's own."""
        flat = ti.Vector.zero(ti.f32, 2)
        if ti.static(self.interpolate):
            flat = self.cloud.between(x)
        else:
            flat = self.cloud.nearest(x)
        u = ti.Vector.zero(ti.f32, self.dim)
        u[0], u[1] = flat[0], flat[1]
        return u


@ti.data_oriented
class ProgramPuff:
    """PlumeSim's Gaussian puff on nodes, its spread counted in frames; satisfies `fields.Gas`."""

    def __init__(self, gas: PlumeSimPuff, extent: tuple[float, ...], begin: float = 0.0):
        self.gas, self.species = gas, gas.vapour
        self.release, self.cell = gas.release_point, gas.cell
        self.nodes = tuple(max(1, int(width / gas.cell + 1e-9)) for width in extent[:2])
        self.lowest = tuple(1 - n if gas.all_around else 0 for n in self.nodes)
        self.spread = gas.diffusion
        self.peak = (
            density_per_percent(gas) * gas.amount / (4 * pi * sqrt(gas.diffusion[0] * gas.diffusion[1]))
        )
        self.number = ti.field(ti.f32, ())
        self._show(begin)

    def frame_at(self, t: float) -> int:
        """Number of the frame of simulated time t [s], from 1 on."""
        gas = self.gas
        n = 1 + max(0, periods(gas.start + t, gas.period))
        return n if n <= gas.last else gas.repeat_from + (n - gas.last - 1) % (gas.last - gas.repeat_from + 1)

    def _show(self, t: float) -> None:
        self.number[None] = self.frame_at(t)

    def advance(self, t: float, dt: float) -> None:
        """Show the time t + dt."""
        self._show(t + dt)

    def is_finite(self) -> bool:
        """A closed form is."""
        return True

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at the node nearest to x [m]; the time is the player's own."""
        n = self.number[None]
        gap2, exponent = 0.0, 0.0
        for d in ti.static(range(2)):
            place = x[d] - self.release[d]
            node = self.cell * ti.math.clamp(ti.round(place / self.cell), self.lowest[d], self.nodes[d] - 1.0)
            gap2 += (place - node) ** 2
            exponent -= node**2 / (4.0 * n * self.spread[d])
        return ti.select(gap2 < self.cell**2, self.peak / n * ti.exp(exponent), 0.0)


def meandering_points(gas: PlumeSimMeander, length: float, rng: np.random.Generator) -> np.ndarray:
    """Places (n, 2) [m] of the plume's points; length: where the domain ends along x [m]."""
    x0, y0 = gas.release_point
    step = (length - x0) / STATIONS
    stations = x0 + step * np.arange(STATIONS)
    turn = TURN * step * rng.standard_normal(STATIONS)  # its first, a course, and changes of it
    y = y0 + np.concatenate([[0.0], np.cumsum(np.cumsum(turn))[:-1]])
    spacing = (stations[-1] - x0) / gas.points
    between = np.arange(gas.points // (STATIONS - 1) + 1) * spacing
    x = np.append((stations[:-1, None] + between).ravel(), stations[-1])
    stray = gas.dispersion * gas.release_rate * (x - x0) * rng.standard_normal(len(x))
    return np.stack([x, np.interp(x, stations, y) + stray], axis=-1)


@ti.data_oriented
class ProgramMeander:
    """PlumeSim's meandering plume: how many points are near, as a share of those near its start."""

    def __init__(self, gas: PlumeSimMeander, extent: tuple[float, ...], seed: int = 0, name: str = "gas"):
        """name: of the gas among others."""
        self.species = gas.vapour
        self.place = meandering_points(gas, extent[0], generator(seed, f"{name} meandering"))
        self.cloud = PointCloud(extent, ROUNDING * gas.radius, 1, len(self.place))
        self.cloud.set(self.place, np.zeros((len(self.place), 1)))
        start = np.add(gas.release_point, (gas.radius, 0.0))
        # the release itself is exactly that far away, and counts
        most = int((np.linalg.norm(self.place - start, axis=1) <= ROUNDING * gas.radius).sum())
        self.share = 100.0 / most
        self.full = density_per_percent(gas)

    def advance(self, t: float, dt: float) -> None:
        """Nothing changes."""

    def is_finite(self) -> bool:
        """A number of points is."""
        return True

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m]."""
        return self.full * ti.min(100.0, self.share * self.cloud.count(x))
