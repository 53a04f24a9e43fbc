"""The Markov field against a dense solution of its normal equations, and what obstacles and time do to it."""

import numpy as np
import pytest
from readers import COUNT, EXTENT, TRIALS, Stock, centers, feed, same

from taichi_plume.agents.gas_map import Floor, nowhere
from taichi_plume.agents.gmrf import MarkovMap
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.scenario import maps as map_models
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box
from taichi_plume.scenario.shapes import shape

pytestmark = pytest.mark.usefixtures("taichi")

DT, CELL = 0.5, 0.25


@pytest.fixture(scope="module")
def stock(taichi):
    return Stock()


def model(**keys):
    return map_models.MarkovMap.model_validate({"kind": "gmrf", "cell": CELL, **keys})


def floor(obstacle, extent=EXTENT, trials=1):
    return Floor(extent, trials, COUNT, DT, obstacle)


def wall(points):
    """A wall of 2 cm at x = 1 m, open above y = 1 m."""
    return np.maximum(np.abs(points[..., 0] - 1.0) - 0.01, points[..., 1] - 1.0)


def closed(points):
    """The same from end to end."""
    return np.abs(points[..., 0] - 1.0) - 0.01


def literal(rows, now, extent, obstacle, lambda_p=0.01, lambda_o=10.0, memory=60.0, window=1.0):
    """Mean and variance from a dense matrix, link by link and reading by reading."""
    cells = np.rint(np.array(extent) / CELL).astype(int)
    place = centers(cells, CELL)
    H, g = np.zeros((len(place), len(place))), np.zeros(len(place))
    for i, a in enumerate(place):
        for j, b in enumerate(place):
            between = a + np.linspace(0, 1, 101)[:, None] * (b - a)
            if i < j and np.hypot(*(a - b)) < 1.01 * CELL and obstacle(between).min() > 0:
                H[[i, j], [i, j]] += lambda_p
                H[[i, j], [j, i]] -= lambda_p
    for row in rows:
        age = now - np.ceil(row[6] / window) * window
        precision = lambda_o * (1 - age / memory)
        if precision > 0:
            i, j = np.minimum((row[1:3] // CELL).astype(int), cells - 1)
            H[i * cells[1] + j, i * cells[1] + j] += precision
            g[i * cells[1] + j] += precision * row[3]
    inverse = np.linalg.inv(H)
    return (inverse @ g).reshape(cells), np.diag(inverse).reshape(cells)


@pytest.mark.parametrize("extent", [(2.0, 1.5), (1.0, 2.25)], ids=["long", "high"])
@pytest.mark.parametrize(
    ("keys", "obstacle"),
    [({}, nowhere), ({"memory": 5.0, "window": 2.0, "lambda_prior": 0.3}, wall), ({"memory": None}, wall)],
)
def test_mean_and_variance_solve_the_normal_equations(stock, extent, keys, obstacle):
    gas_map = stock.map(MarkovMap, model(**keys), floor=floor(obstacle, extent, TRIALS))
    rows = feed(gas_map, stock.robots(2, extent=extent), 24, DT)
    keys = {name.replace("prior", "p"): np.inf if value is None else value for name, value in keys.items()}
    for trial in range(TRIALS):
        mean, variance = literal(rows[rows[:, 0] == trial], 12.0, extent, obstacle, **keys)
        same(gas_map.estimate()[trial], mean)
        same(gas_map.variance()[trial], variance)
        same(gas_map.weight()[trial], 1 / variance)


def test_columns_of_the_covariance_are_those_of_the_dense_inverse(stock):
    """Behind the closed wall of the second trial nothing is known, and the covariance with it is zero."""
    gas_map = stock.map(MarkovMap, model(), floor=floor(closed, trials=2))
    robots = stock.robots(1, trials=2, count=1)
    robots.show([[0.2, 0.3], [1.6, 1.2]], [10.0, 30.0])
    gas_map.update(robots, 1.0, DT)
    cells = np.array([0, 7, 20])
    columns = gas_map.covariance(0, cells)
    known = np.isfinite(gas_map.estimate()[0])
    assert known.ravel()[cells].all()
    np.testing.assert_allclose(columns[cells, range(3)], gas_map.variance()[0].ravel()[cells], rtol=1e-6)
    np.testing.assert_allclose(columns[~known.ravel()], 0.0)
    H = np.zeros((24, 24))
    for i, j in np.ndindex(4, 6):
        for a, b in ((i + 1, j), (i, j + 1)):
            if a < 4 and b < 6:
                n, m = i * 6 + j, a * 6 + b
                H[[n, m], [n, m]] += 0.01
                H[[n, m], [m, n]] -= 0.01
    H[1, 1] += 10.0  # the reading at (0.2, 0.3)
    np.testing.assert_allclose(columns[:24], np.linalg.inv(H)[:, cells], rtol=1e-6)


def test_behind_a_wall_nowhere_is_known(stock):
    gas_map = MarkovMap(model(), floor(closed))
    robots = stock.robots(1, trials=1)
    robots.show([[0.2, 0.3], [0.6, 1.2]], [10.0, 30.0])
    gas_map.update(robots, 1.0, DT)
    known = np.isfinite(gas_map.estimate()[0])
    assert known[:4].all()
    assert not known[4:].any()
    assert (gas_map.weight()[0][4:] == 0).all()
    assert ((gas_map.estimate()[0][:4] > 9.9) & (gas_map.estimate()[0][:4] < 30.1)).all()


def test_a_reading_beside_an_obstacle_counts(stock):
    """Its cell's centre is inside the box: the next free cell takes it."""

    def box(points):
        return np.abs(points - (1.125, 0.625)).max(axis=-1) - 0.2

    gas_map = MarkovMap(model(), floor(box))
    robots = stock.robots(1, trials=1)
    robots.show([[1.235, 0.84]], [7.0])
    gas_map.update(robots, 1.0, DT)
    mean, variance = gas_map.estimate()[0], gas_map.variance()[0]
    assert np.isfinite(mean).sum() == 47
    assert np.nanargmin(variance) == np.ravel_multi_index((4, 3), (8, 6))


def test_readings_are_forgotten(stock):
    gas_map = MarkovMap(model(memory=10.0), floor(nowhere))
    robots = stock.robots(1, trials=1)
    robots.wander()
    gas_map.update(robots, 1.0, DT)
    early = gas_map.variance()
    robots.show(robots.where, [np.nan] * 3)
    gas_map.update(robots, 6.0, DT)
    assert np.isfinite(gas_map.estimate()).all()
    assert (gas_map.variance() > early).all()
    gas_map.update(robots, 11.0, DT)
    assert np.isnan(gas_map.estimate()).all()
    assert not gas_map.past


def test_obstacles_of_a_scenario_cut_the_links(stock):
    """A box over four cells: they are unknown, and all around them is not."""
    box = Box(kind="box", center=(1.0, 0.75), size=(0.6, 0.6))
    arena = ClearanceMap([shape(box, Domain(size=EXTENT, spacing=0.05), None)], EXTENT, 0.1)  # type: ignore[arg-type]
    gas_map = MarkovMap(model(), floor(arena.obstacle_distance_at))
    robots = stock.robots(1, trials=1)
    robots.show([[0.1, 0.1]], [7.0])
    gas_map.update(robots, 1.0, DT)
    unknown = np.isnan(gas_map.estimate()[0])
    inside = np.abs(centers((8, 6), CELL) - (1.0, 0.75)).max(axis=1).reshape(8, 6) < 0.3
    assert inside.sum() == 4
    assert (unknown == inside).all()
    np.testing.assert_allclose(gas_map.estimate()[0][~unknown], 7.0, rtol=1e-6)
