"""Turbulent puffs that a wind carries (Farrell et al. 2002, doi:10.1023/A:1016283702837), improved.

    dx = (u + u' + grad K + w) dt,  K = nu_t/Sc_t
    du' = -u'/T dt + s sqrt(2/T) dW
    R² = R0² + growth + 2 D t + 2 int K dt

u' stands for the eddies that the wind leaves out. It and its integral are advanced jointly and exactly (Gillespie 1996,
doi:10.1103/PhysRevE.54.2084), the wind by Heun's method: in a uniform wind the spread does not depend on the step. The
eddy viscosity makes puffs grow, and drift up its gradient, as it spreads the gas on the grid: both have the same mean.

A puff is a Gaussian that ends at a few standard deviations and holds all its mass within. Centres are mirrored by walls
and obstacles. A closed face of the domain mirrors the concentration, too, and a surface near a puff does so as its
tangent plane: gas is neither lost nor does it leak through thin walls. Near edges of obstacles a puff does not reach
behind the plane, and of two surfaces it knows the nearer one only.
"""

from math import ceil, isfinite
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Wind, corner, corner_weight
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.level_set import LevelSet
from taichi_plume.grid.rng import generator, normal4, stream_id
from taichi_plume.scenario.gases import InertialGrowth, PuffGas
from taichi_plume.scenario.sources import Source
from taichi_plume.solvers.emission import Emission
from taichi_plume.solvers.puff_deposit import Deposit
from taichi_plume.solvers.puff_list import PuffList
from taichi_plume.solvers.uniform import UniformSolver

FLUCTUATION, GROWTH = 0.05, 1e-4  # m/s and m²/s in a wind without eddies
RICHARDSON = 0.5  # constant of the distance of two particles
STILL = 1e-4  # m/s: slower air does not go through a face
GRAVITY = 9.81  # m/s²
FULL = 0.95  # of the places: from then on puffs are merged
DRAG = 1.0  # coefficient of a sinking puff
TRIES = 1000  # to find air in a source's ball


def joint_update(dt: np.ndarray, time: float, deviation: float) -> np.ndarray:
    """Coefficients (n, 6) of u' and its integral X over steps dt [s] of an Ornstein-Uhlenbeck process.

    u' <- a u' + b g,  X = c u' + d g + e h with two normal numbers g and h; the last column is dt.
    """
    share = dt / time
    a, less = np.exp(-share), -np.expm1(-share)
    b = deviation * np.sqrt(-np.expm1(-2.0 * share))
    together = deviation**2 * time * less**2
    exact = 2.0 * share - 2.0 * less - less**2
    variance = (deviation * time) ** 2 * np.where(share > 1e-3, exact, 2.0 / 3.0 * share**3 - 0.5 * share**4)
    d = together / np.maximum(b, 1e-30)
    e = np.sqrt(np.maximum(variance - d**2, 0.0))
    return np.stack([a, b, time * less, d, e, dt], axis=-1)


class Portions:
    """When a source lets go of a puff, and what is in it: what it has emitted since the one before."""

    def __init__(self, source: Source, gas: PuffGas, wind: Wind, begin: float, seed: int, name: str):
        self.source = source
        self.rate, self.poisson = gas.release_rate, gas.poisson
        self.emission = Emission(source, begin, seed, name, gas.vapour, wind)
        self.rng = generator(seed, f"{name} puffs")
        self.pending = 0.0  # kg, emitted but not yet in a puff
        self._next = begin + self._intervals(1)[0]

    def _intervals(self, n: int) -> np.ndarray:
        return self.rng.exponential(1.0 / self.rate, n) if self.poisson else np.full(n, 1.0 / self.rate)

    def _moments(self, end: float) -> np.ndarray:
        """When puffs are let go up to `end` [s]."""
        moments = [np.empty(0)]
        while self._next <= end:
            intervals = self._intervals(ceil((end - self._next) * self.rate) + 1)
            ahead = self._next + np.cumsum(np.concatenate([[0.0], intervals]))
            due = int(np.searchsorted(ahead, end, side="right"))
            moments.append(ahead[:due])
            self._next = ahead[min(due, len(intervals))]
            if due > len(intervals):
                moments[-1] = moments[-1][:-1]  # it is the first of the next lot
        return np.concatenate(moments)

    def puffs(self, t: float, dt: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Moments [s] and masses [kg] of the puffs between t and t + dt, and all that is emitted meanwhile [kg]."""
        moments = self._moments(t + dt)
        emitted = self.emission.masses(np.concatenate([[t], moments, [t + dt]]))
        masses = emitted[:-1].copy()
        if len(masses):
            masses[0] += self.pending
            self.pending = 0.0
        self.pending += emitted[-1]
        return moments[masses > 0.0], masses[masses > 0.0], float(emitted.sum())

    def places(self, n: int, dim: int) -> np.ndarray:
        """Random places in the ball [m], (n, dim)."""
        direction = self.rng.standard_normal((n, dim))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        radius = self.source.radius * self.rng.random((n, 1)) ** (1 / dim)
        return np.array(self.source.position) + radius * direction


@ti.data_oriented
class PuffSolver:
    """Gas as puffs in any wind; satisfies `fields.Gas`.

    Of a wind that has an eddy viscosity it takes nu, viscosity and schmidt as well, as on the grid.
    """

    def __init__(
        self,
        gas: PuffGas,
        grid: Grid,
        wind: Wind,
        air: Air,
        begin: float = 0.0,
        seed: int = 0,
        name: str = "gas",
    ):
        """name: of the gas among others; begin: start of the run [s]. Raises ValueError for a source in no air."""
        self.grid, self.dim, self.wind = grid, grid.dim, wind
        self.species = gas.vapour
        alone = isinstance(wind, UniformSolver)
        self.deviation = (FLUCTUATION if alone else 0.0) if gas.fluctuation is None else gas.fluctuation
        self.time = gas.fluctuation_time
        self.fluctuates = self.deviation > 0.0
        self.inertial = isinstance(gas.growth, InertialGrowth)
        self.growth = GROWTH if alone else 0.0
        if isinstance(gas.growth, InertialGrowth):
            self.growth = (RICHARDSON * gas.growth.dissipation / 6.0) ** (1 / 3)
        elif gas.growth is not None:
            self.growth = gas.growth.rate
        self.sinks = gas.buoyancy
        self.eddies: Any = getattr(wind, "nu", None)
        self.eddying = self.eddies is not None
        self.surfaces = None if air.empty else LevelSet(air, grid)
        self.walled = self.surfaces is not None
        self.initial_size, self.most = gas.initial_size, gas.most
        self.puffs = PuffList(gas.most, gas.initial_size, gas.cutoff, grid, self.surfaces)
        self.seed, self.stream = seed, stream_id(f"{name} fluctuations")
        self.portions = [
            Portions(s, gas, wind, begin, seed, f"{name}.sources[{n}]") for n, s in enumerate(gas.sources)
        ]
        for n, portions in enumerate(self.portions):
            if not len(self._places(portions, 1)):
                raise ValueError(
                    f"sources[{n}].position: is not in the air: an obstacle fills its cell or seals it off; "
                    "move it by a cell or lower domain.spacing"
                )
        self._air, self._deposit = air, None  # fields that most runs do not need
        self.emitted_kg = 0.0
        self._step = self._released = self._count = 0

    def start_from(self, x: np.ndarray, mass: float) -> None:
        """Add puffs at places (n, dim) [m] in the air, each of some mass [kg]; it counts as emitted."""
        n = len(x)
        velocity = self.deviation * generator(self.seed, "first puffs").standard_normal((n, self.dim))
        rows = np.column_stack([x, velocity, np.full(n, self.initial_size**2), np.full(n, mass)])
        self.emitted_kg += n * mass
        self._put(rows.astype(np.float32), np.zeros(n), 0.0, 0.0)

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """Move all puffs from t to t + dt, those that are released meanwhile from their own moment on."""
        if self._count > FULL * self.most:
            self.puffs.merge()
            self._count = self.puffs.count
        first, born = self._born(t, dt)
        self._put(first, t + dt - born, t + dt, dt)

    def _put(self, rows: np.ndarray, ages: np.ndarray, t: float, dt: float) -> None:
        """Take in new puffs of some ages [s], and move all to time t: the old by dt, the new by their ages."""
        if len(rows):
            self._put_new(self._count, self._released, rows)
            self._released += len(rows)
        steps = joint_update(np.concatenate([[dt], ages]), self.time, self.deviation)
        self._move(self._count, len(rows), t, self._step, steps.astype(np.float32))
        self.puffs.sort(self._count + len(rows))
        self._step += 1
        self._count = self.puffs.count

    def _born(self, t: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Rows (x, u', variance, mass) of the new puffs, and their moments [s]."""
        rows, moments = [np.empty((0, 2 * self.dim + 2))], [np.empty(0)]
        free = self.most - self._count
        for portions in self.portions:
            when, masses, emitted = portions.puffs(t, dt)
            self.emitted_kg += emitted
            if len(when) > free:  # what finds no place goes into the next puff
                portions.pending += masses[free:].sum()
                when, masses = when[:free], masses[:free]
            n = len(when)
            free -= n
            velocity = self.deviation * portions.rng.standard_normal((n, self.dim))
            variance = np.full(n, self.initial_size**2)
            rows.append(np.column_stack([self._places(portions, n), velocity, variance, masses]))
            moments.append(when)
        return np.concatenate(rows).astype(np.float32), np.concatenate(moments)

    def _places(self, portions: Portions, n: int) -> np.ndarray:
        """Random places [m] in the air of a source's ball, (n, dim); none where there is no air."""
        found = np.empty((0, self.dim))
        for _ in range(TRIES):
            if len(found) >= n:
                break
            x = portions.places(2 * n, self.dim)
            x = x[((x >= 0.0) & (x <= self.grid.extent)).all(axis=1)]
            found = np.concatenate([found, x if self.surfaces is None else x[self.surfaces.in_air(x)]])
        return found[:n]

    @ti.kernel
    def _put_new(self, count: ti.i32, number: ti.i32, rows: ti.types.ndarray()):
        for n in range(rows.shape[0]):
            for column in ti.static(range(len(self.puffs.now))):
                self.puffs.now[column][count + n] = rows[n, column]
            self.puffs.number[count + n] = number + n

    @ti.kernel
    def _move(self, count: ti.i32, fresh: ti.i32, t: float, step: ti.i32, steps: ti.types.ndarray()):
        for k in range(count + fresh):
            row = ti.max(k - count + 1, 0)
            a, b, c = steps[row, 0], steps[row, 1], steps[row, 2]
            d, e, dt = steps[row, 3], steps[row, 4], steps[row, 5]
            x = self.puffs.place(k)
            v, way = ti.Vector.zero(ti.f32, self.dim), ti.Vector.zero(ti.f32, self.dim)
            number = self.puffs.number[k]
            if ti.static(self.fluctuates):
                g = normal4(ti.u32(self.seed), ti.u32(self.stream), number, step, 0)
                h = ti.Vector([g[2], g[3], 0.0])
                if ti.static(self.dim == 3):
                    more = normal4(ti.u32(self.seed), ti.u32(self.stream), number, step, 1)
                    h = ti.Vector([g[3], more[0], more[1]])
                for i in ti.static(range(self.dim)):
                    before = self.puffs.now[self.dim + i][k]
                    v[i] = a * before + b * g[i]
                    way[i] = c * before + d * g[i] + e * h[i]
            variance, mass = self.puffs.now[self.puffs.variance][k], self.puffs.now[self.puffs.mass][k]
            K, uphill = self._eddy_diffusivity(x)
            way += dt * uphill
            if ti.static(self.sinks):
                way[self.dim - 1] -= dt * self._fall(x, variance, t)
            drift, place = ti.Vector.zero(ti.f32, self.dim), x
            for _ in range(2):  # Heun's method; a loop, as Taichi takes its time for every copy of the wind
                u = self.wind.velocity(place, t)
                drift += 0.5 * dt * u
                place = self._inside(x + way + dt * u)
            way += drift
            end, speed, stays = self._travel(x, way, v, t)
            if ti.static(self.inertial):
                variance = (ti.pow(variance, 1.0 / 3.0) + self.growth * dt) ** 3
            else:
                variance += self.growth * dt
            variance += 2.0 * dt * (self.species.diffusivity + K)
            self.puffs.put(k, end, speed, variance, mass, number, stays)

    @ti.func
    def _eddy_diffusivity(self, x: Template):
        """nu_t/Sc_t at x [m²/s] and its gradient [m/s]."""
        K, uphill = 0.0, ti.Vector.zero(ti.f32, self.dim)
        if ti.static(self.eddying):
            shift = ti.Vector([0.5] * self.dim)
            base, weight = corner(x, shift, self.grid.dx, self.grid.ghost, self.grid.padded)
            for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * self.dim)))):
                nu = ti.max(self.eddies[base + offset] - self.wind.viscosity, 0.0)
                K += corner_weight(weight, offset) * nu
                for d in ti.static(range(self.dim)):
                    part = weight
                    part[d] = 1.0 * offset[d]
                    uphill[d] += (2.0 * offset[d] - 1.0) * corner_weight(part, offset) * nu
            K /= self.wind.schmidt
            uphill /= ti.static(self.wind.schmidt * self.grid.dx)
        return K, uphill

    @ti.func
    def _fall(self, x: Template, variance: float, t: float):
        """Speed at which a puff sinks [m/s]: the weight of a ball of radius R = 2 s against its drag.

        g' 4/3 pi R³ = 1/2 C_d pi R² w², with the density excess of all the gas at its centre (our choice).
        """
        excess = self.species.weight_per_density * self.concentration(x, t)
        square = ti.static(8.0 / 3.0 * GRAVITY / DRAG) * excess * 2.0 * self.puffs.size(variance)
        return ti.select(square < 0.0, -1.0, 1.0) * ti.sqrt(ti.abs(square))

    # ---------------------------------------------------------------- walls

    @ti.func
    def _inside(self, x: Template):
        """x, wrapped round periodic axes and moved into the domain along the others."""
        y = x
        for d in ti.static(range(self.dim)):
            L = ti.static(self.grid.extent[d])
            if ti.static(self.grid.periodic[d]):
                y[d] -= L * ti.floor(y[d] / L)
            y[d] = ti.math.clamp(y[d], 0.0, L)
        return y

    @ti.func
    def air_goes_through(self, x: Template, face: ti.i32, t: float):
        """Whether air goes through a face of the domain next to x; face: 2 d at the lower, 2 d + 1 at the upper end."""
        p = self._inside(x)
        for d in ti.static(range(self.dim)):
            p[d] = ti.select(face == 2 * d, 0.0, p[d])
            p[d] = ti.select(face == 2 * d + 1, ti.static(self.grid.extent[d]), p[d])
        u = self.wind.velocity(p, t)
        speed = 0.0
        for d in ti.static(range(self.dim)):
            speed += ti.select(face // 2 == d, ti.abs(u[d]), 0.0)
        return speed > STILL

    @ti.func
    def _travel(self, x: Template, way: Template, v: Template, t: float):
        """Where a way from x ends, the velocity v there, and whether it stays in the domain."""
        end, speed, stays = x + way, v, True
        if ti.static(self.walled):
            end, speed = self.surfaces.bounce(x, way, v)
        face, share = -1, 1.0  # the first that is met, and where on the way
        rest = end - x
        for d in ti.static([a for a in range(self.dim) if not self.grid.periodic[a]]):
            L = ti.static(self.grid.extent[d])
            if end[d] < 0.0 or end[d] > L:
                wall = ti.select(end[d] > L, L, 0.0)
                there = (wall - x[d]) / rest[d]
                if there <= share:
                    face, share = 2 * d + ti.cast(end[d] > L, ti.i32), there
                end[d] = 2.0 * wall - end[d]
                speed[d] = -speed[d]
        place = self._inside(end)
        if face >= 0:
            stays = not self.air_goes_through(x + share * rest, face, t)
            if ti.static(self.walled):
                free = self.surfaces.distance(place) > 0.0  # or thrown back into an obstacle at the wall
                place = ti.select(free, place, x)
        return place, speed, stays

    # ---------------------------------------------------------------- what is known about the gas

    def cells(self, t: float) -> np.ndarray:
        """Mean concentration of every cell [kg/m³] at the present time t [s], of the grid's shape."""
        if self._deposit is None:
            self._deposit = Deposit(self, self._air)
        return self._deposit.cells(t)

    def budget(self) -> dict[str, float]:
        """Mass emitted, in the domain and gone through its faces [kg]."""
        inside = self.puffs.column(self.puffs.mass).astype(float).sum()
        waiting = sum(portions.pending for portions in self.portions)
        return {
            "emitted_kg": self.emitted_kg,
            "in_domain_kg": float(inside + waiting),
            "outflow_kg": self.puffs.gone,
        }

    def is_finite(self) -> bool:
        """Whether every puff has a place and a size."""
        columns = [self.puffs.column(n) for n in range(len(self.puffs.now))]
        return all(isfinite(float(np.abs(column).sum(dtype=float))) for column in columns)

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m]: the puffs about it and about its images.

        Along each axis the images are x mirrored at closed faces, over and over, or shifted by the period.
        """
        below, above = ti.Vector.one(ti.i32, self.dim), ti.Vector.one(ti.i32, self.dim)  # closed faces
        farthest = self.puffs.farthest[None]
        for face in range(ti.static(2 * self.dim)):
            away = 0.0
            for d in ti.static(range(self.dim)):
                L = ti.static(self.grid.extent[d])
                away += ti.select(face == 2 * d, x[d], 0.0) + ti.select(face == 2 * d + 1, L - x[d], 0.0)
            if away < farthest:
                shut = 1 - ti.cast(self.air_goes_through(x, face, t), ti.i32)
                for d in ti.static([a for a in range(self.dim) if not self.grid.periodic[a]]):
                    below[d] = ti.select(face == 2 * d, shut, below[d])
                    above[d] = ti.select(face == 2 * d + 1, shut, above[d])
        total = 0.0
        for which in range(self.puffs.lists):
            if not self.puffs.empty(which):
                reach = self.puffs.reach(which)
                first, size = ti.Vector.zero(ti.i32, self.dim), ti.Vector.zero(ti.i32, self.dim)
                images = 1
                for d in ti.static(range(self.dim)):
                    L = ti.static(self.grid.extent[d])
                    low, high = ti.cast(x[d] < reach, ti.i32), ti.cast(L - x[d] < reach, ti.i32)
                    if ti.static(self.grid.periodic[d]):  # what is beyond the lower face is at the upper one
                        low, high = high, low
                    first[d] = -below[d] * low
                    last = above[d] * high
                    if below[d] * above[d] == 1 and reach > L:
                        last = ti.cast(reach / L, ti.i32) + 1
                        first[d] = -last
                    size[d] = last - first[d] + 1
                    images *= size[d]
                for n in range(images):
                    p, left = x, n
                    for d in ti.static(range(self.dim)):
                        L = ti.static(self.grid.extent[d])
                        m = first[d] + left % size[d]
                        left = left // size[d]
                        p[d] += m * L
                        if ti.static(not self.grid.periodic[d]):
                            p[d] = ti.select(m & 1, m * L + L - x[d], p[d])
                    total += self.puffs.near(p, which)
        return total
