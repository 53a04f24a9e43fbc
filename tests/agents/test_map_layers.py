"""Gas maps over height against dense NumPy references in 3-D, a map of one layer against that of the floor."""

from dataclasses import replace

import numpy as np
import pytest
from readers import COUNT, EXTENT, TRIALS, Readers, feed, same

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.gmrf import MarkovMap
from taichi_plume.agents.kernel_dm import KernelMap
from taichi_plume.engine import ti
from taichi_plume.grid.state import State
from taichi_plume.scenario import maps as map_models

pytestmark = pytest.mark.usefixtures("taichi")

DT, CELL, LAYER, HEIGHT = 0.5, 0.25, 0.4, 1.2
SHAPE = (8, 6, 3)
SENSOR = np.array([0.1, 0.2, 0.1, 0.1, 0.2, 0.1])


class Drones(Readers):
    """Robots that also jump up and down; their sensors sit at different heights over their feet."""

    flies = True

    def __init__(self, trials, count):
        super().__init__(trials, count)
        self.altitude = ti.field(ti.f32, trials * count)
        self.up = np.zeros(trials * count, np.float32)

    def wander(self):
        self.up = self.rng.uniform(0.0, 0.95, len(self.up)).astype(np.float32)
        self.altitude.from_numpy(self.up)
        super().wander()

    def rows(self, t):
        """As those on the floor, and the height of the sensor."""
        return np.column_stack([super().rows(t), self.up + SENSOR[: len(self.up)]])


def drones(seed, trials=TRIALS):
    return Drones(trials, COUNT).begin(seed)


def box(points):
    """A box that reaches from the floor to 0.7 m."""
    return np.max(np.abs(points - (1.1, 0.7, 0.0)) - (0.3, 0.3, 0.7), axis=-1)


def room(trials=TRIALS, **keys):
    return Floor(EXTENT, trials, COUNT + 1, DT, room=(*EXTENT, HEIGHT), sensor_height=SENSOR, **keys)


def made(kind, where=None, **keys):
    model, gas_map = {
        "gmrf": (map_models.MarkovMap, MarkovMap),
        "kernel_dmv": (map_models.KernelMap, KernelMap),
    }[kind]
    section = model.model_validate({"kind": kind, "cell": CELL, "layer": LAYER} | keys)
    return gas_map(section, where or room())


def cells():
    axes = [(np.arange(n) + 0.5) * edge for n, edge in zip(SHAPE, (CELL, CELL, LAYER), strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def cell_of(place):
    """Flat indices of the cells of points (n, 3)."""
    at = np.floor(place / (CELL, CELL, LAYER)).astype(int)
    return np.asarray(np.ravel_multi_index(tuple(np.minimum(at, np.array(SHAPE) - 1).T), SHAPE))


def dense_field(rows, now, obstacle, memory=60.0, window=1.0):
    place = cells()
    H, g = np.zeros((len(place), len(place))), np.zeros(len(place))
    for i, a in enumerate(place):
        for j in range(i + 1, len(place)):
            b = place[j]
            off = np.abs(a - b)
            if np.count_nonzero(off > 1e-9) != 1 or (off > np.array([CELL, CELL, LAYER]) * 1.01).any():
                continue
            if obstacle(a + np.linspace(0, 1, 101)[:, None] * (b - a)).min() > 0:
                weight = 0.01 * (CELL / LAYER) ** 2 if off[2] > 0 else 0.01
                H[[i, j], [i, j]] += weight
                H[[i, j], [j, i]] -= weight
    for row, n in zip(rows, cell_of(rows[:, [1, 2, 7]]), strict=True):
        precision = 10.0 * (1 - (now - np.ceil(row[6] / window) * window) / memory)
        H[n, n] += precision
        g[n] += precision * row[3]
    known = np.linalg.norm(H, axis=1) > 0
    inverse = np.full(H.shape, np.nan)
    inverse[np.ix_(known, known)] = np.linalg.inv(H[np.ix_(known, known)])
    mean = np.full(len(g), np.nan)
    mean[known] = inverse[np.ix_(known, known)] @ g[known]
    return mean.reshape(SHAPE), np.diag(inverse).reshape(SHAPE)


class AboveTheBox(Drones):
    """Drones that stay off the box, in which no robot measures."""

    def wander(self):
        super().wander()
        inside = box(cells()[cell_of(np.column_stack([self.believed, self.up + SENSOR]))]) <= 0
        self.where[inside] = 0.1
        self.show(self.where, self.readings.copy())


@pytest.mark.parametrize("obstacle", [None, box])
def test_a_markov_field_over_height_solves_the_dense_equations(obstacle):
    where = room() if obstacle is None else room(solid_distance=box)
    gas_map = made("gmrf", where)
    robots = AboveTheBox(TRIALS, COUNT).begin(3)
    rows = feed(gas_map, robots, 12, DT)
    for trial in range(TRIALS):
        free = obstacle or (lambda points: np.ones(points.shape[:-1]))
        mean, variance = dense_field(rows[rows[:, 0] == trial], 6.0, free)
        assert np.isnan(mean).sum() == (0 if obstacle is None else (box(cells()) <= 0).sum())
        same(gas_map.estimate()[trial], mean)
        same(gas_map.variance()[trial], variance)


def dense_kernel(rows, sigma, memory, gamma, sigma_omega=5.0):
    """Mean, variance and confidence by the Gaussian in 3-D; its axis over the height is sigma."""
    place = cells()
    age = np.exp(-(rows[:, 6].max() - rows[:, 6]) / memory)
    K = np.zeros((len(place), len(rows)))
    for n, row in enumerate(rows):
        speed = np.hypot(*row[4:6])
        a = sigma + gamma * speed
        e = row[4:6] / speed if speed > 0 else np.array([1.0, 0.0])
        d = place - row[[1, 2, 7]]
        along, across = d[:, :2] @ e, d[:, :2] @ np.array([-e[1], e[0]])
        q = (along / a) ** 2 + (across / (sigma**2 / a)) ** 2 + (d[:, 2] / sigma) ** 2
        K[:, n] = np.exp(-q / 2) * (q < 16) * age[n]
    total = K.sum(axis=1)
    trust = 1 - np.exp(-((total / sigma_omega) ** 2))
    safe = np.where(total > 0, total, np.nan)
    r0 = (age * rows[:, 3]).sum() / age.sum()
    mean = trust * (K @ rows[:, 3]) / safe + (1 - trust) * r0
    q = (rows[:, 3] - mean[cell_of(rows[:, [1, 2, 7]])]) ** 2
    variance = trust * (K @ q) / safe + (1 - trust) * (age * q).sum() / age.sum()
    return mean.reshape(SHAPE), variance.reshape(SHAPE), trust.reshape(SHAPE)


@pytest.mark.parametrize("keys", [{}, {"memory": 6.0, "wind_stretch": 0.3}], ids=["DM+V", "TD and W"])
def test_kernels_over_height_are_gaussians_in_3d(keys):
    gas_map = made("kernel_dmv", sigma=0.3, **keys)
    rows = feed(gas_map, drones(5), 40, DT)
    assert gas_map.estimate().shape == (TRIALS, *SHAPE)
    for trial in range(TRIALS):
        own = rows[rows[:, 0] == trial]
        mean, variance, trust = dense_kernel(
            own, 0.3, keys.get("memory", np.inf), keys.get("wind_stretch", 0.0)
        )
        same(gas_map.estimate()[trial], mean)
        same(gas_map.variance()[trial], variance)
        same(gas_map.weight()[trial], trust, 1e-4)


@pytest.mark.parametrize("kind", ["gmrf", "kernel_dmv"])
def test_a_map_of_one_layer_is_that_of_the_floor(kind):
    """Sensors are in its middle, where Gaussians over the height have their largest value."""
    flat = made(kind, layer=None)
    robots = drones(6)
    robots.flies = False
    layered = made(kind, replace(room(), sensor_height=np.full(6, HEIGHT / 2)), layer=HEIGHT)
    for tick in range(1, 9):
        robots.wander()
        for each in (layered, flat):
            each.update(robots, tick * DT, DT)
    np.testing.assert_array_equal(layered.estimate()[..., 0], flat.estimate())
    np.testing.assert_array_equal(layered.variance()[..., 0], flat.variance())


@pytest.mark.parametrize("kind", ["gmrf", "kernel_dmv"])
def test_constant_gas_gives_a_constant_map_between_the_heights(kind):
    """Readings below and above the layers do not count."""
    gas_map = made(kind, heights=(0.4, 0.8), layer=0.2)
    robots = drones(7)
    for tick in range(1, 9):
        robots.wander()
        z = robots.up + SENSOR
        robots.show(robots.where, np.where((z > 0.4) & (z < 0.8), 7.0, 99.0))
        gas_map.update(robots, tick * DT, DT)
    estimate = gas_map.estimate()
    assert estimate.shape == (TRIALS, 8, 6, 2)
    assert np.isfinite(estimate).mean() > 0.5
    np.testing.assert_allclose(estimate[np.isfinite(estimate)], 7.0, rtol=1e-5)


@pytest.mark.parametrize("kind", ["gmrf", "kernel_dmv"])
def test_a_restored_map_goes_on_as_before(kind):
    keys = {"exact": 8} if kind == "kernel_dmv" else {"memory": None}
    first, second = made(kind, **keys), made(kind, **keys)
    robots = drones(8)
    feed(first, robots, 9, DT)
    State(second).restore(State(first).save())
    for tick in range(10, 16):
        robots.wander()
        for gas_map in (first, second):
            gas_map.update(robots, tick * DT, DT)
    np.testing.assert_array_equal(second.estimate(), first.estimate())
    np.testing.assert_array_equal(second.variance(), first.variance())
