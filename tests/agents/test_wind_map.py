"""Wind map against dense normal equations, uniform flow in an empty room, and the flux through a narrowing."""

import numpy as np
import pytest
from readers import COUNT, EXTENT, TRIALS, Stock, centers, feed, same
from saved import assert_goes_on

from taichi_plume.agents.gas_map import Floor, nowhere
from taichi_plume.agents.wind_map import TINY, FloorWind, WindMap
from taichi_plume.scenario import maps as map_models

pytestmark = pytest.mark.usefixtures("taichi")

DT, CELL = 0.5, 0.25


@pytest.fixture(scope="module")
def stock(taichi):
    return Stock()


def model(**keys):
    return map_models.WindMap.model_validate({"kind": "wind_gmrf", "cell": CELL, **keys})


def wall(points):
    """A wall of 2 cm at x = 1 m, open above y = 1 m."""
    return np.maximum(np.abs(points[..., 0] - 1.0) - 0.01, points[..., 1] - 1.0)


def box(points):
    return np.abs(points - (1.1, 0.6)).max(axis=-1) - 0.2


def only_along_x(axis, side, place, cell):
    return np.full(len(place), axis == 0)


def literal(rows, now, extent, obstacle, edge, memory=None, window=1.0, p=10.0, m=1000.0, o=10.0):
    """Mean and variance of the cells from a dense matrix over all faces, face by face and reading by reading."""
    nx, ny = cells = np.rint(np.array(extent) / CELL).astype(int)
    place = centers(cells, CELL).reshape(nx, ny, 2)
    free = obstacle(place) > 0
    faces = {("u", i, j): None for i in range(nx + 1) for j in range(ny)}
    faces |= {("v", i, j): None for i in range(nx) for j in range(ny + 1)}
    number = {face: n for n, face in enumerate(faces)}

    def joined(a, b):
        if not all(0 <= i < n for c in (a, b) for i, n in zip(c, cells, strict=True)):
            return False
        way = place[a] + np.linspace(0, 1, 101)[:, None] * (place[b] - place[a])
        return obstacle(way).min() > 0

    def is_open(face):
        kind, i, j = face
        a, b = ((i - 1, j), (i, j)) if kind == "u" else ((i, j - 1), (i, j))
        axis, k = ("uv".index(kind), i if kind == "u" else j)
        if 0 < k < cells[axis]:
            return joined(a, b)
        inside = b if k == 0 else a
        return bool(edge(axis, int(k > 0), np.zeros(1), CELL)[0] and free[inside])

    H, g = TINY * p * np.eye(len(faces)), np.zeros(len(faces))

    def add(terms, weight, value=0.0):
        row = np.zeros(len(faces))
        for face, factor in terms:
            row[number[face]] += factor
        H[:] += weight * np.outer(row, row)
        g[:] += weight * value * row

    for i in range(nx):
        for j in range(ny):
            if free[i, j]:
                ends = [("u", i, j), ("u", i + 1, j), ("v", i, j), ("v", i, j + 1)]
                add([(ends[0], -1), (ends[1], 1)], p)
                add([(ends[2], -1), (ends[3], 1)], p)
                add(list(zip(ends, (-1, 1, -1, 1), strict=True)), m)
    for kind, i, j in faces:
        other = (kind, i, j + 1) if kind == "u" else (kind, i + 1, j)
        if other in number and is_open((kind, i, j)) and is_open(other):
            sides = [(i - 1, j), (i, j)] if kind == "u" else [(i, j - 1), (i, j)]
            step = (0, 1) if kind == "u" else (1, 0)
            if any(joined(side, (side[0] + step[0], side[1] + step[1])) for side in sides):
                add([((kind, i, j), 1), (other, -1)], p)
    for row in rows:
        age = now - np.ceil(row[6] / window) * window
        precision = o * (1 - age / memory) if memory else o
        if precision > 0 and row[4:6].any():
            at = np.minimum((row[1:3] // CELL).astype(int), cells - 1)
            if not free[tuple(at)]:
                at = min(np.argwhere(free), key=lambda c: np.hypot(*(c - at)))
            i, j = at
            add([(("u", i, j), 0.5), (("u", i + 1, j), 0.5)], precision, row[4])
            add([(("v", i, j), 0.5), (("v", i, j + 1), 0.5)], precision, row[5])
    kept = np.array([is_open(face) for face in faces])
    inverse = np.zeros_like(H)
    inverse[np.ix_(kept, kept)] = np.linalg.inv(H[np.ix_(kept, kept)])
    mean, variance = np.full((nx, ny, 2), np.nan), np.full((nx, ny, 2), np.nan)
    for i, j in np.argwhere(free):
        for axis, ends in enumerate(([("u", i, j), ("u", i + 1, j)], [("v", i, j), ("v", i, j + 1)])):
            row = np.zeros(len(faces))
            row[[number[face] for face in ends]] = 0.5
            mean[i, j, axis], variance[i, j, axis] = row @ inverse @ g, row @ inverse @ row
    return mean, variance


@pytest.mark.parametrize("extent", [(2.0, 1.5), (1.5, 2.0)], ids=["long", "high"])
@pytest.mark.parametrize(
    ("keys", "obstacle", "edge"),
    [
        ({}, nowhere, lambda axis, side, place, cell: np.ones(len(place), bool)),
        ({"memory": 5.0, "window": 2.0}, wall, only_along_x),
        ({"lambda_prior": 1.0, "lambda_mass": 50.0, "lambda_observation": 3.0}, box, only_along_x),
    ],
    ids=["open", "wall", "box"],
)
def test_mean_and_variance_solve_the_normal_equations(stock, extent, keys, obstacle, edge):
    wind_map = stock.map(WindMap, model(**keys), Floor(extent, TRIALS, COUNT, DT, obstacle, edge))
    rows = feed(wind_map, stock.robots(2, extent=extent), 16, DT)
    keys = {
        name.removeprefix("lambda_")[: 1 if "lambda" in name else None]: value for name, value in keys.items()
    }
    for trial in range(TRIALS):
        mean, variance = literal(rows[rows[:, 0] == trial], 8.0, extent, obstacle, edge, **keys)
        same(wind_map.estimate()[trial], mean, 1e-4)
        same(wind_map.variance()[trial], variance)
        np.testing.assert_allclose(wind_map.weight()[trial] > 0, np.isfinite(mean[..., 0]))


def test_a_reading_in_an_empty_room_is_the_wind_everywhere():
    mean, variance = FloorWind(EXTENT, CELL).solve(np.array([[0.6, 0.4]]), np.array([[0.3, -0.1]]))
    np.testing.assert_allclose(mean, np.broadcast_to([0.3, -0.1], mean.shape), rtol=1e-3)
    assert np.unravel_index(variance[..., 0].argmin(), variance.shape[:2]) == (2, 1)
    np.testing.assert_allclose(variance[2, 1], 0.1, rtol=2e-3)  # that of a reading, 1 / lambda_observation


def test_the_flux_through_a_narrowing_is_conserved():
    """A channel of 1 m with a gap of 0.4 m: all that flows in at one end leaves at the other."""

    def gap(points):  # positive in the air
        return np.maximum(np.abs(points[..., 0] - 2.0) - 0.25, 0.2 - np.abs(points[..., 1] - 0.5))

    place = np.array([[0.45, 0.05 + 0.1 * j] for j in range(10)])
    wind = np.tile([0.2, 0.0], (10, 1))
    field = FloorWind((4.0, 1.0), 0.1, gap, only_along_x, prior=1e-3, mass=1e4)
    mean, _ = field.solve(place, wind)
    flux = 0.1 * np.nansum(mean[..., 0], axis=1)
    np.testing.assert_allclose(flux, flux.mean(), rtol=1e-3)
    np.testing.assert_allclose(flux.mean(), 0.2, rtol=0.02)
    narrow = np.nanmean(mean[20, :, 0])
    np.testing.assert_allclose(narrow, flux.mean() / 0.4, rtol=1e-3)
    assert np.isnan(mean[20]).all(axis=-1).sum() == 6


def test_trials_are_separate_and_behind_a_wall_nothing_is_known(stock):
    def closed(points):
        return np.abs(points[..., 0] - 1.0) - 0.01

    wind_map = WindMap(model(), Floor(EXTENT, 2, COUNT, DT, closed))
    robots = stock.robots(1, trials=2, count=1)
    robots.felt, robots.known = np.array([[0.4, 0.0], [0.0, -0.2]], np.float32), np.ones(2, np.int32)
    robots.show([[0.2, 0.3], [1.6, 1.2]], [0.0, 0.0])
    wind_map.update(robots, 1.0, DT)
    known = np.isfinite(wind_map.estimate()[..., 0])
    assert known[0, :4].all()
    assert known[1, 4:].all()
    assert known.sum() == 2 * 24
    for trial, place in enumerate(robots.believed):
        field = FloorWind(EXTENT, CELL, closed)
        alone, _ = field.solve(place[None], robots.felt[trial][None])
        np.testing.assert_allclose(field.mean(place[None], robots.felt[trial][None]), alone, atol=1e-7)
        np.testing.assert_allclose(wind_map.estimate()[trial], alone, rtol=1e-6)
    robots.known = np.zeros(2, np.int32)  # calm below the threshold of the anemometers
    robots.show([[0.2, 0.3], [1.6, 1.2]], [0.0, 0.0])
    before = wind_map.estimate()
    wind_map.update(robots, 2.0, DT)
    np.testing.assert_array_equal(wind_map.estimate(), before)


def test_a_map_goes_on_from_a_saved_state(stock):
    """Within a window and with readings that fade; in between the map takes in other winds."""
    wind_map = stock.map(WindMap, model(memory=6.0, window=2.0), Floor(EXTENT, TRIALS, COUNT, DT))

    def play(first, last):
        robots = stock.robots(first)
        for tick in range(3 * first + 1, 3 * last + 1):
            robots.wander()
            wind_map.update(robots, tick * DT, DT)
        return wind_map.estimate(), wind_map.variance()

    assert_goes_on(wind_map, play)
