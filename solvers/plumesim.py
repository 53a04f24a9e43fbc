"""The plumes of PlumeSim (Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010):
frames of points from files, its Gaussian puff on nodes, its static plume of random points.

All are planar: in 3-D they are the same at every height, and their wind is horizontal.
"""

from math import floor, pi, sqrt

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.files.point_frames import PointFrames
from taichi_plume.grid.fields import Gas, Wind
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.playback import PlumeSimWind, PointPlayback
from taichi_plume.scenario.plumesim import FluentGas, PercentGas, PlumeSimGas, PlumeSimMeander, PlumeSimPuff
from taichi_plume.solvers.point_cloud import PointCloud

STATIONS = 20  # of the meandering centre line
TURN = 0.2  # standard deviation of its change of course per station, over their distance

MOST_PERIODS = 1e15
ROUNDING = 1.000001  # factor on a radius, so that points at the radius count


def density_per_percent(gas: PercentGas) -> float:
    """Return the concentration [kg/m³] of one percent, the unit of PlumeSim's plumes (100 %: `full_scale_ppm`)."""
    return 0.01 * gas.full_scale_ppm / gas.vapour.ppm_per_density


def periods(time: float, period: float) -> int:
    """Return the number of whole periods in a time, rounded down; negative before 0."""
    return floor(min(max(time / period, -MOST_PERIODS), MOST_PERIODS) + 1e-6)


class PointFilm:
    """Player of frames of points with values: sets a point cloud on the device to the frame of the simulated time."""

    STATE = ("cloud", "shown")

    def __init__(
        self,
        model: PointPlayback,
        frames: PointFrames,
        extent: tuple[float, ...],
        value: np.ndarray,
        t: float,
    ):
        """Start at simulated time t [s]; value: (n, values) for all points; model: start, rate, loop and offset."""
        self.frames, self.interpolates = frames, model.interpolate
        self.cloud = PointCloud(extent, frames.cell, value.shape[1], int(np.diff(frames.begin).max()))
        self.model, self.value = model, value
        self.place = frames.place + np.array(model.offset)
        self.shown = -1
        self.show(t)

    def show(self, t: float) -> None:
        """Put the points of the frame at simulated time t [s] into the cloud."""
        n = self.frame_at(t)
        if n != self.shown:
            points = self.frames.frame(n)
            self.cloud.set(self.place[points], self.value[points])
            self.shown = n

    def frame_at(self, t: float) -> int:
        """Return the index of the frame that is played at simulated time t [s]."""
        n = periods(self.model.start + self.model.rate * t, self.frames.period)
        return n % len(self.frames) if self.model.loop else min(max(n, 0), len(self.frames) - 1)

    @ti.func
    def at(self, x: Template):
        """Return the values of the present frame at point x [m]: interpolated, or those of the nearest point."""
        return self.cloud.between(x) if ti.static(self.interpolates) else self.cloud.nearest(x)


class PointGas(Gas):
    """Gas whose concentration is given at points in recorded frames, which were checked when read."""

    STATE = ("film",)

    def __init__(
        self, gas: PlumeSimGas | FluentGas, frames: PointFrames, extent: tuple[float, ...], t: float = 0.0
    ):
        self.species = gas.vapour
        self.film = PointFilm(gas, frames, extent, density_per_percent(gas) * frames.percent[:, None], t)

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)

    @ti.func
    def concentration(self, x: Template, t: float):
        return self.film.at(x)[0]


class PointWind(Wind):
    """Wind that is given at points in recorded frames, and zero farther from them."""

    STATE = ("film",)

    def __init__(
        self,
        wind: PlumeSimWind,
        frames: PointFrames,
        extent: tuple[float, ...],
        t: float = 0.0,
    ):
        self.dim = len(extent)
        self.film = PointFilm(wind, frames, extent, frames.wind, t)

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)

    @ti.func
    def velocity(self, x: Template, t: float):
        flat = self.film.at(x)
        u = ti.Vector.zero(ti.f32, self.dim)
        u[0], u[1] = flat[0], flat[1]
        return u


class ProgramPuff(Gas):
    """Gaussian puff as the program PlumeSim computes it: on nodes, with a spread that grows from frame to frame.

    Fields, for the axes x and y: release [m], lowest and highest number of a node, spread [m² per frame]; number:
    number of the present frame.
    """

    STATE = ("number",)

    def __init__(self, gas: PlumeSimPuff, extent: tuple[float, ...], t: float = 0.0):
        self.model, self.species = gas, gas.vapour
        self.number = ti.field(ti.f32, ())
        nodes = np.array([max(1, int(width / gas.cell + 1e-9)) for width in extent[:2]])
        wide = 4 * pi * sqrt(gas.diffusion[0] * gas.diffusion[1])
        self.release, self.spread = ti.filled_vectors(gas.release_point), ti.filled_vectors(gas.diffusion)
        self.lowest = ti.filled_vectors(1 - nodes if gas.all_around else 0 * nodes, ti.f32)
        self.highest = ti.filled_vectors(nodes - 1, ti.f32)
        self.cell, self.reach2 = ti.filled(gas.cell), ti.filled(gas.cell**2)
        self.peak = ti.filled(density_per_percent(gas) * gas.amount / wide)
        self._show(t)

    def frame_at(self, t: float) -> int:
        """Return the number, from 1 on, of the puff's frame at simulated time t [s]; the last frames repeat."""
        gas = self.model
        n = 1 + max(0, periods(gas.start + t, gas.period))
        return n if n <= gas.last else gas.repeat_from + (n - gas.last - 1) % (gas.last - gas.repeat_from + 1)

    def _show(self, t: float) -> None:
        self.number[None] = self.frame_at(t)

    def advance(self, t: float, dt: float) -> None:
        self._show(t + dt)

    @ti.func
    def concentration(self, x: Template, t: float):
        """Return the concentration [kg/m³] of the node nearest to x [m] in the present frame; 0 if none is near."""
        n, cell = self.number[None], self.cell[None]
        gap2, exponent = 0.0, 0.0
        for d in ti.static(range(2)):
            place = x[d] - self.release[None][d]
            node = cell * ti.math.clamp(ti.round(place / cell), self.lowest[None][d], self.highest[None][d])
            gap2 += (place - node) ** 2
            exponent -= node**2 / (4.0 * n * self.spread[None][d])
        return ti.select(gap2 < self.reach2[None], self.peak[None] / n * ti.exp(exponent), 0.0)


def meandering_points(gas: PlumeSimMeander, length: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the random points (n, 2) [m] of PlumeSim's meandering plume; length: of the domain along x [m]."""
    x0, y0 = gas.release_point
    step = (length - x0) / STATIONS
    stations = x0 + step * np.arange(STATIONS)
    turn = TURN * step * rng.standard_normal(STATIONS)  # first point, course, and changes of course
    y = y0 + np.concatenate([[0.0], np.cumsum(np.cumsum(turn))[:-1]])
    spacing = (stations[-1] - x0) / gas.points
    between = np.arange(gas.points // (STATIONS - 1) + 1) * spacing
    x = np.append((stations[:-1, None] + between).ravel(), stations[-1])
    stray = gas.dispersion * gas.release_rate * (x - x0) * rng.standard_normal(len(x))
    return np.stack([x, np.interp(x, stations, y) + stray], axis=-1)


class ProgramMeander(Gas):
    """Meandering plume of the program PlumeSim: number of points near a position over that near the release."""

    def __init__(
        self,
        gas: PlumeSimMeander,
        extent: tuple[float, ...],
        seed: int = 0,
        name: str = "gas",
    ):
        """Draw the points of the plume; name: of the gas, which selects its random numbers."""
        self.species = gas.vapour
        self.place = meandering_points(gas, extent[0], generator(seed, f"{name} meandering"))
        self.cloud = PointCloud(extent, ROUNDING * gas.radius, 1, len(self.place))
        self.cloud.set(self.place, np.zeros((len(self.place), 1)))
        start = np.add(gas.release_point, (gas.radius, 0.0))
        # the release itself lies exactly at this distance, and counts
        most = int((np.linalg.norm(self.place - start, axis=1) <= ROUNDING * gas.radius).sum())
        self.share, self.full = 100.0 / most, density_per_percent(gas)

    def advance(self, t: float, dt: float) -> None:
        """Do nothing: the plume is static."""

    @ti.func
    def concentration(self, x: Template, t: float):
        return self.full * ti.min(100.0, self.share * self.cloud.count(x))
