"""Plumes across the wind: how much passes, where, and how wide."""

import numpy as np
import pytest

from taichi_plume.grid.fields import concentration_at, velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.closed_forms import GaussianPlumeGas, MeanderingGas
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.plumes import Plumes
from taichi_plume.solvers.uniform_wind import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")

Q = 3e-5  # kg/s
GUSTS = {"intensity": 0.2, "time": 1.5}
MODELS = {"gaussian_plume": GaussianPlumeGas, "meandering": MeanderingGas}


@pytest.fixture(scope="module")
def plume(taichi):
    """A wind and a plume in it."""

    def make(velocity, position, t=0.0, kind="gaussian_plume", gusts=None, **keys):
        wind = UniformWind.model_validate({"kind": "uniform", "velocity": velocity, "gusts": gusts})
        sources = [{"position": position, "rate": Q, "radius": 0.05}]
        gas = MODELS[kind].model_validate({"kind": kind, "sources": sources} | keys)

        grid = Grid((60, 40, 20)[: len(velocity)], 0.1, depth=0.5)
        flow = UniformSolver(wind, grid, t, 4)
        return flow, Plumes(gas, grid, flow, t, 4)

    return make


def section(wind, gas, position, distance, span=4.0, dx=0.02, base=None):
    """Flux through a plane across the wind at a distance, and mean and variance along the axes in it."""
    frame = wind.model.frame
    q = [np.arange(-span, span, dx) + dx / 2] * (len(frame) - 1)
    grid = np.stack(np.meshgrid(*q, indexing="ij"), axis=-1)
    x = np.array(position) + distance * frame[0] + grid @ frame[1:]
    c = concentration_at(gas, x, 0.0).astype(float)
    if base is not None:
        c[x[..., base] < 0] = 0.0
    depth = 0.5 if len(frame) == 2 else 1.0
    flux = c.sum() * dx ** len(q) * wind.model.speed * depth
    axes = tuple(range(c.ndim))
    mean = (c[..., None] * grid).sum(axes) / c.sum()
    return flux, mean, (c[..., None] * (grid - mean) ** 2).sum(axes) / c.sum()


INTENSITY, DIFFUSIVITY = {"intensity": [0.1, 0.07]}, {"diffusivity": [0.01, 0.004]}


@pytest.mark.parametrize(
    ("velocity", "law"),
    [
        ((-0.3, 0.5), DIFFUSIVITY),
        ((0.3, -0.4, 0.2), INTENSITY),
        ((0.0, 0.0, 0.5), DIFFUSIVITY),
    ],
)
def test_the_mean_plume_carries_what_is_emitted(plume, velocity, law):
    dim, position, far = len(velocity), (2.0, 2.0, 1.0)[: len(velocity)], 2.3
    law = {key: values[: dim - 1] for key, values in law.items()}
    wind, gas = plume(velocity, position, walls=[], **law)
    flux, mean, variance = section(wind, gas, position, far, span=2.5)
    assert flux == pytest.approx(Q, rel=1e-4)
    np.testing.assert_allclose(mean, 0.0, atol=1e-4)
    if "intensity" in law:
        expected = (0.05 + np.array(law["intensity"]) * far) ** 2
    else:
        expected = 0.05**2 + 2 * np.array(law["diffusivity"]) * far / np.linalg.norm(velocity)
    np.testing.assert_allclose(variance, expected, rtol=2e-3)
    upwind = np.array(position) - 0.1 * wind.model.frame[0]
    assert concentration_at(gas, upwind[None], 0.0) == 0.0


@pytest.mark.parametrize("velocity", [(0.6, 0.0, 0.0), (-0.3, 0.4, 0.0)])
def test_the_ground_reflects(plume, velocity):
    """What passes above the ground is all, and no gas diffuses into the ground."""
    position = (2.0, 2.0, 0.2)
    wind, gas = plume(velocity, position, intensity=0.15)
    flux, _, _ = section(wind, gas, position, 2.1, base=2)
    assert flux == pytest.approx(Q, rel=1e-3)
    near = np.array(position) + 1.3 * wind.model.frame[0] + [0.0, 0.05, -0.2]
    low, high = concentration_at(gas, near + 1e-3 * np.array([[0, 0, -1], [0, 0, 1]]), 0.0)
    assert low > 0.0
    assert high == pytest.approx(low, rel=1e-4)


def test_walls_on_both_sides_make_it_even(plume):
    position = (0.5, 1.0)
    _, gas = plume((0.5, 0.0), position, walls=["y-", "y+"], diffusivity=0.5)
    y = np.arange(0.05, 4.0, 0.1)
    c = concentration_at(gas, np.stack([np.full_like(y, 5.9), y], axis=1), 0.0)
    k = np.pi / 4 * np.arange(1, 50)[:, None]
    waves = np.cos(k * y) * np.cos(k * 1.0) * np.exp(-(k**2) * (0.05**2 / 2 + 0.5 * 5.4 / 0.5))
    np.testing.assert_allclose(c, Q / 0.5 / 0.5 / 4 * (1 + 2 * waves.sum(axis=0)), rtol=1e-4)


@pytest.mark.parametrize("velocity", [(0.5, 0.0), (-0.3, 0.4, 0.0)])
def test_the_meandering_plume_is_where_its_air_has_gone(plume, velocity):
    """Air followed backwards through the wind that anemometers have read leads to the source."""
    dim, position, far = len(velocity), (3.0, 2.0, 1.0)[: len(velocity)], 1.1
    wind, gas = plume(
        velocity,
        position,
        kind="meandering",
        gusts=GUSTS | {"vertical": 0.1 * (dim == 3)},
        t=-1.0,
        walls=[],
    )
    dt, place = 0.01, np.array([position], np.float32)
    steps = round(far / 0.5 / dt)
    air = np.array(position)
    for n in range(steps):
        t = -1.0 + n * dt
        wind.advance(t, dt / 2)
        air = air + dt * velocity_at(wind, place, t)[0]  # midpoint rule
        wind.advance(t + dt / 2, dt / 2)
        gas.advance(t, dt)
    flux, mean, variance = section(wind, gas, position, far, span=1.5)
    assert flux == pytest.approx(Q, rel=1e-4)
    offset = wind.model.frame @ (air - position)
    assert offset[0] == pytest.approx(far, rel=1e-5)
    assert np.abs(offset[1:]).max() > 0.01
    np.testing.assert_allclose(mean, offset[1:], atol=2e-4)
    slopes = np.array([0.08, 0.06][: dim - 1])
    np.testing.assert_allclose(variance, 0.05**2 + (slopes * far) ** 2, rtol=1e-3)


@pytest.mark.parametrize("slope", [0.02, 0.9])
def test_a_channel_keeps_the_meandering_plume(plume, slope):
    """Thin and wide, and when the gusts would have swept it far beyond the walls."""
    gusts = {"intensity": 3.0, "time": 5.0}
    wind, gas = plume(
        (0.5, 0.0), (1.0, 1.0), kind="meandering", gusts=gusts, walls=["y-", "y+"], width_slope=slope
    )
    y = (np.arange(2000) + 0.5) * 0.002  # the channel is 4 m wide
    swept = 0.0
    for n in range(30):
        wind.advance(float(n), 1.0)
        c = concentration_at(gas, np.stack([np.full_like(y, 5.5), y], axis=1), 0.0)
        assert c.sum() * 0.002 * 0.5 * 0.5 == pytest.approx(Q, rel=1e-4)
        swept = max(swept, abs(np.ptp([wind.displacement(n + 1.0 - age)[1] for age in (0.0, 9.0)])))
    assert swept > 12.0


def test_the_width_fluctuates_and_the_flux_does_not(plume):
    position = (1.0, 2.0)
    wind, gas = plume(
        (0.5, 0.0), position, kind="meandering", gusts=GUSTS | {"time": 0.1}, width_fluctuation=0.3
    )
    widths = []
    for n in range(100):
        wind.advance(0.5 * n, 0.5)
        gas.advance(0.5 * n, 0.5)
        flux, _, variance = section(wind, gas, position, 2.0, span=2.5)
        assert flux == pytest.approx(Q, rel=1e-3)
        widths.append(np.log(variance[0] / (0.05**2 + 0.16**2)) / 2)
    # of a hundred independent ones
    assert np.std(widths) == pytest.approx(0.3, rel=4 / np.sqrt(200))
    assert np.mean(widths) == pytest.approx(-(0.3**2) / 2, abs=4 * 0.3 / 10)
