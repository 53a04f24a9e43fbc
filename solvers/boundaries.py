"""What the domain's faces do to the air: per boundary face a prescribed velocity or an ambient pressure.

Every boundary face has, per velocity component, a target V and a mirror factor. The ghost value of a component along
the face is mirror·u + (1 - mirror)·V: 0 for blown-in air, 1 for slip and outlets. At a wall that moves with V (mirror
-1) it lies on the parabola through V and the two cells inside, which makes the friction of second order.
The component through the face is either prescribed (V) or free, with the ambient pressure outside.
"""

from collections.abc import Callable
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
import taichi as ti
from scipy.ndimage import gaussian_filter

from taichi_plume.grid.grid import Grid, block_mean
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.openings import (
    Fan,
    Honeycomb,
    Inlet,
    Jet,
    MovingWall,
    Opening,
    Outlet,
    Periodic,
    Slip,
)
from taichi_plume.scenario.windows import Region
from taichi_plume.solvers.fans import CurvedFan

AIR_DENSITY = 1.184  # kg/m³ at 25 °C
HORIZON = 1.0  # s: a step is never longer
SAMPLES = 8  # per axis, to average an opening's profile over a cell face


def periodic_axes(openings: tuple[Opening, ...], dim: int) -> tuple[bool, ...]:
    """Which axes are periodic."""
    return tuple(any(isinstance(o, Periodic) and o.axis == axis for o in openings) for axis in "xyz"[:dim])


def blows(opening: Opening | Region) -> bool:
    """Whether the opening prescribes the velocity of the air."""
    return isinstance(opening, Jet) and opening.blows


class Patch:
    """An opening on the grid: its region and profile on one face of the domain."""

    def __init__(self, opening: Region, grid: Grid, air: np.ndarray):
        self.opening = opening
        self.axis, self.side = opening.axis, opening.side
        self.grid = grid
        self.along = opening.along(grid.dim)
        behind = np.take(air, -self.side, axis=self.axis)
        center, half = opening.rectangle(grid.extent)
        self.center, self.half = np.array(center), np.array(half)
        self.disc = opening.is_disc(grid.dim)
        self.area = opening.area(grid.extent, grid.depth)
        self.face_area = grid.cell_volume / grid.dx
        self.covered = self._inside(self._places((0.0,) * len(self.along), 1)) & behind
        self.profile = np.zeros(behind.shape)  # speed over mean speed
        self.swirl: dict[int, np.ndarray] = {}
        if blows(opening):
            profile = self._average(self._profile) * behind
            profile[profile < 1e-3] = 0.0
            if not profile.any():
                raise ValueError("no air behind the opening: an obstacle covers it")
            self.profile = profile * (self.area / (profile.sum() * self.face_area))
            self.covered = self.profile > 0
            self.swirl = self._swirl()

    def _places(self, shift: tuple[float, ...], samples: int) -> list[np.ndarray]:
        """Places on the face relative to the opening's centre, over its half size: [-1, 1] is inside.

        Each boundary face has `samples` per axis; shift: of all places, in cells.
        """
        axes = []
        for k, a in enumerate(self.along):
            cells = np.arange(self.grid.shape[a])[:, None] + (np.arange(samples) + 0.5) / samples + shift[k]
            axes.append((cells.ravel() * self.grid.dx - self.center[k]) / self.half[k])
        return list(np.meshgrid(*axes, indexing="ij"))

    def _average(self, function, shift: tuple[float, ...] = (0.0, 0.0)) -> np.ndarray:
        """Mean of a function of the relative place over each boundary face."""
        return block_mean(function(self._places(shift, SAMPLES)), SAMPLES)

    def _radius(self, places: list[np.ndarray]) -> np.ndarray:
        """Distance from the centre over the half size: round for a disc, square for a rectangle."""
        if self.disc:
            return np.sqrt(sum(p**2 for p in places))
        return np.max([np.abs(p) for p in places], axis=0)

    def _inside(self, places: list[np.ndarray]) -> np.ndarray:
        return self._radius(places) <= 1.0

    def _profile(self, places: list[np.ndarray]) -> np.ndarray:
        """Speed over mean speed, before the scaling to the exact flow rate."""
        inside = self._inside(places)
        if isinstance(self.opening, Fan):
            return 0.5 * (1.0 - np.tanh((self._radius(places) - 1.0) / 0.05))
        if isinstance(self.opening, Inlet) and self.opening.profile == "parabolic":
            if self.disc:
                return inside * (1.0 - self._radius(places) ** 2)
            return inside * np.prod([1.0 - p**2 for p in places], axis=0)
        return inside

    def _swirl(self) -> dict[int, np.ndarray]:
        """A fan's velocity along the face over its mean speed, per axis."""
        if not isinstance(self.opening, Fan) or self.opening.swirl == 0 or len(self.along) < 2:
            return {}
        sign = 1.0 if self.side == 0 else -1.0  # right-handed about the direction of the jet
        swirl = self.opening.swirl * sign
        first, second = self.along if self.axis != 1 else reversed(self.along)
        result = {}
        for axis, other, turn in ((first, second, -swirl), (second, first, swirl)):
            shift = tuple(-0.5 if a == axis else 0.0 for a in self.along)
            arm = self.along.index(other)
            result[axis] = self._average(lambda p, arm=arm, turn=turn: turn * p[arm] * self._inside(p), shift)
        return result

    @property
    def peak(self) -> float:
        """Largest velocity component over the mean speed."""
        swirl = max((float(np.abs(v).max()) for v in self.swirl.values()), default=0.0)
        gusts = 3.0 * self.opening.turbulence_intensity if isinstance(self.opening, Jet) else 0.0
        return float(self.profile.max()) + swirl + gusts

    def cells(self) -> tuple[np.ndarray, ...]:
        """Index of the cells behind the covered faces."""
        index = list(np.nonzero(self.covered))
        index.insert(self.axis, np.full(len(index[0]), self.side * (self.grid.shape[self.axis] - 1)))
        return tuple(index)


def opening_cells(openings: tuple[Opening, ...], grid: Grid) -> np.ndarray:
    """Which cells lie behind an opening that lets air through, bool of grid.shape."""
    result = np.zeros(grid.shape, bool)
    for opening in openings:
        if isinstance(opening, Jet | Outlet):
            result[Patch(opening, grid, np.ones(grid.shape, bool)).cells()] = True
    return result


class Fluctuations:
    """Turbulent velocity of a jet: filtered noise with a length and a time scale (digital filter).

    Gaussian correlation in space (Klein et al. 2003, doi:10.1016/S0021-9991(03)00090-1), exponential in time
    (Xie & Castro 2008, doi:10.1007/s10494-008-9151-5); no net flux.
    """

    def __init__(self, patch: Patch, length: float, seed: int, name: str):
        self.patch = patch
        self.length = length
        self.rng = generator(seed, name)
        self.sigma = length / patch.grid.dx / np.sqrt(pi)
        impulse = np.zeros(patch.profile.shape)
        impulse[(0,) * impulse.ndim] = 1.0
        self.norm = np.sqrt((gaussian_filter(impulse, self.sigma, mode="wrap") ** 2).sum())
        self.state = np.array([self._slice() for _ in range(patch.grid.dim)])

    def _slice(self) -> np.ndarray:
        """A plane of unit-variance noise, correlated over the length."""
        noise = self.rng.standard_normal(self.patch.profile.shape)
        return gaussian_filter(noise, self.sigma, mode="wrap") / self.norm

    def advance(self, speed: float, dt: float) -> np.ndarray:
        """The next planes, one per velocity component, of unit variance; the one through the face has no mean."""
        decay = np.exp(-pi * dt * abs(speed) / (2.0 * self.length))
        fresh = np.array([self._slice() for _ in self.state])
        self.state = self.state * decay + fresh * np.sqrt(1.0 - decay**2)
        planes = self.state * self.patch.covered
        axis = self.patch.axis
        planes[axis] -= self.patch.covered * planes[axis].sum() / self.patch.covered.sum()
        return planes


@ti.data_oriented
class Boundaries:
    """Targets, mirror factors and ambient pressure of all boundary faces, and the kernels that fill ghost layers."""

    def __init__(self, openings: tuple[Opening, ...], grid: Grid, solid: np.ndarray, seed: int):
        self.grid = grid
        self.dim = grid.dim
        self.openings = openings
        self.patches = [Patch(o, grid, ~solid) for o in openings if not isinstance(o, Periodic)]
        self.jets = [p for p in self.patches if blows(p.opening)]
        self.curved = {
            n: CurvedFan(
                p.opening.curve,
                p.opening.speed_at(0.0),
                p.area,
                AIR_DENSITY,
                np.stack(p.cells(), axis=-1) + grid.ghost,
                p.profile[p.covered],
            )
            for n, p in enumerate(self.jets)
            if isinstance(p.opening, Fan) and p.opening.curve
        }
        self.noise = {
            n: Fluctuations(p, p.opening.turbulence_length or 0.4 * float(p.half.min()), seed, f"inflow {n}")
            for n, p in enumerate(self.jets)
            if p.opening.turbulence_intensity > 0
        }
        shapes = [tuple(2 if a == d else n for a, n in enumerate(grid.padded)) for d in range(grid.dim)]
        inner = [tuple(2 if a == d else n for a, n in enumerate(grid.shape)) for d in range(grid.dim)]
        self.sides = shapes
        self.target = [ti.Vector.field(grid.dim, ti.f32, shape) for shape in shapes]
        self.mirror = [ti.Vector.field(grid.dim, ti.f32, shape) for shape in shapes]
        self.free = [ti.field(ti.i32, shape) for shape in shapes]
        self.loss = [ti.field(ti.f32, shape) for shape in shapes]
        self.ambient = [ti.field(ti.f32, shape) for shape in shapes]  # kinematic pressure at the face [m²/s²]
        self._targets = [np.zeros((*shape, grid.dim), np.float32) for shape in inner]
        self._walls()
        self.has_loss = any(field.to_numpy().any() for field in self.loss)
        self._blown = None
        self.update(-np.inf, 0.0)

    @staticmethod
    def _face(array: np.ndarray, patch: Patch) -> np.ndarray:
        """The view of a boundary array on a patch's face."""
        return np.moveaxis(array, patch.axis, 0)[patch.side]

    def _upload(self, field, array: np.ndarray, d: int) -> None:
        """Copy a boundary array of axis d to its field, spread over the ghost layers of the other axes."""
        for a in range(self.dim):
            if a != d:
                width = [(self.grid.ghost,) * 2 if axis == a else (0, 0) for axis in range(array.ndim)]
                array = np.pad(array, width, mode="wrap" if self.grid.periodic[a] else "edge")
        field.from_numpy(array)

    def _walls(self) -> None:
        """Everything about the openings that does not change in time."""
        mirror = [np.full_like(t, -1.0) for t in self._targets]
        free = [np.zeros(t.shape[:-1], np.int32) for t in self._targets]
        loss = [np.zeros(t.shape[:-1], np.float32) for t in self._targets]
        for p in self.patches:
            o, where = p.opening, p.covered
            if blows(o):
                self._face(mirror[p.axis], p)[where] = 0.0
            elif isinstance(o, Slip):
                self._face(mirror[p.axis], p)[where] = 1.0
            elif isinstance(o, MovingWall):
                self._face(self._targets[p.axis], p)[where] = o.velocity
            elif isinstance(o, Outlet | Honeycomb):
                self._face(free[p.axis], p)[where] = 1
                straight = isinstance(o, Honeycomb)
                self._face(mirror[p.axis], p)[where] = 0.0 if straight else 1.0
                self._face(loss[p.axis], p)[where] = o.loss_coefficient if isinstance(o, Honeycomb) else 0.0
        for d in range(self.dim):
            self._upload(self.mirror[d], mirror[d], d)
            self._upload(self.free[d], free[d], d)
            self._upload(self.loss[d], loss[d], d)
            self._upload(self.target[d], self._targets[d], d)

    def speeds(self, t: float) -> list[float]:
        """Mean speed [m/s] of each jet at time t; fans with a curve have theirs."""
        return [
            self.curved[n].speed if n in self.curved else p.opening.speed_at(t)
            for n, p in enumerate(self.jets)
        ]

    def update(self, t: float, dt: float) -> None:
        """Blow with the speeds of time t; the fluctuations move on by dt."""
        self._blow(self.speeds(t), dt)

    def measure_inertia(self, pressure_of: Callable[[], Any]) -> None:
        """Let each fan with a curve know what the air in front of it weighs.

        pressure_of: gives the field phi that makes the flow divergence-free; the pressure is dx/dt phi.
        """
        for n, fan in self.curved.items():
            self._blow([float(m == n) for m in range(len(self.jets))], 0.0)
            fan.inertia = max(0.0, self.grid.dx * fan.mean(pressure_of()))
        if self.curved:
            self.update(-np.inf, 0.0)

    def _blow(self, speeds: list[float], dt: float) -> None:
        if speeds == self._blown and not self.noise:
            return
        self._blown = speeds
        for n, (p, speed) in enumerate(zip(self.jets, speeds, strict=True)):
            inward = 1.0 if p.side == 0 else -1.0
            face = self._face(self._targets[p.axis], p)
            face[p.covered] = 0.0
            face[..., p.axis] += inward * speed * p.profile
            for axis, swirl in p.swirl.items():
                face[..., axis] += speed * swirl * p.covered
            if n in self.noise and speed != 0:
                amplitude = p.opening.turbulence_intensity * abs(speed)
                for axis, plane in enumerate(self.noise[n].advance(speed, dt)):
                    face[..., axis] += amplitude * plane
        for d in {p.axis for p in self.jets}:
            self._upload(self.target[d], self._targets[d], d)

    def fastest(self, t: float) -> float:
        """Largest velocity component [m/s] that a schedule prescribes from t to HORIZON later."""
        result = 0.0
        for fan, p in ((fan, self.jets[n]) for n, fan in self.curved.items()):
            result = max(
                result, p.peak * max(fan.speed, min(fan.free_speed, fan.speed + 0.2 * fan.acceleration))
            )
        for p in self.jets:
            times = [t, t + HORIZON, *(time for time in p.opening.knots if t < time < t + HORIZON)]
            if p.opening.schedule:
                result = max(result, p.peak * max(abs(p.opening.speed_at(time)) for time in times))
        return result

    def trapped(self, regions: np.ndarray) -> list[int]:
        """Numbers of the jets whose air cannot leave: the region that they blow into has no outlet and no balance.

        regions: of grid.shape, equal numbers where air is connected.
        """
        result = []
        exits = {r for p in self.patches if isinstance(p.opening, Jet | Outlet) and p not in self.jets
                 for r in np.unique(regions[p.cells()])}  # fmt: skip
        for region in {r for p in self.jets for r in np.unique(regions[p.cells()])} - exits:
            here = [p for p in self.jets if region in regions[p.cells()]]
            shares = [p.profile[p.covered][regions[p.cells()] == region].sum() * p.face_area for p in here]
            knots = sorted({0.0, *(time for p in here for time in p.opening.knots)})
            times = [*knots, *((a + b) / 2 for a, b in pairwise(knots))]
            flows = np.array(
                [[s * p.opening.speed_at(t) for s, p in zip(shares, here, strict=True)] for t in times]
            )
            curved = any(self.jets.index(p) in self.curved for p in here)  # no speed of another's balances it
            if curved or np.any(np.abs(flows.sum(axis=1)) > 1e-6 * np.abs(flows).sum(axis=1)):
                result += [self.openings.index(p.opening) for p in here]
        return sorted(set(result))

    @ti.func
    def fill_velocity(self, u: Template):
        """Prescribed faces and all ghost values of the face velocities u."""
        for d in ti.static(range(self.dim)):
            for K in ti.grouped(ti.ndrange(*self.sides[d])):
                self._fill_velocity_at(u, K, d)

    @ti.func
    def _fill_velocity_at(self, u: Template, K, d: Template):
        n = ti.static(self.grid.shape[d])
        g = ti.static(self.grid.ghost)
        D = ti.Vector.unit(self.dim, d, ti.i32)
        side = K[d]
        inner = K + D * (g + side * (n - 1) - side)  # K[d] is replaced by the first cell inside
        face = K + D * (g + side * n - side)
        outward = 2 * side - 1
        if ti.static(self.grid.periodic[d]):
            other = inner + D * (n - 1) * (1 - 2 * side)
            for c in ti.static(range(self.dim)):
                if ti.static(c != d):
                    for m in ti.static(range(g)):
                        u[c][inner + D * outward * (m + 1)] = u[c][other + D * outward * m]
            if side == 1:  # the lower face is the one that is solved
                for m in ti.static(range(g)):
                    u[d][face + D * m] = u[d][face + D * (m - n)]
            else:
                for m in ti.static(range(1, g + 1)):
                    u[d][face - D * m] = u[d][face + D * (n - m)]
        else:
            V = self.target[d][K]
            for c in ti.static(range(self.dim)):
                if ti.static(c != d):
                    mirror = self.mirror[d][K][c]
                    value = mirror * u[c][inner] + (1.0 - mirror) * V[c]
                    if ti.static(n > 1):  # at a wall the parabola through V and two cells
                        second = u[c][inner - D * outward]
                        parabola = (8.0 * V[c] + second) / 3.0 - 2.0 * u[c][inner]
                        value = ti.select(mirror < 0.0, parabola, value)
                    for m in ti.static(range(1, g + 1)):
                        u[c][inner + D * outward * m] = value
            beyond = V[d]
            if self.free[d][K] == 1:
                normal = u[d][face]
                beyond = ti.select(normal * outward > 0.0, normal, 0.0)  # still air comes in
            else:
                u[d][face] = beyond
            for m in ti.static(range(1, g)):
                u[d][face + D * outward * m] = beyond
            if side == 0:
                u[d][face - D * g] = beyond

    @ti.func
    def fill_pressure(self, p: Template, with_ambient: Template):
        """Ghost values of p that put the ambient pressure (or zero) on free faces."""
        for d in ti.static(range(self.dim)):
            for K in ti.grouped(ti.ndrange(*self.sides[d])):
                n = ti.static(self.grid.shape[d])
                g = ti.static(self.grid.ghost)
                D = ti.Vector.unit(self.dim, d, ti.i32)
                inner = K + D * (g + K[d] * (n - 1) - K[d])
                outer = inner + D * (2 * K[d] - 1)
                if ti.static(self.grid.periodic[d]):
                    p[outer] = p[inner + D * (n - 1) * (1 - 2 * K[d])]
                else:
                    p[outer] = 2.0 * self.ambient[d][K] * with_ambient - p[inner]

    @ti.func
    def update_losses(self, u: Template, dt: float):
        """Pressure on free faces from K/2 u|u|, relaxed at the rate that is stable for any K."""
        for d in ti.static(range(self.dim)):
            for K in ti.grouped(ti.ndrange(*self.sides[d])):
                if self.free[d][K] == 1:
                    n = ti.static(self.grid.shape[d])
                    g = ti.static(self.grid.ghost)
                    D = ti.Vector.unit(self.dim, d, ti.i32)
                    out = u[d][K + D * (g + K[d] * n - K[d])] * (2 * K[d] - 1)
                    k = self.loss[d][K]
                    wanted = 0.5 * k * out * ti.abs(out)
                    relax = 1.0 / (1.0 + 2.0 * k * ti.abs(out) * dt / ti.static(self.grid.dx))
                    self.ambient[d][K] += relax * (wanted - self.ambient[d][K])
