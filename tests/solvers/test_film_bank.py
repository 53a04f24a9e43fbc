"""Recorded airs in memory, against linear interpolation in NumPy and a field that it gives exactly."""

from functools import reduce
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_plume.engine import program, ti
from taichi_plume.scenario.species import SPECIES
from taichi_plume.solvers.film_bank import FilmBank, half

ACETONE, ETHANOL = SPECIES["acetone"], SPECIES["ethanol"]
FILMS, FRAMES, DX, FRAME = 2, 5, 0.1, 0.5
CELLS, LOW = (6, 4, 3), 0.4  # of a volume, whose lower end is at LOW [m]; planes have the first two axes
COUNT, ROBOTS = 150, 2
HALF = 2.0**-11  # relative rounding of half precision


def recorded(dim: int) -> SimpleNamespace:
    """Films of random numbers, of three gases and with walls in different places for wind and gas."""
    rng, shape = np.random.default_rng(0), (FILMS, FRAMES, *CELLS[:dim])
    ppm = rng.uniform(0.0, [3e5, 1.0, 2e-4], (*shape, 3))
    values = np.empty((*shape, 5), np.float16)
    values[..., :2] = rng.normal(size=(*shape, 2))
    scale = np.empty((FILMS, 3), np.float32)
    for film in range(FILMS):
        values[film, ..., 2:], scale[film] = half(ppm[film])
    air = np.ones((2, *CELLS[:dim]), bool)
    air[0, 2, 1] = air[1, 3, 2] = air[1, 3, 1] = False
    if dim == 3:
        air[:, :, :, 1] = True
    return SimpleNamespace(
        values=values,
        scale=scale,
        air=air,
        spacing=DX,
        low=LOW,
        frame=FRAME,
        species=(ACETONE, ETHANOL, ACETONE),
        ppm=ppm,
    )


class Asking:
    """Asks a bank at a place of each robot."""

    def __init__(self, bank: FilmBank, size: int):
        self.bank, self.size = bank, size
        self.ppm = ti.field(ti.f32, (size, len(bank.species)))
        self.u = ti.field(ti.f32, (size, 2))

    @ti.kernel
    def ask(self, places: ti.types.ndarray()):
        for i in range(self.size):
            x = ti.Vector.zero(ti.f32, self.bank.dim)
            for d in ti.static(range(self.bank.dim)):
                x[d] = places[i, d]
            ppm, u = self.bank.ppm_of(i, x, 0.0), self.bank.velocity_of(i, x, 0.0)
            for s in ti.static(range(self.ppm.shape[1])):
                self.ppm[i, s] = ppm[s]
            for d in ti.static(range(2)):
                self.u[i, d] = u[d]

    def __call__(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ppm (robots, species) and wind [m/s] (robots, 2)."""
        self.ask(np.ascontiguousarray(places, np.float32))
        return self.ppm.to_numpy(), self.u.to_numpy()


@pytest.fixture(scope="module", params=[2, 3])
def asked(request):
    """What robots meet at random places and times, and all that decides it."""
    program.start("cpu")
    dim = request.param
    of, rng = recorded(dim), np.random.default_rng(5)
    bank = FilmBank(of, COUNT, ROBOTS)
    film, gas = rng.integers(0, FILMS, COUNT), rng.integers(-1, 3, COUNT)
    begin, now = rng.uniform(0, 1.5, COUNT), rng.uniform(0, 1.0, COUNT)  # some beyond the end
    for field, values in ((bank.film, film), (bank.gas_of, gas), (bank.begin, begin), (bank.now, now)):
        field.from_numpy(values)
    ends = np.array([[-0.02] * dim, [n * DX + 0.02 for n in CELLS[:dim]]]) + [0.0, 0.0, LOW][:dim]
    places = rng.uniform(ends[0], ends[1], (COUNT * ROBOTS, dim))
    ppm, u = Asking(bank, len(places))(places)
    return SimpleNamespace(of=of, film=film, gas=gas, at=begin + now, places=places, ppm=ppm, u=u)


def reference(film: np.ndarray, air: np.ndarray, t: float, place: np.ndarray) -> np.ndarray:
    """Linear between frames (frames, ..., channels), and between the centres of cells of air; the ends hold."""
    k = min(t / FRAME, FRAMES - 1)
    n = min(int(k), FRAMES - 2)
    now = film[n] + (k - n) * (film[n + 1] - film[n])
    shares = [np.maximum(0.0, 1.0 - np.abs(np.arange(m) - np.clip((x - low) / DX - 0.5, 0, m - 1)))
              for m, x, low in zip(air.shape, place, (0.0, 0.0, LOW), strict=False)]  # fmt: skip
    weight = reduce(np.multiply.outer, shares) * air
    return np.tensordot(weight, now, air.ndim) / max(weight.sum(), 1e-6)


def test_robots_meet_the_film_the_moment_and_the_gas_of_their_environment(asked):
    for i, place in enumerate(asked.places):
        e = i // ROBOTS
        film, chosen = asked.film[e], asked.gas[e]
        ppm = reference(asked.of.ppm[film], asked.of.air[1], asked.at[e], place)
        ppm = np.where((chosen < 0) | (np.arange(3) == chosen), ppm, 0.0)
        wind = asked.of.values[film, ..., :2].astype(float)
        np.testing.assert_allclose(asked.ppm[i], [ppm[0] + ppm[2], ppm[1]], rtol=2 * HALF, atol=1e-9)
        np.testing.assert_allclose(
            asked.u[i], reference(wind, asked.of.air[0], asked.at[e], place), atol=2e-5
        )


def test_no_gas_is_too_thin_or_too_dense_for_half_precision():
    ppm = np.array([1e6, 1.0, 1e-3, 0.0, 2e5]).reshape(1, 5, 1, 1) * [1.0, 1e-9]
    values, scale = half(ppm)
    again = values.astype(float) * scale
    assert np.isfinite(values).all()
    np.testing.assert_allclose(again[0, :2], ppm[0, :2], rtol=HALF)
    np.testing.assert_allclose(again, ppm, rtol=HALF, atol=1e-9 * 1e6)
    assert (half(np.zeros((2, 3, 4, 1)))[0] == 0).all()
