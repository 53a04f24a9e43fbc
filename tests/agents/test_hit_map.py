"""The hit map: ways around walls against Dijkstra's, what a measurement tells, and a search on a floor with a wall."""

import numpy as np
import pytest
from arena import Run, Script
from scipy.sparse import csgraph, lil_matrix

from taichi_plume.agents.shortest_paths import FAR, Ways
from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario.belief_algorithms import HitMap
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box
from taichi_plume.scenario.shapes import shape

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SIZE = (3.0, 2.2)
CELL = 0.2
WALL = (1.48, 1.52, 0.6)  # from x to x [m], from y = 0 on but for the upper 0.6 m: thinner than a cell


def wall():
    """Thin, across the floor but for a gap at the top."""
    high = SIZE[1] - WALL[2]
    box = Box(kind="box", center=(1.5, high / 2), size=(WALL[1] - WALL[0], high))
    return shape(box, Domain(size=SIZE, spacing=0.1), None)  # type: ignore[arg-type]


def middles():
    x, y = (np.arange(round(length / CELL)) for length in SIZE)
    return CELL * (np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2) + 0.5)


def crosses(p, q, room):
    """Whether the straight way from p to q meets the wall, made wider by `room` on all sides."""
    (a, b), top = (WALL[0] - room, WALL[1] + room), SIZE[1] - WALL[2] + room
    if p[0] == q[0]:
        return a < p[0] < b and min(p[1], q[1]) < top
    s = np.clip([(a - p[0]) / (q[0] - p[0]), (b - p[0]) / (q[0] - p[0])], 0, 1)
    y = p[1] + s * (q[1] - p[1])
    return s[0] != s[1] and min(y) < top


@pytest.fixture(scope="module")
def ways(taichi):
    return Ways(ClearanceMap([wall()], SIZE, 0.1, resolution=0.01), CELL, 0.0)


def test_ways_lead_around_a_thin_wall(ways):
    """The lengths are those of Dijkstra's algorithm on the cells that see each other, in f64; a little longer at most
    where a way bends.
    """
    places = middles()
    length, via = ways.length.to_numpy(), ways.via.to_numpy()
    n = len(places)
    assert length.shape == (n, n)
    graph = lil_matrix((n, n))
    seen = np.zeros((n, n), bool)
    for a in range(n):
        for b in range(n):
            seen[a, b] = not crosses(places[a], places[b], 0.0)
            if a != b and seen[a, b]:
                graph[a, b] = np.linalg.norm(places[a] - places[b])
    exact = csgraph.dijkstra(graph.tocsr())
    free = ways.free.to_numpy() == 1
    assert 0 < (~free).sum() < 12, "the lower cells of one column"
    assert (length[~free] == FAR).all()
    exact, length, via, places = exact[free][:, free], length[free][:, free], via[free][:, free], places[free]
    cells = middles()
    clear = np.array([[not crosses(p, q, 0.02) for q in places] for p in places])
    straight = np.linalg.norm(places[:, None] - places, axis=-1)
    np.testing.assert_allclose(length[clear], straight[clear], atol=1e-5)
    assert (length >= exact - 1e-4).all()
    assert (length < FAR).all()
    assert (length <= 1.09 * exact + 2 * CELL).all(), "eight directions, and corners of cells"
    left, right = places[:, 0] < 1.4, places[:, 0] > 1.6
    low = places[:, 1] < 1.0
    behind = np.ix_(left & low, right & low)
    assert (length[behind] > straight[behind] + 0.2).all()
    # the begin of such a way leads up to the gap
    assert (cells[via[behind], 1] > 1.4).all()
    np.testing.assert_allclose(length, length.T, rtol=0.06, atol=0.1)


def test_what_has_no_room_has_no_way():
    ways = Ways(ClearanceMap([wall()], SIZE, 0.1, resolution=0.01), CELL, 0.35)
    places = middles()
    length, free = ways.length.to_numpy(), ways.free.to_numpy()
    left, right = places[:, 0] < 1.4, places[:, 0] > 1.6
    assert free.any()
    assert not free.all()
    assert (length[np.ix_(left, right)] == FAR).all(), "a gap of 0.6 m is too narrow for 0.35 m on both sides"
    ways = Ways(ways.clearance, CELL, 0.2)
    assert (ways.length.to_numpy()[np.ix_(left, right)] < FAR).any()


MODEL = HitMap(kind="hit_map", cell=CELL, acquisition=1.0, settle=0.2)


class Learns:
    """Lets robot 0 learn of a measurement in a cell, of all the same beliefs."""

    def __init__(self, run):
        self.run, self.algorithm = run, run.algorithm

    @ti.kernel
    def _tell(self, x: float, y: float, hit: bool, u: float, v: float):
        for _n in range(1):
            self.algorithm._forget(0)
            readings = self.algorithm.readings
            readings.place[0], readings.value[0] = ti.Vector([x, y]), ti.cast(hit, ti.f32)
            readings.wind[0] = ti.Vector([u, v])
            self.algorithm._learn(0, 0)

    def tell(self, place, hit, wind):
        self._tell(*place, hit, *wind)  # type: ignore
        return self.algorithm.beliefs()[0]


@pytest.fixture(scope="module")
def walled(taichi):
    run = Run(
        MODEL, Script([0.0], 1.0), positions=((2.3, 0.5),), size=SIZE, obstacles=[wall()], found="declared"
    )
    return Learns(run)


@pytest.fixture(scope="module")
def empty(taichi):
    run = Run(MODEL, Script([0.0], 1.0), positions=((1.5, 1.1),), size=SIZE, found="declared")
    return Learns(run)


@pytest.mark.parametrize("hit", [True, False])
def test_a_measurement_tells_the_same_on_both_sides_of_the_wind(empty, hit):
    """In the middle row of cells, the wind along it; and so turned by 180°. The mass stays 1."""
    belief = empty.tell((2.1, 1.1), hit, (0.5, 0.0))
    assert belief.sum() == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(belief, belief[:, ::-1], rtol=1e-4)
    np.testing.assert_allclose(empty.tell((0.9, 1.1), hit, (-0.5, 0.0)), belief[::-1], rtol=1e-4)
    upwind, downwind = belief[7, 5], belief[13, 5]
    assert upwind > 3 * downwind if hit else upwind < 0.5 * downwind


def test_what_a_hit_tells_is_the_formula(empty):
    """In an empty room ways are straight lines, and their begin tells the angle."""
    places = middles().reshape(15, 11, 2)
    x = places[12, 6]
    wind = np.array([0.4, 0.1])
    belief = empty.tell(x, True, wind)
    apart = places - x
    way = np.linalg.norm(apart, axis=-1)
    with np.errstate(invalid="ignore"):
        angle = np.arccos(np.clip(-(apart @ wind) / (way * np.linalg.norm(wind)), -1, 1))
    angle = np.nan_to_num(angle)
    with np.errstate(divide="ignore"):
        variance = np.radians(MODEL.spread_deg) ** 2 + CELL**2 / 6 / way**2
    share = np.exp(-(angle**2) / (2 * variance) - way / MODEL.fading)
    share = np.maximum(share, np.exp(-(way**2) / (2 * MODEL.near**2)))
    expected = MODEL.false_alarm + (MODEL.hit - MODEL.false_alarm) * share
    np.testing.assert_allclose(belief, expected / expected.sum(), rtol=2e-3)


def test_in_calm_air_only_the_distance_counts(empty):
    belief = empty.tell((1.5, 1.1), True, (0.01, 0.0))
    np.testing.assert_allclose(belief, belief[::-1], rtol=1e-4)
    assert belief[7, 5] == belief.max()


def test_evidence_goes_around_the_wall(walled, empty):
    """Wind blows at the wall from behind it: gas at its lee came by the gap, if from there at all."""
    belief = walled.tell((1.7, 0.5), True, (0.5, 0.0))
    assert belief.sum() == pytest.approx(1.0, abs=1e-5)
    places = middles().reshape(15, 11, 2)
    behind = (places[..., 0] < 1.4) & (places[..., 1] < 1.0)
    without = empty.tell((1.7, 0.5), True, (0.5, 0.0))
    straight = np.abs(places[..., 1] - 0.5) < 0.1
    assert (belief < 0.6 * without)[behind & straight].all(), "what is upwind but for the wall is unlikely"
    # in the wind along the wall, from the gap, it is not
    here, there = 8 * 11 + 2, 5 * 11 + 2
    assert middles()[[here, there]] == pytest.approx(np.array([(1.7, 0.5), (1.1, 0.5)]))
    across = chance(walled.algorithm, here, there, 0.5, 0.0)
    assert across < 0.15 < 0.4 < chance(walled.algorithm, here, there, 0.0, -0.5)


def test_a_miss_makes_upwind_less_likely(walled):
    belief = walled.tell((2.5, 1.9), False, (0.5, 0.0))
    assert belief[10, 9] < 1.0 / belief.size < belief[14, 2]


@ti.kernel
def information(algorithm: Template, c: int, u: float, v: float) -> float:
    return algorithm._information(0, c, ti.Vector([u, v]))


@ti.kernel
def chance(algorithm: Template, c: int, b: int, u: float, v: float) -> float:
    return algorithm._chance(0, c, b, ti.Vector([u, v]))


def test_expected_information_is_the_mean_fall_of_entropy(empty):
    belief = empty.tell((2.1, 1.1), True, (0.5, 0.0)).ravel().astype(float)
    algorithm = empty.algorithm

    def entropy(p):
        return -(p * np.log(np.maximum(p, 1e-300))).sum()

    for c in (40, 60):
        hits = np.array([chance(algorithm, c, b, 0.5, 0.0) for b in range(belief.size)])
        hit = (belief * hits).sum()
        left = hit * entropy(belief * hits / hit) + (1 - hit) * entropy(belief * (1 - hits) / (1 - hit))
        assert information(algorithm, c, 0.5, 0.0) == pytest.approx(
            entropy(belief) - left, rel=1e-3, abs=1e-5
        )


class Whiffs(Script):
    """Gas that comes in whiffs of a second, downwind of a source behind the wall and through the gap."""

    @ti.func
    def ppm(self, x, t):
        near = ti.abs(x[1] - 1.9) < 0.05 + 0.15 * ti.max(x[0] - 0.5, 0.0) and x[0] > 0.5
        where = ti.cast(x[0] * 1e4, ti.i32) + 40000 * ti.cast(x[1] * 1e4, ti.i32)
        u = uniform4(ti.u32(1), ti.u32(2), where, ti.cast(t, ti.i32), 0)
        return ti.Vector([ti.select(near and u[0] < 0.8, 100.0, 0.0)])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([0.5, 0.0])


def test_it_finds_and_declares_a_source_behind_a_wall():
    source = (0.5, 1.9)
    rivals = [{"algorithm": MODEL, "found": found, "trials": 30} for found in ("reached", "declared")]
    keys = {"size": SIZE, "obstacles": [wall()], "sources": [source], "reach": 0.3}
    run = Run(rivals, Whiffs([0.0], 1.0), ((2.6, 0.5),), **keys)
    run.go(240)
    now = run.swarm.snapshot()
    assert now["found"][run.of(0)].mean() >= 0.9
    declared = now["declared_position"][run.of(1)]
    assert now["declarations"][run.of(1)].mean() >= 0.7
    assert np.nanmedian(np.linalg.norm(declared - source, axis=-1)) < 0.6, "a few cells"


def test_a_search_that_is_over_learns_no_more(empty):
    run = empty.run
    run.begin(MODEL)
    run.go(2.0)
    before, belief = run.swarm.snapshot(), empty.algorithm.beliefs()
    assert before["acquisitions"] == 1
    assert belief.max() > belief.min()
    run.swarm.declarations.fill(1)
    run.go(4.0)
    assert run.swarm.snapshot()["acquisitions"] == 1
    np.testing.assert_array_equal(empty.algorithm.beliefs(), belief)


def test_where_no_cell_is_free_all_are_as_probable(empty):
    """As where something stands in the middle of each; the robot waits, and believes what it did."""
    run = empty.run
    run.gas.tell([9.0], 1.0)
    run.begin(MODEL)
    algorithm = run.algorithm
    algorithm.gas.free.fill(0)
    algorithm._start_all()
    run.go(1.5)
    np.testing.assert_allclose(algorithm.beliefs(), 1.0 / algorithm.beliefs()[0].size)
    assert run.swarm.snapshot()["path_length"] == 0.0
