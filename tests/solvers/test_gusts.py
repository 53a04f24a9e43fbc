import numpy as np
import pytest
from scipy.linalg import expm

from taichi_plume.grid.fields import velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.gusts import OrnsteinUhlenbeck
from taichi_plume.solvers.uniform_wind import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module")
def windy(taichi):
    """A gusty wind in a room of so many cells from -2 s on."""

    def make(velocity=(0.5, 0.0), shape=(20, 10), seed=3, **gusts):
        data = {"kind": "uniform", "velocity": velocity, "gusts": {"time": 0.4} | gusts}
        model = UniformWind.model_validate(data)
        return UniformSolver(model, Grid(shape, 0.1), -2.0, seed)

    return make


def test_the_joint_law_of_velocity_and_displacement():
    """Covariances of (v, dY) over an interval against the matrix exponential of the linear system (Van Loan)."""
    T, s = 0.7, 0.3
    process = OrnsteinUhlenbeck([s], T, 0.0, 200.0, generator(1, "test"))
    h = process.interval
    drift = np.array([[-1 / T, 0.0], [1.0, 0.0]])
    noise = np.array([[2 * s**2 / T, 0.0], [0.0, 0.0]])
    block = expm(np.block([[-drift, noise], [np.zeros((2, 2)), drift.T]]) * h)
    step = block[2:, 2:].T
    law = step @ block[:2, 2:]
    y, v = process._known[: process._drawn, :, 0].T
    n = len(y) - 1
    assert n > 5000
    new = np.stack([v[1:] - step[0, 0] * v[:-1], np.diff(y) - step[1, 0] * v[:-1]])
    scale = np.sqrt(np.outer(law.diagonal(), law.diagonal()))
    # the error of a covariance of n pairs is at most sqrt(2/n) of the scale
    np.testing.assert_allclose(np.cov(new) / scale, law / scale, atol=4 * np.sqrt(2 / n))
    assert np.abs(np.corrcoef([*new, v[:-1]])[2, :2]).max() < 4 / np.sqrt(n)


def test_the_path_does_not_depend_on_the_steps(windy):
    for dt in (0.01, 0.13, 1.0):
        stepped, t = windy(), -2.0
        while t < 7.0:
            stepped.advance(t, dt)
            t += dt
        x = np.array([[0.3, 0.2]])
        displacement, u = stepped.displacement(t), velocity_at(stepped, x, t)
        steady = windy()
        steady.advance(-2.0, t + 2.0)
        np.testing.assert_allclose(steady.displacement(t), displacement, rtol=1e-12, err_msg=f"{dt}")
        np.testing.assert_array_equal(velocity_at(steady, x, t), u, f"{dt}")


def test_the_air_moves_with_the_gusts(windy):
    """The face velocities add up to the displacement, of which the gust is the slope."""
    wind = windy((0.3, 0.4, 0.0), (8, 8, 8), vertical=0.1)
    begin, dt = wind.displacement(-2.0), 0.03
    gone = np.zeros(3)
    for n in range(200):
        wind.advance(-2.0 + n * dt, dt)
        u = np.array([wind.grid.read(u)[4, 4, 4] for u in wind.u])
        gone += (u - wind.mean) * dt
        assert wind.outflow_rate == pytest.approx(np.abs(u).sum() / 0.1, rel=1e-6)
    t = -2.0 + 200 * dt
    np.testing.assert_allclose(gone, wind.displacement(t) - begin, atol=1e-5)
    slope = (wind.displacement(t) - wind.displacement(t - 1e-5)) / 1e-5
    gust = velocity_at(wind, np.array([[0.1, 0.2, 0.3]]), t)[0] - wind.mean
    np.testing.assert_allclose(gust, slope, atol=1e-4)
    assert abs(gust @ wind.mean) < 1e-6
    assert abs(gust[2]) > 1e-4


def test_gusts_are_as_strong_as_reported(windy):
    wind = windy((1.2, 0.0), intensity=0.2, time=0.1)
    v = np.empty((1500, 2))
    for n in range(len(v)):
        wind.advance(0.3 * n - 2.0, 0.3)  # apart enough to be independent
        v[n] = velocity_at(wind, np.array([[0.5, 0.5]]), 0.0)[0]
    assert np.ptp(v[:, 0]) == 0.0
    # between the knots the variance is 0.6 % too small at most
    assert v[:, 1].std() == pytest.approx(0.2 * 1.2, rel=4 / np.sqrt(2 * len(v)) + 0.003)
    assert v[:, 1].mean() == pytest.approx(0.0, abs=4 * 0.24 / np.sqrt(len(v)) * 1.1)


def test_a_seed_decides_the_gusts(windy):
    a, b, c = (windy(seed=seed).displacement(-2.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert np.all(a[1] != c[1])
