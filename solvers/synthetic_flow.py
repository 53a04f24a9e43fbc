"""Synthetic flow for the weak convection of a closed room: random waves of a vector potential, no equation of motion.

    u = curl(f A),  A = sum of c_n exp(i (k_n x + w_n t)),  w_n = unsteadiness sqrt(k_n³ E(k_n)),  E(k) ~ k^-5/3

(kinematic simulation: Fung et al. 1992, doi:10.1017/S0022112092001423), plus rolls as large as the room whose strength
follows an Ornstein-Uhlenbeck process. The ramp f falls to zero at walls and obstacles, so no air goes through them
(Bridson et al. 2007, doi:10.1145/1276377.1276435). The potential lives on the edges of the cells (in 2-D, as a stream
function, on their corners) and the velocity on their faces: the sum over a cell's faces is zero by construction.

Eddies shorter than the shortest wave, of wavenumber k_c, are modelled by the eddy viscosity of the same spectrum,

    nu = 2/3 C^(-3/2) sqrt(E(k_c)/k_c) f, at least the air's own, C = 1.62:

with this viscosity the dissipation of the waves, int 2 nu k² E dk up to k_c, is epsilon = (E k^(5/3)/C)^(3/2) (Metais &
Lesieur 1992, doi:10.1017/S0022112092000733; C by Sreenivasan 1995, doi:10.1063/1.868656). Gas and puffs are mixed by
the eddy part over the turbulent Schmidt number, as in a computed flow.
"""

from functools import partial

import numpy as np
from scipy.ndimage import distance_transform_edt

from taichi_plume.engine import ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template, launch
from taichi_plume.grid.rng import generator
from taichi_plume.grid.sweeps import sweep
from taichi_plume.scenario.species import AIR_VISCOSITY
from taichi_plume.scenario.winds import SyntheticWind
from taichi_plume.solvers.room_mixing import RoomFlow, air_changes, measured_diffusivity

FRAMES_PER_PERIOD = (
    16  # key frames per period of the fastest wave: interpolation costs it 2 % of its amplitude
)
DRAWS = 16  # samples of the phases, to measure the speed of unit waves
KOLMOGOROV = 1.62  # constant of the energy spectrum

Potential = dict[int, np.ndarray]
"""Vector potential [m²/s] by axis, in 2-D only axis 2. Component m is on the edges along m: n + 1 per other axis."""


def curl(potential: Potential, dx: float) -> list[np.ndarray]:
    """Return the velocity [m/s] through the faces across each axis d: n + 1 faces along d, n along the others."""
    dim = potential[2].ndim
    result = []
    for d in range(dim):
        parts = [((e - d) % 3, np.diff(potential[3 - d - e], axis=e)) for e in range(dim) if e != d]
        result.append(sum(part if order == 1 else -part for order, part in parts) / dx)
    return result


def distances(solid: np.ndarray) -> np.ndarray:
    """Return each cell centre's distance [cells] from the nearest solid or wall, padded by a layer; 0 in solids."""
    return np.maximum(np.asarray(distance_transform_edt(np.pad(~solid, 1))) - 0.5, 0.0)


def on_edges(distance: np.ndarray, axis: int) -> np.ndarray:
    """Return the cells' distances from surfaces interpolated to the edges along `axis`; exactly 0 on surfaces."""
    air = distance > 0.0
    for a in range(distance.ndim):
        n = air.shape[a] - 1
        low, high = (range(n), range(1, n + 1)) if a != axis else (range(1, n), range(1, n))
        air = air.take(low, axis=a) & air.take(high, axis=a)
        distance = 0.5 * (distance.take(low, axis=a) + distance.take(high, axis=a))
    return np.where(air, distance, 0.0)


class Waves:
    """Random waves of a vector potential that fill the box with unit mean square velocity, before any ramp at walls.

    eddies: viscosity [m²/s] of shorter eddies for unit mean square velocity; it scales with the waves' strength.
    """

    def __init__(self, wind: SyntheticWind, grid: Grid, rng: np.random.Generator):
        speed, longest, _ = wind.scales(grid.extent, grid.dx)
        shortest = wind.shortest_on(grid.dx)
        bands = np.geomspace(2 * np.pi / longest, 2 * np.pi / shortest, wind.modes + 1)
        k = np.sqrt(bands[:-1] * bands[1:])
        share = bands[:-1] ** (-2 / 3) - bands[1:] ** (-2 / 3)  # energy integral, int k^-5/3 dk
        spectrum = 0.5 * speed**2 * share / share.sum() / np.diff(bands)
        last = bands[-1] ** (-5 / 3) / (3.0 * share.sum())  # E(k_c) of waves of unit mean square velocity
        self.eddies = 2.0 / 3.0 * KOLMOGOROV**-1.5 * np.sqrt(last / bands[-1])
        self.frequency = wind.unsteadiness * np.sqrt(k**3 * spectrum)
        direction = rng.standard_normal((wind.modes, grid.dim))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        c = rng.standard_normal((wind.modes, 3)) + 1j * rng.standard_normal((wind.modes, 3))
        if grid.dim == 3:  # components along k move no air
            c -= (c * direction).sum(axis=1, keepdims=True) * direction
        else:
            c[:, :2] = 0.0
        c *= (np.sqrt(2.0 * share / share.sum()) / k / np.linalg.norm(c, axis=1))[:, None]
        self.k, self.c = k[:, None] * direction, c
        self.tables = {}
        for m in (0, 1, 2) if grid.dim == 3 else (2,):
            places = edges(grid, m)
            along = [np.exp(1j * np.outer(k * direction[:, a], x)) for a, x in enumerate(places)]
            first = c[:, m, None] * along[0]
            others = along[1]
            for table in along[2:]:
                others = (others[:, :, None] * table[:, None, :]).reshape(wind.modes, -1)
            shape = tuple(len(x) for x in places)
            others = np.concatenate([others.real, -others.imag]).astype(np.float32)
            self.tables[m] = first, others, shape

    def at(self, phase: np.ndarray) -> Potential:
        """Return the potential after each wave has advanced by its phase [rad].

        Waves are products of waves along the axes, so a product of two matrices sums them.
        """
        result = {}
        for m, (first, others, shape) in self.tables.items():
            now = np.exp(1j * phase)[:, None] * first
            now = np.concatenate([now.real, now.imag]).astype(np.float32)
            result[m] = (np.ascontiguousarray(now.T) @ others).astype(float).reshape(shape)
        return result


def edges(grid: Grid, axis: int) -> list[np.ndarray]:
    """Return the positions [m] of the edges along `axis`, as an array per axis of the grid."""
    return [
        (np.arange(n) + 0.5 if a == axis else np.arange(n + 1)) * grid.dx for a, n in enumerate(grid.shape)
    ]


def as_fast(speed: float, square: float) -> float:
    """Return the factor that scales a flow of mean square speed `square` [m²/s²] to `speed` [m/s]; 0 for no flow."""
    return speed / float(np.sqrt(square)) if square > 0.0 else 0.0


@ti.func
def _between(before: Template, after: Template, I, share, _):
    return before[I] + share * (after[I] - before[I])


class SyntheticSolver(Carrier):
    """Synthetic flow in a closed room, a sum of random waves and rolls; obstacles consist of whole cells.

    The flow is interpolated linearly in time between key frames, which conserves div u = 0. Fields per axis: u, face
    velocities [m/s]; open, 1 on faces between two cells of air. Field nu: see above.
    """

    viscosity = AIR_VISCOSITY
    STATE = ("u", "outflow_rate", "_before", "_after", "_outflow", "_frame", "_rng", "_turn")

    def __init__(self, wind: SyntheticWind, grid: Grid, air: Air, t: float = 0.0, seed: int = 0):
        self.grid, self.dim = grid, grid.dim
        self._air, self._distance = ~air.solid, distances(air.solid)
        self.u = grid.faces_field()
        self._before, self._after = grid.faces_field(), grid.faces_field()
        around = np.pad(self._air, grid.ghost)
        self.open = tuple(grid.filled(around & np.roll(around, 1, axis=d)) for d in range(grid.dim))
        self._build_blending()
        self._draw_flow(wind, seed)
        self._begun = t
        self._outflow = [0.0, 0.0]  # of the two frames
        self._frame = -2  # number of the earlier frame
        self._next_frame()
        self._next_frame()
        self.advance(t, 0.0)

    def _draw_flow(self, model: SyntheticWind, seed: int) -> None:
        """Draw the random waves and rolls, and set the eddy viscosity."""
        self._rng = generator(seed, "synthetic wind")
        self._model, self._seed = model, seed
        self._waves = Waves(model, self.grid, self._rng)
        axes = list(self._waves.tables)
        layer = model.wall_layer / self.grid.dx
        self._ramp = {m: np.tanh(on_edges(self._distance, m) / layer) for m in axes}
        phases = self._rng.uniform(0.0, 2 * np.pi, (DRAWS, model.modes))
        squares = [self._mean_square(self._waves.at(phase)) for phase in phases]
        speed, _, circulation = model.scales(self.grid.extent, self.grid.dx)
        self._strength = as_fast(speed, float(np.mean(squares)))
        self.schmidt = model.schmidt
        inner = np.tanh(self._distance / layer)[(slice(1, -1),) * self.dim]
        nu = np.maximum(self._strength * self._waves.eddies * inner, self.viscosity)
        self.max_viscosity = float(nu.max())
        self.nu = self.grid.filled(self.grid.pad(nu))
        self._largest = {m: self._roll(m, circulation / np.sqrt(len(axes))) for m in axes}
        self._rolls = {m: largest * self._waves_of_roll(m) for m, largest in self._largest.items()}
        self._turn = dict(zip(axes, self._rng.standard_normal(len(axes)), strict=True))
        fastest = max(2 * np.pi / model.circulation_time, float(self._waves.frequency.max()))
        self.interval = 2 * np.pi / fastest / FRAMES_PER_PERIOD
        self._memory = np.exp(-self.interval / model.circulation_time)

    def _build_blending(self) -> None:
        """Make the pass that interpolates u between the two key frames, ghost layers included."""
        pairs = zip(self._before, self._after, strict=True)
        ranges = [(0, n) for n in self.grid.padded]
        self._blend = launch(
            *(sweep(partial(_between, *pair), u, ranges) for u, pair in zip(self.u, pairs, strict=True))
        )

    def _velocity(self, potential: Potential) -> list[np.ndarray]:
        return curl({m: self._ramp[m] * a for m, a in potential.items()}, self.grid.dx)

    def _mean_square(self, potential: Potential) -> float:
        """Return the mean square speed [m²/s²] of a potential over the cells of air."""
        total = np.zeros(self.grid.shape)
        for d, u in enumerate(self._velocity(potential)):
            low, high = np.delete(u, -1, axis=d), np.delete(u, 0, axis=d)
            total += 0.5 * (low**2 + high**2)
        return float(total[self._air].mean())

    def _waves_of_roll(self, axis: int) -> np.ndarray:
        """Return half a sine wave along each axis other than `axis`, the shape of a roll about `axis`."""
        places = np.meshgrid(*edges(self.grid, axis), indexing="ij")
        waves = [np.sin(np.pi * places[a] / self.grid.extent[a]) for a in range(self.dim) if a != axis]
        return np.prod(waves, axis=0)

    def _roll(self, axis: int, speed: float) -> float:
        """Return the largest potential [m²/s] of a room-wide roll about `axis` of root mean square speed `speed`."""
        others = {m: np.zeros_like(r) for m, r in self._ramp.items()}
        square = self._mean_square(others | {axis: self._waves_of_roll(axis)})
        return as_fast(speed, square)

    def _next_frame(self) -> None:
        """Advance by a key frame: drop the earlier frame and compute the next one."""
        self._frame += 1
        t = (self._frame + 1) * self.interval
        fresh = np.sqrt(1.0 - self._memory**2)
        for m, turn in self._turn.items():
            self._turn[m] = self._memory * turn + fresh * self._rng.standard_normal()
        waves = self._waves.at(self._waves.frequency * t)
        potential = {m: self._strength * a + self._turn[m] * self._rolls[m] for m, a in waves.items()}
        velocity = self._velocity(potential)
        for d, u in enumerate(velocity):
            self._before[d].copy_from(self._after[d])
            self._after[d].from_numpy(self.grid.pad_faces(u, d))
        self._outflow = [self._outflow[1], self.grid.largest_outflow(velocity)]

    def advance(self, t: float, dt: float) -> None:
        """Set the velocity to that of time t + dt [s]; time must not decrease."""
        frame = (t + dt - self._begun) / self.interval
        while frame > self._frame + 1:
            self._next_frame()
        share = frame - self._frame
        self._blend(share)
        # the flow out of a cell is convex in u: between two frames it is at most the interpolated value
        self.outflow_rate = (1.0 - share) * self._outflow[0] + share * self._outflow[1]

    @property
    def room(self) -> RoomFlow:
        """The same waves and rolls as a flow that can be evaluated at any point and time."""
        solid = np.pad(~self._air, 1, constant_values=True)
        depth = np.maximum(np.asarray(distance_transform_edt(solid)) - 0.5, 0.0)
        return RoomFlow(
            extent=np.array(self.grid.extent),
            dx=self.grid.dx,
            k=np.pad(self._waves.k, [(0, 0), (0, 3 - self.dim)]),
            c=self._strength * self._waves.c,
            frequency=self._waves.frequency,
            rolls=self._largest,
            memory=self._model.circulation_time,
            distance=self.grid.dx * (self._distance - depth),
            layer=self._model.wall_layer,
            eddies=self._strength * self._waves.eddies,
            viscosity=self.viscosity,
            schmidt=self.schmidt,
        )

    def mixing(self) -> dict[str, float]:
        """Return the eddy diffusivity [m²/s], its standard error, and air changes per hour that mix equally (3-D)."""
        K, error = measured_diffusivity(self.room, generator(self._seed, "mixing of the air"))
        mixing = {"eddy_diffusivity_m2_per_s": K, "eddy_diffusivity_error_m2_per_s": error}
        if self.dim == 3:
            mixing["as_of_air_changes_per_h"] = air_changes(K, float(self._air.sum()) * self.grid.cell_volume)
        return mixing
