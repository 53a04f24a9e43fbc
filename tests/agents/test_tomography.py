"""Maps from lasers against dense least squares beam by beam, and in runs: plumes, sweeps, walls, odometry, resuming."""

from types import SimpleNamespace

import numpy as np
import pytest
from readers import COUNT, EXTENT, TRIALS, Stock, centers, same
from test_gmrf import CELL, DT, closed, floor, model, wall

from taichi_plume.agents.gas_map import nowhere
from taichi_plume.agents.mapping import mappers
from taichi_plume.agents.tomography import BeamMap, cell_shares
from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import ti
from taichi_plume.scenario.loading import ScenarioError, scenario_from
from taichi_plume.scoring import trials

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module")
def stock(taichi):
    return Stock()


class Beams:
    """Lasers of some robots, whose beams and readings are shown."""

    def __init__(self, robots, gives_mean=False):
        self.members = SimpleNamespace(robot=ti.filled(np.array(robots)))
        self.gives_mean = np.full(len(robots), gives_mean)
        self.beam_start, self.beam_way = (ti.vector_field(2, ti.f32, len(robots)) for _ in range(2))
        self.beam_is_new = ti.field(ti.i32, len(robots))

    def show(self, start, way, new=True):
        self.beam_start.from_numpy(np.asarray(start, np.float32))
        self.beam_way.from_numpy(np.asarray(way, np.float32))
        self.beam_is_new.from_numpy(np.full(len(start), int(new)))


def beam_map(lasers, obstacle=nowhere, trials=TRIALS, **keys):
    where = floor(obstacle, EXTENT, trials)
    (made,) = mappers([model(**keys)], type(where)(**vars(where) | {"lasers": lasers}))
    assert isinstance(made, BeamMap)
    return made


def slab_length(start, way, low, high):
    """Length of the part of a beam in a box, by the slab method."""
    near, far = 0.0, 1.0
    for x, d, a, b in zip(start, way, low, high, strict=True):
        if d == 0.0:
            if not a <= x < b:
                return 0.0
        else:
            ends = sorted([(a - x) / d, (b - x) / d])
            near, far = max(near, ends[0]), min(far, ends[1])
    return max(far - near, 0.0) * np.linalg.norm(way)


def literal(rows, values, weights, obstacle, lambda_p=0.01, lambda_o=10.0):
    """Mean and variance by least squares: a row for each link and each reading."""
    cells = np.rint(np.array(EXTENT) / CELL).astype(int)
    place = centers(cells, CELL)
    links = []
    for i, a in enumerate(place):
        for j, b in enumerate(place):
            between = a + np.linspace(0, 1, 101)[:, None] * (b - a)
            if i < j and np.hypot(*(a - b)) < 1.01 * CELL and obstacle(between).min() > 0:
                links.append(np.zeros(len(place)))
                links[-1][[i, j]] = np.sqrt(lambda_p) * np.array([1.0, -1.0])
    root = np.sqrt(lambda_o * np.asarray(weights))
    A = np.concatenate([links, root[:, None] * np.asarray(rows)])
    b = np.concatenate([np.zeros(len(links)), root * values])
    mean = np.linalg.lstsq(A, b, rcond=None)[0]
    return mean.reshape(cells), np.diag(np.linalg.pinv(A.T @ A, hermitian=True)).reshape(cells)


@pytest.mark.parametrize(
    ("obstacle", "keys", "mean"),
    [
        (nowhere, {}, 0),
        (wall, {"memory": 5.0, "window": 2.0, "lambda_prior": 0.3}, 1),
        (wall, {"memory": None}, 0),
    ],
)
def test_mean_and_variance_are_dense_least_squares(stock, obstacle, keys, mean):
    """Two lasers and a gas sensor at a point in each of two trials; the beams of a reading held are not counted."""
    rng = np.random.default_rng(4)
    robots, laser = stock.robots(2), np.array([0, 2, 3, 5])
    lasers = Beams(laser, bool(mean))
    gas_map = beam_map(lasers, obstacle, **keys)
    low = centers((8, 6), CELL) - CELL / 2
    rows, values, ends, whose = [], [], [], []
    for tick in range(1, 25):
        robots.wander()
        start = rng.uniform(0, EXTENT, (4, 2)).astype(np.float32)
        way = (rng.uniform(0, EXTENT, (4, 2)) - start).astype(np.float32)
        if tick % 5 == 0:
            way[0, 0] = 0.0
        lasers.show(start, way, new=tick % 3 != 0)
        gas_map.update(robots, tick * DT, DT)
        readings = robots.readings.astype(float)
        for n in range(TRIALS * COUNT):
            k = np.flatnonzero(laser == n)
            if len(k) and tick % 3 == 0:
                continue
            row = np.zeros(48)
            if len(k):
                begin, to = start[k[0]].astype(float), way[k[0]].astype(float)
                row[:] = [slab_length(begin, to, cell, cell + CELL) for cell in low]
                values.append(readings[n] * (np.linalg.norm(to) if mean else 1.0))
            else:
                i, j = np.minimum((robots.believed[n] // CELL).astype(int), (7, 5))
                row[i * 6 + j] = 1.0
                values.append(readings[n])
            rows.append(row)
            ends.append(tick * DT)
            whose.append(n // COUNT)
    window = keys.get("window", 1.0)
    age = 12.0 - np.ceil(np.array(ends) / window) * window
    memory = keys.get("memory", 60.0)
    weight = np.maximum(1 - age / memory, 0.0) if memory else np.ones(len(age))
    for trial in range(TRIALS):
        own = np.array(whose) == trial
        reference = literal(
            np.array(rows)[own], np.array(values)[own], weight[own], obstacle, keys.get("lambda_prior", 0.01)
        )
        same(gas_map.estimate()[trial], reference[0], 1e-4)
        same(gas_map.variance()[trial], reference[1], 1e-4)


def test_lengths_in_cells_sum_to_the_beam():
    rng = np.random.default_rng(1)
    start, end = rng.uniform(0, 2, (2, 50, 3))
    end[:10, 0] = start[:10, 0]
    beam, cell, share = cell_shares(start, end - start, (8, 8, 8), np.full(3, 0.25))
    np.testing.assert_allclose(np.bincount(beam, share), 1.0, rtol=1e-6)
    for n in (3, 30):
        for c, part in zip(cell[beam == n], share[beam == n], strict=True):
            corner = np.array(np.unravel_index(c, (8, 8, 8))) * 0.25
            length = slab_length(start[n], end[n] - start[n], corner, corner + 0.25)
            assert part * np.linalg.norm(end[n] - start[n]) == pytest.approx(length, abs=1e-6)


def test_constant_gas_gives_a_constant_map_on_one_side_of_a_wall(stock):
    lasers = Beams([0])
    gas_map = beam_map(lasers, closed, trials=1)
    robots = stock.robots(1, trials=1)
    way = np.array([[0.5, 0.9]], np.float32)
    lasers.show([[0.2, 0.3]], way)
    robots.show([[0.2, 0.3]], [7.0 * np.linalg.norm(way)])
    gas_map.update(robots, 1.0, DT)
    estimate = gas_map.estimate()[0]
    np.testing.assert_allclose(estimate[:4], 7.0, rtol=1e-5)
    assert np.isnan(estimate[4:]).all()
    assert (gas_map.weight()[0, 4:] == 0).all()


EXACT = {"kind": "tdlas", "species": "methane", "noise_ppm_m": 0, "detection_limit_ppm_m": 0, "rise_time": 0}
EXACT |= {"decay_time": 0, "sweep_deg": 100, "sweep_rate_deg": 40}


def scenario(sensor, **keys):
    source = {"position": [1.0, 1.6], "rate": 2e-6}
    return {
        "duration": 24.0,
        "tick": 0.1,
        "domain": {"size": [4.0, 3.0], "spacing": 0.05},
        "wind": {"kind": "uniform", "velocity": [0.4, 0.0]},
        "gas": {"species": "methane", "kind": "gaussian_plume", "intensity": 0.2, "sources": [source]},
        "robots": [
            {"name": "mappers", "count": 2, "trials": 2, "reach": 0, "algorithm": {"kind": "random_walk"},
             "start": {"kind": "area", "low": [0.3, 0.3], "high": [3.7, 2.7]}, "sensors": {"gas": sensor}},
        ],
        "maps": [
            {"kind": "gmrf", "cell": 0.2, "memory": None, "lambda_prior": 0.1, "lambda_observation": 1.0}
        ],
    } | keys  # fmt: skip


def made(sensor, **keys):
    sim = assemble(scenario_from(scenario(sensor, **keys)))
    sim.run()
    return sim


def error(sim):
    """Mean error of the two trials against the mean gas in the cells [ppm], and the correlation."""
    truth = trials.true_gas(sim, 0.2, (20, 15))
    score = trials.map_score(np.asarray(sim.maps[0].estimate()), truth)
    return score.mae.mean(), score.correlation.mean()


def test_beams_map_a_plume_better_than_sensors_at_points():
    with_beams, at_points = error(made(EXACT)), error(made({"kind": "ideal"}))
    assert with_beams[0] < 0.6 * at_points[0]
    assert with_beams[1] > at_points[1]


def test_mean_and_integral_give_the_same_map():
    integral, mean = made(EXACT, duration=6.0), made(EXACT | {"gives": "mean"}, duration=6.0)
    np.testing.assert_allclose(mean.maps[0].estimate(), integral.maps[0].estimate(), rtol=1e-3, atol=1e-3)


def test_maps_of_points_refuse_integrals():
    with pytest.raises(ScenarioError, match=r"maps\[0\]\.kind: kernel_dmv .* robots\[0\]"):
        assemble(scenario_from(scenario(EXACT, maps=[{"kind": "kernel_dmv"}])))


def test_too_many_cells_for_lasers_are_refused():
    with pytest.raises(ScenarioError, match=r"maps\[0\]\.cell: 0\.05 m makes 4,800 cells.*3,000.* 0\.0\d+ m"):
        assemble(scenario_from(scenario(EXACT, maps=[{"kind": "gmrf", "cell": 0.05}])))
