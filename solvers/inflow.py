"""Inflow turbulence: random waves, free of divergence, that the wind carries in (von Karman spectrum).

    u = curl A,   <|A(k)|²> ~ (k_L² + k²)^-(5/6 + (dim + 1)/2)

gives the spectra of von Karman (1948, doi:10.1073/pnas.34.11.530): along the wind (k_L² + k²)^-5/6, with a -5/3 range.
The turbulence moves past the opening as if frozen (Taylor's hypothesis): time is the travelled distance over the speed.
As the waves are divergence-free, the pressure does not weaken them. A wave that varies along the face has no net flux
through it; a wave that does not vary along the face has, being divergence-free, only motion along the face.

Only resolved turbulence is blown in: waves from 6 cells on, and the strongest at least 8 cells long; convection would
erase shorter waves within metres. All these waves together have the required intensity, and k_L is chosen for the
required integral length, as far as both limits allow: at least about 4 cells. An opening of less than 10 cells across
has no eddies of that length: shaking its whole jet with the full intensity would make the jet spread half as fast
again. There, shorter eddies that the cells do not resolve are left out, and the intensity is less.
"""

from math import ceil, cos, pi, sin, sqrt

import numpy as np
from scipy.fft import ifft
from scipy.special import betainc

from taichi_plume.grid.rng import generator
from taichi_plume.solvers.openings import JetPatch, bounds

SHORTEST, STRONGEST = 6.0, 8.0  # cells: shortest wave, and least length of the strongest wave
INTEGRAL = 0.7468  # length times k_L of all waves, Gamma(1/3)^-1 Gamma(5/6) sqrt(pi)
PLANES = 8  # points per shortest wave, which keeps 99 % of its amplitude when interpolated by cubics
SCALES = 12  # number of trial values of k_L
CARRIED = 4.0  # cells: shorter integral lengths become about as long
WIDEST = 0.4  # integral length of the eddies in an opening, over its width
PLANES_AT_ONCE = 4  # planes of a cubic
LENGTHS = 12.0  # integral lengths from one box of waves to the next: blending them shortens those by 2 %


class Waves:
    """Random waves of inflow turbulence at an opening: wave numbers and amplitudes.

    k: per axis of the domain, as the differences of the grid see it [1/m], with a third that is zero in 2-D; along the
    wind first, then along the face's axes, the last of only one sign. amplitude: amplitude of each wave's potential;
    shift: phase factor by each component's place on the staggered grid; strength: standard deviation of all waves over
    the nominal deviation.
    """

    def __init__(self, patch: JetPatch, counts: list[int], length: float):
        """counts: number of cells along each axis of the face; length: integral length [m]."""
        dx, dim = patch.grid.dx, patch.grid.dim
        cut = 2.0 * pi / (SHORTEST * dx)
        self.spacing = SHORTEST * dx / PLANES  # spacing of the planes along the wind [m]
        # planes shared by two boxes
        self.overlap = ceil(LENGTHS * max(length, SHORTEST * dx) / self.spacing)
        self.planes = 2 * self.overlap
        numbers = 2.0 * pi * np.fft.fftfreq(self.planes, self.spacing)
        self.kept = np.abs(numbers) <= cut
        # small openings have a single wave
        limits = [cut, *(max(cut, 2.0 * sqrt(2.0) * pi / (n * dx)) for n in counts)]
        self.across = [self._fitting(n, dx, most) for n, most in zip(counts, limits[1:], strict=True)]
        self.across[-1] = np.unique(np.abs(self.across[-1]))
        mesh = np.meshgrid(numbers[self.kept], *self.across, indexing="ij")
        self.square = sum(k**2 for k in mesh)
        inside = sum((k / most) ** 2 for k, most in zip(mesh, limits, strict=True)) <= 1.0
        # twice: for both signs
        self.weight = inside * (self.square > 0.0) * np.where(mesh[-1] > 0.0, 2.0, 1.0)
        axes = (patch.axis, *patch.along)
        self.k = np.zeros((3, *self.square.shape))
        for axis, k in zip(axes, mesh, strict=True):
            self.k[axis] = 2.0 / dx * np.sin(0.5 * k * dx)
        self.k[patch.axis] *= -1.0 if patch.side == 0 else 1.0  # air from upstream arrives later
        moved = [np.where(a == patch.axis, 0.0, mesh[axes.index(a)]) for a in range(dim)]
        self.shift = np.exp(-0.5j * dx * np.array(moved))
        self.potentials = range(3) if dim == 3 else (2,)
        self.of_unit = sum(self.curl(unit) ** 2 for unit in np.eye(3)[list(self.potentials)])[:dim]
        self._through = patch.axis
        self.exponent = 5.0 / 6.0 + (dim + 1) / 2.0
        strongest = 2.0 * pi / (STRONGEST * dx) / sqrt(0.6 * (dim + 1))
        scale = self._scale(length, strongest)
        self.strength = 1.0
        if length < CARRIED * dx and WIDEST * min(counts) < CARRIED:
            scale = INTEGRAL / length
            self.strength = sqrt(_share(cut / scale, dim))
        self.amplitude = np.sqrt(self._spectrum(scale))

    @staticmethod
    def _fitting(n: int, dx: float, most: float) -> np.ndarray:
        """Return the wave numbers up to `most` [1/m] of waves with a period of n cells of size dx [m]."""
        k = 2.0 * pi * np.fft.fftfreq(n, dx)
        return k[np.abs(k) <= most]

    def curl(self, potential: np.ndarray) -> np.ndarray:
        """Return k x potential, (3, ...), for one potential (3,) or for a potential per wave (3, ...)."""
        a = potential.reshape(3, *(1,) * (self.k.ndim - potential.ndim), *potential.shape[1:])
        return np.stack([self.k[m] * a[n] - self.k[n] * a[m] for m, n in ((1, 2), (2, 0), (0, 1))])

    def _spectrum(self, scale: float) -> np.ndarray:
        return self.weight / (scale**2 + self.square) ** self.exponent

    def _scale(self, length: float, strongest: float) -> float:
        """Return k_L [1/m] such that the waves have the integral length `length` [m], or the nearest possible value."""
        scales = np.geomspace(strongest, min(INTEGRAL / length, strongest), SCALES)
        powers = [self._spectrum(scale) * self.of_unit[self._through] for scale in scales]
        # half the power of the waves that are constant along the wind, over all power and the spacing of the wave
        # numbers
        lengths = [0.5 * self.planes * self.spacing * p[0].sum() / max(p.sum(), 1e-300) for p in powers]
        return float(np.interp(length, lengths, scales))


def _share(x: float, dim: int) -> float:
    """Return the energy fraction below k = x of a von Karman spectrum k^(dim + 1)/(1 + k²)^(5/6 + (dim + 1)/2)."""
    return float(betainc(1.0 + 0.5 * dim, 1.0 / 3.0, x**2 / (1.0 + x**2)))


class Fluctuations:
    """Turbulent velocity of a jet: planes of unit variance (less at small openings) over the cells of its face.

    The waves fill boxes as wide as the opening. Each box is drawn once and blended with the next, so nothing repeats.
    travelled: distance that the air has moved through the opening [m].
    """

    STATE = ("travelled",)

    def __init__(self, patch: JetPatch, length: float, seed: int, name: str):
        """length: integral length [m] along the wind; seed, name: of the random stream."""
        self.patch, self.dim = patch, patch.grid.dim
        self.travelled = 0.0
        self._seed, self._name = seed, name
        grid, window, inner = patch.grid, patch.window, bounds(patch.covered)
        self.waves = waves = Waves(patch, [part.stop - part.start for part in inner], length)
        self._tables = []
        for k, a, part, first in zip(waves.across, patch.along, window, inner, strict=True):
            cells = grid.pad(np.arange(grid.shape[a]), (a,))[part] - first.start
            self._tables.append(np.exp(1j * np.outer(k, (cells + 0.5) * grid.dx)).astype(np.complex64))
        last = self._tables[0]  # in the product for a plane, whose real part alone is computed
        self._real = np.stack([last.real, -last.imag], axis=1).reshape(2 * len(last), -1)
        self._mean = np.pad(patch.covered / patch.covered.sum(), grid.ghost)[window].T.astype(np.float32, "C")
        self._factors = self._scales()
        # a velocity along the face lies between two of its cells
        here = [
            patch.covered
            if a == patch.axis
            else patch.covered & np.roll(patch.covered, 1, patch.along.index(a))
            for a in range(self.dim)
        ]
        self._here = np.array([grid.pad(mask, patch.along)[window].T for mask in here], np.float32)
        self._boxes: dict[int, np.ndarray] = {}
        # the four planes around the face in two boxes; `_places`: number of the second box, and of the plane
        self._planes = np.empty((PLANES_AT_ONCE, 2, *self._here.shape), np.float32)
        self._places: list[tuple[int, int] | None] = [None] * PLANES_AT_ONCE

    def _scales(self) -> np.ndarray:
        """Return the factors that give each velocity component its standard deviation on the staggered grid.

        The normal component counts without its mean, which obstacles or a round rim may leave.
        """
        power = self.waves.amplitude**2 * self.waves.of_unit
        total = power.reshape(self.dim, -1).sum(axis=1)
        mean = self._mean.T
        for table in self._tables:
            mean = np.tensordot(mean, table, axes=(0, 1))
        through = self.patch.axis
        lost = (power[through] * np.abs(mean) ** 2).sum()
        total[through] = total[through] - lost if lost < 0.999 * total[through] else 0.0
        scale = [self.waves.strength / sqrt(t) if t > 0.0 else 0.0 for t in total]
        return self.waves.shift * np.reshape(scale, (-1, *(1,) * self.dim))

    def _box(self, number: int) -> np.ndarray:
        """Return the waves of box `number` in each plane across the wind: (planes, dim, waves along each axis)."""
        if number not in self._boxes:
            self._boxes = {n: box for n, box in self._boxes.items() if n == number - 1}
            waves, rng = self.waves, generator(self._seed, f"{self._name} box {number}")
            potential = np.zeros((3, *waves.square.shape), complex)
            for c in waves.potentials:
                potential[c] = waves.amplitude * sqrt(2.0) * np.exp(2j * pi * rng.random(waves.square.shape))
            velocity = waves.curl(potential)
            box = np.zeros((waves.planes, self.dim, *waves.square.shape[1:]), np.complex64)
            for d, factor in enumerate(self._factors):
                box[waves.kept, d] = factor * velocity[d]
            self._boxes[number] = np.asarray(ifft(box, axis=0, norm="forward", overwrite_x=True))
        return self._boxes[number]

    def pair(self, number: int, place: int) -> np.ndarray:
        """Return the velocities in plane `place` in boxes number - 1 and `number`, without net flow.

        Shape (2, dim, *window), with the window's axes in reverse order.
        """
        overlap, size = self.waves.overlap, self.waves.planes
        planes = [self._box(n)[(place - n * overlap) % size] for n in (number - 1, number)]
        waves = np.array(planes).swapaxes(2, -1)
        for table in self._tables[1:]:
            waves = table.T @ waves
        parts = waves.reshape(-1, waves.shape[-1]).view(np.float32)
        pair = (parts @ self._real).reshape(2, *self._here.shape)
        through = pair[:, self.patch.axis].reshape(2, -1)
        through -= (through @ self._mean.ravel())[:, None]
        return pair * self._here

    def advance(self, speed: float, dt: float) -> np.ndarray:
        """Return turbulent velocities, (*window, dim), after dt [s] at `speed` [m/s]; no net flow."""
        number, first, cubic, boxes = self.move(speed, dt)
        shares = [0.0] * (2 * PLANES_AT_ONCE)
        for place, weight in enumerate(cubic, first):
            row = place % PLANES_AT_ONCE
            shares[2 * row : 2 * row + 2] = boxes[0] * weight, boxes[1] * weight
            if self._places[row] != (number, place):
                self._planes[row] = self.pair(number, place)
                self._places[row] = (number, place)
        now = np.array(shares, np.float32) @ self._planes.reshape(2 * PLANES_AT_ONCE, -1)
        return now.reshape(self._here.shape).T

    def move(
        self, speed: float, dt: float
    ) -> tuple[int, int, tuple[float, float, float, float], tuple[float, float]]:
        """Advance by dt [s] at `speed` [m/s]. Return the number of the second box of waves, the first plane, the
        weights of PLANES_AT_ONCE planes, and those of both boxes.
        """
        self.travelled += abs(speed) * dt
        whole, f = divmod(self.travelled / self.waves.spacing, 1.0)
        number = int(whole) // self.waves.overlap
        turn = 0.5 * pi * ((whole + f) / self.waves.overlap - number)
        cubic = (
            -f * (f - 1) * (f - 2) / 6,
            (f + 1) * (f - 1) * (f - 2) / 2,
            -(f + 1) * f * (f - 2) / 2,
            (f + 1) * f * (f - 1) / 6,
        )
        return number, int(whole) - 1, cubic, (cos(turn), sin(turn))

    def planes_until(self, number: int) -> int:
        """Return the end of the planes that are needed with box `number` as the second box."""
        return (number + 1) * self.waves.overlap + PLANES_AT_ONCE - 2
