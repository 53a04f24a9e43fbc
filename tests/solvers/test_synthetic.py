import numpy as np
import pytest
from rooms import blocks, divergence, eulerian, largest_outflow, march, through_faces

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import PuffGas
from taichi_plume.scenario.winds import SyntheticWind
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.puffs import PuffSolver
from taichi_plume.solvers.synthetic_flow import SyntheticSolver

pytestmark = pytest.mark.usefixtures("taichi")

SHAPES = [(60, 42), (30, 21, 12)]


@pytest.fixture(scope="module")
def room(taichi):
    """3 m x 2.1 m (x 1.2 m), with a box."""

    def make(shape, seed=0, **keys):
        grid = Grid(shape, 3.0 / shape[0])
        solid = blocks(shape, tuple(slice(n // 3, n // 2) for n in shape))
        moving = {"speed": 0.03, "longest": 1.4, "circulation": 0.0075, "circulation_time": 60.0}
        model = SyntheticWind.model_validate({"kind": "synthetic"} | moving | keys)
        return grid, solid, SyntheticSolver(model, grid, Air.of(solid, grid), 0.0, seed)

    return make


def squared_speed(wind):
    """|u|² [m²/s²] per cell."""
    ends = [(np.delete(u, -1, axis=d), np.delete(u, 0, axis=d)) for d, u in enumerate(through_faces(wind))]
    return sum(0.5 * (low**2 + high**2) for low, high in ends)


@pytest.mark.parametrize("shape", SHAPES)
def test_no_cell_gains_air_and_no_surface_lets_it_through(room, shape):
    grid, solid, wind = room(shape)
    t = 0.0
    for dt in (0.7, 1.3, 5.0, 0.01):  # at frames and between them
        wind.advance(t, dt)
        t += dt
        u = through_faces(wind)
        assert max(np.abs(v).max() for v in u) > 0.03
        assert divergence(wind) <= 1e-6
        for d, v in enumerate(u):
            blocked = np.pad(
                solid, [(1, 1) if a == d else (0, 0) for a in range(grid.dim)], constant_values=True
            )
            closed = np.delete(blocked, 0, axis=d) | np.delete(blocked, -1, axis=d)
            assert np.all(v[closed] == 0.0)
            inner = tuple(slice(b, e + (a == d)) for a, (b, e) in enumerate(grid.cells))
            np.testing.assert_array_equal(wind.open[d].to_numpy()[inner], ~closed)


def test_scales_of_the_air_grow_with_the_room():
    model = SyntheticWind(kind="synthetic")
    small, large = model.scales((2.5, 2.0, 1.25), 0.05), model.scales((5.0, 4.0, 2.5), 0.05)
    np.testing.assert_allclose(large, 2.0 * np.array(small))
    np.testing.assert_allclose(
        large, (50.0 ** (1 / 3) / 300.0, 0.38 * 50.0 ** (1 / 3), 50.0 ** (1 / 3) / 1200.0)
    )
    assert model.scales((4.0, 1.0), 0.05).speed == pytest.approx(2.0 / 300.0)
    assert model.scales((2.5, 2.0, 1.25), 0.2).longest == pytest.approx(1.6)  # eight cells
    given = SyntheticWind(kind="synthetic", speed=0.1, longest=1.0, circulation=0.0)
    assert given.scales((5.0, 4.0, 2.5), 0.05) == (0.1, 1.0, 0.0)
    assert SyntheticWind(kind="synthetic", speed=0.1).scales((5.0, 4.0, 2.5), 0.05).circulation == 0.025


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.slow
def test_the_speed_is_as_asked(room, shape):
    squares = []
    for seed in range(3):
        _, solid, wind = room(shape, seed, circulation=0.0)
        for n in range(10):
            wind.advance(30.0 * n, 30.0)
            squares.append(squared_speed(wind)[~solid].mean())
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.03, rel=0.1)


@pytest.mark.parametrize("shape", [(15, 10), (12, 8, 5)])
@pytest.mark.slow
def test_the_circulation_is_as_asked(room, shape):
    _, solid, wind = room(shape, speed=0.0, modes=1, circulation_time=1.0)
    squares = []
    for n in range(120):
        wind.advance(2.0 * n, 2.0)
        squares.append(squared_speed(wind)[~solid].mean())
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.0075, rel=0.2)  # 120 draws tell no more


@pytest.mark.slow
def test_large_eddies_hold_the_energy():
    """E(k) ~ k^(-5/3) between the longest and the shortest wave, and next to nothing beyond."""
    k = 2 * np.pi * np.fft.fftfreq(176, 0.05)
    length = np.hypot(k[:, None], k)
    rings = 2 * np.pi / np.array([1.4, 1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12])
    ring = np.digitize(length, rings)
    energy = np.zeros(len(rings) - 1)
    for seed in range(3):
        grid = Grid((256, 256), 0.05)  # its middle is far from the walls
        wind = SyntheticWind(kind="synthetic", longest=2.0, circulation=0.0, modes=200)
        flow = SyntheticSolver(wind, grid, Air.everywhere(grid), 0.0, seed)
        window = np.outer(np.hanning(176), np.hanning(176))
        square = sum(np.abs(np.fft.fft2(u[40:216, 40:216] * window)) ** 2 for u in through_faces(flow))
        energy += np.array([square[ring == n + 1].sum() for n in range(len(energy))]) / np.diff(rings)
    middle = np.sqrt(rings[1:] * rings[:-1])
    slope = np.polyfit(np.log(middle[:5]), np.log(energy[:5]), 1)[0]
    assert slope == pytest.approx(-5 / 3, abs=0.2)
    assert energy[-1] < 1e-3 * energy[4]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.slow
def test_the_air_forgets_in_5_to_20_s(room, shape):
    grid, _, wind = room(shape)
    rng = np.random.default_rng(0)
    places = rng.uniform(0.3, np.array(grid.extent) - 0.3, (40, grid.dim))
    step, steps = 1.0, 600
    series = []
    for n in range(steps):
        wind.advance(n * step, step)
        series.append(velocity_at(wind, places, 0.0))
    u = np.array(series, float)
    lags = range(60)
    correlation = np.array([np.mean(u[: steps - k] * u[k:]) for k in lags]) / np.mean(u**2)
    end = int(np.argmax(correlation < 0.0)) if (correlation < 0.0).any() else len(correlation)
    assert 5.0 <= step * (correlation[:end].sum() - 0.5) <= 20.0


def test_the_seed_decides_every_bit(room):
    seen = []
    for seed in (3, 3, 4):
        _, _, wind = room((30, 21, 12), seed)
        march(50, 0.1, wind)
        seen.append([u.to_numpy() for u in wind.u])
    for a, b, c in zip(*seen, strict=True):
        assert a.tobytes() == b.tobytes()
        assert not np.array_equal(a, c)


def test_steps_do_not_change_the_flow(room):
    _, _, wind = room((30, 21, 12))
    march(40, 0.25, wind)
    fine = [u.to_numpy() for u in wind.u]
    _, _, wind = room((30, 21, 12))
    march(2, 5.0, wind)
    for u, v in zip(wind.u, fine, strict=True):
        np.testing.assert_allclose(u.to_numpy(), v, atol=1e-7)


@pytest.mark.parametrize("shape", SHAPES)
def test_shorter_eddies_fade_at_surfaces_as_the_waves_do(room, shape):
    grid, solid, wind = room(shape)
    nu = grid.read(wind.nu)
    assert wind.max_viscosity == pytest.approx(nu.max())
    assert np.all(nu[solid] == np.float32(wind.viscosity))
    away = nu[(slice(4), *(n // 2 for n in shape[1:]))] - wind.viscosity  # from the face at x = 0
    assert np.all(np.diff(away) > 0.0)
    assert away[0] < 0.3 * away[-1]


@pytest.mark.slow
def test_shorter_eddies_take_up_what_the_waves_hand_on():
    """The dissipation of waves E = A k^(-5/3), 2 nu int k² E dk, is (A/C)^(3/2) where the longest are long."""
    grid = Grid((160, 160), 0.05)
    model = SyntheticWind(kind="synthetic", speed=0.2, circulation=0.0, longest=2.0, modes=200)
    wind = SyntheticSolver(model, grid, Air.everywhere(grid))
    middle, squares = (slice(40, 120),) * 2, []
    for n in range(40):
        wind.advance(5.0 * n, 5.0)
        squares.append(squared_speed(wind)[middle].mean())
    k = np.linspace(2 * np.pi / 2.0, 2 * np.pi / 0.2, 20_000)
    A = 0.5 * np.mean(squares) / np.trapezoid(k ** (-5 / 3), k)
    longer = np.linspace(0.0, k[-1], 20_000)
    dissipation = 2.0 * grid.read(wind.nu)[80, 80] * A * np.trapezoid(longer ** (1 / 3), longer)
    assert dissipation == pytest.approx((A / 1.62) ** 1.5, rel=0.15)  # of the squares 200 waves tell no more


def test_shorter_eddies_mix_gas():
    """A cosine along the room in air at rest decays as by K = D + nu_t/Sc."""
    grid = Grid((40, 4), 0.05)
    model = SyntheticWind(kind="synthetic", speed=0.1, longest=1.0, wall_layer=1e-3, schmidt=0.5)
    wind = SyntheticSolver(model, grid, Air.everywhere(grid))
    for u in wind.u:
        grid.write(u, np.zeros([n + 2 for n in grid.shape]), 1)
    wind.outflow_rate = 0.0
    gas = EulerianSolver(eulerian((1.0, 0.1)), grid, wind, Air.everywhere(grid))
    mode = np.cos(np.pi * grid.centers()[..., 0] / grid.extent[0])
    gas.start_from(lambda x: 1.0 + 0.5 * mode)
    K = gas.species.diffusivity + (wind.max_viscosity - wind.viscosity) / 0.5
    assert gas.species.diffusivity < 0.05 * K
    end = 1.0 / (K * (np.pi / grid.extent[0]) ** 2)
    gas.advance(0.0, end)
    left = 2.0 * (grid.read(gas.c) * mode).mean() / 0.5
    assert left == pytest.approx(np.exp(-1.0), rel=2e-3)


@pytest.mark.parametrize("shape", [SHAPES[0], pytest.param(SHAPES[1], marks=pytest.mark.slow)])
def test_well_mixed_gas_stays_well_mixed_and_the_rest_of_it_stays_inside(room, shape):
    grid, solid, wind = room(shape)
    plume = eulerian((0.5, 0.5, 0.3)[: grid.dim], 1e-6, radius=0.1)
    gas = EulerianSolver(plume, grid, wind, Air.of(solid, grid))
    for n in range(100):
        wind.advance(0.2 * n, 0.2)
        gas.advance(0.2 * n, 0.2)
        assert gas.least() >= 0.0
    budget = gas.budget()
    assert budget["in_domain_kg"] == pytest.approx(2e-5, rel=1e-5)
    assert budget["outflow_kg"] == 0.0
    assert np.all(gas.cells(20.0)[solid] == 0.0)
    _, _, wind = room(shape)
    gas = EulerianSolver(
        eulerian((0.5, 0.5, 0.3)[: grid.dim], 0.0, radius=0.1), grid, wind, Air.of(solid, grid)
    )
    gas.start_from(lambda x: np.where(solid, 0.0, 1.0))
    march(100, 0.2, wind, gas)
    np.testing.assert_allclose(gas.cells(20.0)[~solid], 1.0, rtol=2e-5)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_outflow_of_a_cell_is_known(room, shape):
    _, _, wind = room(shape)
    for n in range(8):
        wind.advance(0.9 * n, 0.9)
        out = largest_outflow(wind)
        assert 0.5 * wind.outflow_rate <= out <= wind.outflow_rate * (1 + 1e-6)


@pytest.mark.slow
def test_puffs_grow_by_the_shorter_eddies_too():
    """A puff at rest grows at least by 2 (D + nu_t/Sc) dt, and from a cell's width on it is gas on the grid."""
    grid = Grid((20, 20), 0.1)
    wind = SyntheticSolver(SyntheticWind(kind="synthetic", speed=0.05), grid, Air.everywhere(grid), 0.0, 1)
    model = {"kind": "puffs", "sources": [{"position": (1.0, 1.0), "rate": 0.0}], "initial_size": 0.02}
    puffs = PuffSolver(PuffGas.model_validate(model), grid, wind, Air.everywhere(grid))
    puffs.start_from(np.array([[1.0, 1.0]]), 1e-6)
    puffs.advance(0.0, 0.5)
    K = puffs.species.diffusivity + (wind.max_viscosity - wind.viscosity) / wind.schmidt
    variance = float(puffs.puffs.rows()[0, puffs.puffs.variance])
    assert variance >= 0.02**2 + 0.9 * K  # 0.9: the middle is not quite where nu is largest
    march(120, 0.5, wind, puffs)
    assert puffs.puffs.rows()[:, puffs.puffs.mass].sum() == 0.0
    assert puffs.budget()["in_domain_kg"] == pytest.approx(1e-6, rel=1e-5)
