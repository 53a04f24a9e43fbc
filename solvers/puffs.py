"""Lagrangian Gaussian puffs carried by a wind: improved stochastic filament model (Farrell et al. 2002,
doi:10.1023/A:1016283702837).

    dx = (u + u' + grad K + w) dt,  K = nu_t/Sc_t
    du' = -u'/T dt + s sqrt(2/T) dW
    R² = R0² + growth + 2 D t (see `puff_growth`)

u' is the velocity of the eddies that the wind does not resolve. u' and its integral are advanced jointly and exactly
(Gillespie 1996, doi:10.1103/PhysRevE.54.2084), the displacement by the wind by Heun's method: in a uniform wind the
spread does not depend on the step. The wind is divergence-free between the faces of the grid as well. Otherwise puffs
gather where the interpolated wind converges. The eddy viscosity makes puffs grow and drift up its gradient, so that
puffs and gas on the grid have the same mean.

A puff is a Gaussian cut off at a few standard deviations that holds all its mass within. Walls and obstacles mirror
centres. Closed faces of the domain, and the tangent plane of a surface near a puff, mirror the concentration as well:
gas is not lost and does not leak through thin walls. Near edges of obstacles a puff does not reach behind the plane,
and of two surfaces only the nearer counts.

Puffs that are wider than the cells of the grid may become gas on the grid (see `handover`); both count as one gas.
"""

from math import isfinite

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Gas, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.level_set import LevelSet
from taichi_plume.grid.rng import generator, normal4, stream_id
from taichi_plume.scenario.gases import PuffGas
from taichi_plume.solvers.emission import Portions
from taichi_plume.solvers.handover import Handover
from taichi_plume.solvers.puff_deposit import Deposit
from taichi_plume.solvers.puff_growth import Growth
from taichi_plume.solvers.puff_list import PuffList
from taichi_plume.solvers.puff_walls import PuffWalls
from taichi_plume.solvers.uniform_wind import UniformSolver

FLUCTUATION = 0.05  # m/s, default of s in a wind without eddies
GRAVITY = 9.81  # m/s²
FULL = 0.95  # fraction of the capacity above which puffs are merged
DRAG = 1.0  # drag coefficient of a sinking puff
TRIES = 1000  # rounds of random positions in a source's ball until enough lie in the air


def joint_update(dt: np.ndarray, time: float, deviation: float) -> np.ndarray:
    """Return coefficients (n, 6) that advance an Ornstein-Uhlenbeck process u' and its integral X by steps dt [s].

    u' <- a u' + b g,  X = c u' + d g + e h with normal random numbers g and h; the last column is dt.
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


class PuffSolver(Gas):
    """Gas as Lagrangian puffs in any wind. A wind with an eddy viscosity also provides nu, viscosity and schmidt."""

    STATE = ("puffs", "portions", "handover", "emitted_kg", "_step", "_released")
    details = 2

    def __init__(
        self,
        gas: PuffGas,
        grid: Grid,
        wind: Wind,
        air: Air,
        t: float = 0.0,
        seed: int = 0,
        name: str = "gas",
    ):
        """t: start of the run [s]; name: name of the gas. Raises ValueError for a source without air."""
        self.grid, self.dim, self.wind = grid, grid.dim, wind
        self.alone = isinstance(wind, UniformSolver)
        self.fluctuates = self.alone or gas.fluctuation is not None
        self.sinks = gas.buoyancy
        self.growth = Growth(gas, grid, wind, self.alone)
        self.surfaces = None if air.empty else LevelSet(air, grid)
        self.walls = PuffWalls(grid, wind, self.surfaces)
        self.seed, self.species = seed, gas.vapour
        default = FLUCTUATION if self.alone else 0.0
        self.deviation = default if gas.fluctuation is None else gas.fluctuation
        self.time = gas.fluctuation_time
        self.most, self.initial_size = gas.most, gas.initial_size
        self.puffs = PuffList(gas.most, gas.cutoff, grid, self.surfaces, gas.initial_size)
        self.stream = stream_id(f"{name} fluctuations")
        self._air, self._deposit = air, None  # fields that most runs do not use
        self.portions = [
            Portions(f"{name}.sources[{n}]", source, gas, wind, t, seed)
            for n, source in enumerate(gas.sources)
        ]
        for n, portions in enumerate(self.portions):
            if portions.source.motion is not None and self.surfaces is not None:
                portions.source.require_air(f"sources[{n}]", 0.25 * grid.dx, self.surfaces.in_air)
            if not len(self._places(portions, np.array([t]))):
                raise ValueError(
                    f"sources[{n}].position: is not in the air: an obstacle fills its cell or seals it off; "
                    "move it by a cell or lower domain.spacing"
                )
        hands_over = gas.handover if gas.handover is not None else self.growth.eddying and not gas.buoyancy
        self.hands_over = hands_over and wind.carrier is not None
        self.handover = None
        if (
            self.hands_over and wind.carrier is not None
        ):  # on the grid, u' contributes its long-time diffusivity
            strayed = self.deviation**2 * self.time
            diffusivity = self.species.diffusivity + strayed + self.growth.diffusive
            self.handover = Handover(self, wind.carrier, air, gas.convection, diffusivity)
        self.emitted_kg = 0.0
        self._step = self._released = 0

    def start_from(self, x: np.ndarray, mass: float) -> None:
        """Add puffs at positions x (n, dim) [m] in the air, each with the mass `mass` [kg], which counts as emitted."""
        n = len(x)
        velocity = self.deviation * generator(self.seed, "first puffs").standard_normal((n, self.dim))
        rows = np.column_stack([x, velocity, np.full(n, self.initial_size**2), np.full(n, mass)])
        self.emitted_kg += n * mass
        self._put(rows.astype(np.float32), np.zeros(n), 0.0, 0.0)

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        if self.puffs.count > FULL * self.most:
            self.puffs.merge()
        if self.handover is not None:
            self.handover.advance(t, dt)  # puffs that were handed over stay in the list until they move
        first, born = self._new_puffs(t, dt)
        self._put(first, t + dt - born, t + dt, dt)

    def _put(self, rows: np.ndarray, ages: np.ndarray, t: float, dt: float) -> None:
        """Add new puffs with these ages [s], and move all puffs to time t: old puffs by dt, new puffs by their ages."""
        count = self.puffs.count
        steps = joint_update(np.concatenate([[dt], ages]), self.time, self.deviation)
        self._move(count, self._released, t, self.seed, self._step, rows, steps.astype(np.float32))
        self._released += len(rows)
        self.puffs.sort(count + len(rows))
        self._step += 1

    def _new_puffs(self, t: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the new puffs' columns (position, u', variance, mass), one row each, and their release times [s]."""
        rows, moments = [np.empty((0, 2 * self.dim + 2))], [np.empty(0)]
        free = self.most - self.puffs.count
        for portions in self.portions:
            when, masses, emitted = portions.puffs(t, dt)
            self.emitted_kg += emitted
            if len(when) > free:  # the mass of puffs without a position goes into the next puff
                portions.pending += masses[free:].sum()
                when, masses = when[:free], masses[:free]
            n = len(when)
            free -= n
            velocity = self.deviation * portions.rng.standard_normal((n, self.dim))
            variance = np.full(n, self.initial_size**2)
            rows.append(np.column_stack([self._places(portions, when), velocity, variance, masses]))
            moments.append(when)
        return np.concatenate(rows).astype(np.float32), np.concatenate(moments)

    def _places(self, portions: Portions, when: np.ndarray) -> np.ndarray:
        """Return a random position in the air within a source's ball at each of the times `when` (n,) [s], (n, dim)
        [m]; fewer if there is hardly any air.
        """
        n, source = len(when), portions.source
        if source.motion is not None:
            return self._places_on_way(portions, source.places(when))
        places = np.empty((0, self.dim))
        for _ in range(TRIES):
            if len(places) >= n:
                break
            x = portions.places(2 * n, self.dim, np.array(source.position))
            places = np.concatenate([places, x[self._in_air(x)]])
        return places[:n]

    def _places_on_way(self, portions: Portions, middle: np.ndarray) -> np.ndarray:
        """Return a random position in the air around each of the positions `middle` of a moving source, (n, dim) [m].

        Where there is hardly any air the position is the middle, which lies in the air.
        """
        places, left = middle.copy(), np.arange(len(middle))
        for _ in range(TRIES):
            if not len(left):
                break
            x = portions.places(len(left), self.dim, middle[left])
            here = self._in_air(x)
            places[left[here]], left = x[here], left[~here]
        return places

    def _in_air(self, x: np.ndarray) -> np.ndarray:
        """Return a mask of the points x (n, dim) [m] that lie in the domain and outside of obstacles."""
        inside = np.all((x >= 0.0) & (x <= self.grid.extent), axis=1)
        if self.surfaces is not None:
            inside[inside] = self.surfaces.in_air(x[inside])
        return inside

    @ti.kernel
    def _move(
        self,
        count: ti.i32,
        released: ti.i32,
        t: float,
        seed: ti.u32,
        step: ti.i32,
        rows: ti.types.ndarray(),
        steps: ti.types.ndarray(),
    ):
        for n in range(rows.shape[0]):
            for column in ti.static(range(len(self.puffs.now))):
                self.puffs.now[column][count + n] = rows[n, column]
            self.puffs.number[count + n] = released + n
        for k in range(count + rows.shape[0]):
            row = ti.max(k - count + 1, 0)
            a, b, c = steps[row, 0], steps[row, 1], steps[row, 2]
            d, e, dt = steps[row, 3], steps[row, 4], steps[row, 5]
            x = self.puffs.place(k)
            v, way = ti.Vector.zero(ti.f32, self.dim), ti.Vector.zero(ti.f32, self.dim)
            number = self.puffs.number[k]
            if ti.static(self.fluctuates):
                g = normal4(seed, ti.u32(self.stream), number, step, 0)
                h = ti.Vector([g[2], g[3], 0.0])
                if ti.static(self.dim == 3):
                    more = normal4(seed, ti.u32(self.stream), number, step, 1)
                    h = ti.Vector([g[3], more[0], more[1]])
                for i in ti.static(range(self.dim)):
                    before = self.puffs.now[self.dim + i][k]
                    v[i] = a * before + b * g[i]
                    way[i] = c * before + d * g[i] + e * h[i]
            variance, mass = self.puffs.now[self.puffs.variance][k], self.puffs.now[self.puffs.mass][k]
            K, uphill = self.growth.eddy_diffusivity(x)
            way += dt * uphill
            if ti.static(self.sinks):
                way[self.dim - 1] -= dt * self._fall(x, variance, t)
            drift, place = ti.Vector.zero(ti.f32, self.dim), x
            for _ in range(2):  # Heun's method; a loop, as Taichi compiles every copy of the wind slowly
                u = self.wind.solenoidal_velocity(place, t)
                drift += 0.5 * dt * u
                place = self.walls.inside(x + way + dt * u)
            way += drift
            end, speed, stays = self.walls.travel(x, way, v, t)
            variance = self.growth.grown(variance, x, K, dt)
            if ti.static(self.hands_over):
                stays = stays and mass > 0.0  # the puff was handed over
            self.puffs.put(k, end, speed, variance, mass, number, stays)

    @ti.func
    def _fall(self, x: Template, variance: float, t: float):
        """Return the settling speed [m/s] of a puff at x: buoyancy of a ball of radius R = 2 s against its drag.

        g' 4/3 pi R³ = 1/2 C_d pi R² w², with the density excess of all gas at the ball's centre (our choice).
        """
        excess = self.species.weight_per_density * self.concentration(x, t)
        square = ti.static(8.0 / 3.0 * GRAVITY / DRAG) * excess * 2.0 * self.puffs.cells.size(variance)
        return ti.select(square < 0.0, -1.0, 1.0) * ti.sqrt(ti.abs(square))

    # ---------------------------------------------------------------- budget and sampling

    def cells(self, t: float) -> np.ndarray:
        if self._deposit is None:
            self._deposit = Deposit(self, self._air)
        held = self._deposit.cells(t)
        return held if self.handover is None else held + self.handover.cells()

    def budget(self) -> dict[str, float]:
        """Return the gas emitted, in the domain and lost through the domain's faces [kg], by name."""
        inside = self.puffs.rows()[:, self.puffs.mass].astype(float).sum()
        waiting, gone = sum(portions.pending for portions in self.portions), self.puffs.gone
        if self.handover is not None:
            inside, gone = inside + self.handover.transport.inside(), gone + self.handover.transport.outflow()
        return {
            "emitted_kg": self.emitted_kg,
            "in_domain_kg": float(inside + waiting),
            "outflow_kg": gone,
        }

    def is_finite(self) -> bool:
        held = 0.0 if self.handover is None else self.handover.transport.inside()
        return isfinite(float(np.abs(self.puffs.rows()).sum(dtype=float)) + held)

    @ti.func
    def concentration(self, x: Template, t: float):
        """Return the concentration [kg/m³] at point x [m]: sum over the puffs near x and near its mirror images."""
        below, above = self.walls.closed(x, self.puffs.cells.farthest[None], t)
        total = 0.0
        for which in range(self.puffs.cells.lists):
            if not self.puffs.cells.empty(which):
                first, size, images = self.walls.images(x, self.puffs.cells.reach(which), below, above)
                for n in range(images):
                    total += self.puffs.near(self.walls.image(x, first, size, n), which)
        if ti.static(self.hands_over):
            total += self.handover.concentration(x)
        return total
