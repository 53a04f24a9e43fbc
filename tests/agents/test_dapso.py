"""DAPSO: its rules against closed forms and statistics, and whether a team climbs a hill of gas."""

import numpy as np
import pytest
from arena import LONGEST, TICK, Run, Script

from taichi_plume.agents.dapso import DRIVE, EXPLORE, MEASURE, constriction
from taichi_plume.engine import ti
from taichi_plume.scenario.robots import Communication
from taichi_plume.scenario.team_algorithms import Dapso, FunctionValue, RandomMates, SearchSpace

pytestmark = pytest.mark.usefixtures("taichi")

TOP = (3.0, 2.2)
CORNER = ((0.4, 0.4), (0.8, 0.4), (0.4, 0.8), (0.8, 0.8), (1.2, 0.4))
FLOOR = (4.0, 3.0)
ROOM = 0.085 + 0.2  # radius and avoidance


COOPERATE = [  # and whether they do
    (Communication(range=None), True),
    (Communication(range=None, loss=1.0), False),
    (Communication(range=0.1), False),
]
NEIGHBOURS = [  # and to whom robot 0 listens then, in `test_neighbourhoods`
    (SearchSpace(kind="search_space", distance=0.5), {1}),
    (SearchSpace(kind="search_space", distance=5), {1, 2, 3, 4}),
    (FunctionValue(kind="function_value", number=1), {3}),
    (FunctionValue(kind="function_value", number=3), {1, 3, 4}),
    (RandomMates(kind="random", probability=1), {1, 2, 3, 4}),
    (RandomMates(kind="random", probability=0), set()),
    (RandomMates(kind="random", probability=0.3), None),
]
MEMORIES = [(10.0, True), (0, False)]  # s, and whether a lower reading is taken in the end
ALONE = {"communication": Communication(range=None), "reach": 0}


class Hill(Script):
    """With `is_hill` a peak of ethanol at TOP, Gaussian with a width of 1 m, as high as the script tells."""

    def __init__(self, ppm, every, is_hill=1):
        super().__init__(ppm, every)
        self.is_hill = ti.field(ti.i32, ())
        self.is_hill[None] = is_hill

    @ti.func
    def ppm(self, x, t):
        k = ti.cast(ti.floor(t / self.every[None] + 1e-3), ti.i32)
        apart = ti.Vector([x[0] - TOP[0], x[1] - TOP[1]])
        shape = ti.select(self.is_hill[None] == 1, ti.exp(-0.5 * apart.dot(apart)), 1.0)
        return ti.Vector([self.table[ti.min(k, LONGEST - 1)] * shape])


def quick(**keys):
    """A model that hardly stops to measure, nor looks for gas."""
    short = {"acquisition": 0.5, "settle": 0, "way_point_tolerance": 0.005, "threshold_ppm": 0}
    return Dapso(kind="dapso", **short, **keys)


RIVALS = {
    **{
        f"cooperate {n}": {"positions": CORNER, "trials": 4, "communication": communication}
        for n, (communication, _) in enumerate(COOPERATE)
    },
    **{
        f"neighbours {n}": {
            "positions": CORNER,
            "algorithm": Dapso(kind="dapso", neighbourhood=neighbourhood, memory=0),
        }
        for n, (neighbourhood, _) in enumerate(NEIGHBOURS)
    },
    **{f"memory {n}": {"algorithm": quick(memory=memory)} for n, (memory, _) in enumerate(MEMORIES)},
    "measures": {"algorithm": Dapso(kind="dapso", acquisition=2.0, settle=1.0)},
    "restarts": {
        "algorithm": quick(phi1=0, phi2=0, kappa=0.1, restart_step=0.055),
        "positions": ((2.0, 1.5),),
        "trials": 100,
    },
    "climbs": {"positions": ((2.0, 1.4),), "trials": 20},
    "explores": {"positions": ((2.0, 1.5),), "trials": 40},
}
GROUPS = [{"algorithm": Dapso(kind="dapso")} | rival for rival in RIVALS.values()]


@pytest.fixture(scope="module")
def rivals(taichi):
    """Teams on FLOOR that neither see nor touch each other; `begin` lets all of them start anew."""
    return Run(GROUPS, Hill([1.0], 1.0), size=FLOOR, **ALONE)


def begin(run, ppm, every, is_hill=0):
    run.gas.tell(ppm, every)
    run.gas.is_hill[None] = is_hill
    run.begin(GROUPS)


def of(run, name):
    """The robots of a rival."""
    return run.of(list(RIVALS).index(name))


def way_points(run, seconds):
    """Those of each update, per robot, with where the robot stood: (updates, 2, 2)."""
    seen = [[] for _ in range(run.swarm.count)]
    fields = run.swarm.state, run.swarm.position, run.algorithm.way_point
    before, places, _ = (field.to_numpy() for field in fields)
    for _ in range(round(seconds / TICK)):
        run.step()
        now, moved, goals = (field.to_numpy() for field in fields)
        for n in np.flatnonzero((before == MEASURE) & (now == DRIVE)):
            seen[n].append((places[n], goals[n]))
        before, places = now, moved
    return [np.array(one) for one in seen]


def test_constriction():
    """Roots of z² - (1 + chi - chi phi) z + chi: their size is the root of chi where they are complex."""
    assert constriction(4.1) == pytest.approx(0.7298437881, abs=1e-9)
    assert constriction(5.0, 0.5) == pytest.approx(0.5 * constriction(5.0))
    assert [constriction(phi, 0.8) for phi in (0.0, 2.0, 4.0)] == pytest.approx([0.8] * 3)
    for phi in (4.1, 5.0, 8.0):
        chi = constriction(phi)
        assert np.abs(np.roots([1, -(1 + chi - chi * phi), chi])).max() == pytest.approx(chi**0.5)


@pytest.fixture(scope="module")
def wide(taichi):
    """8 robots without pulls, and 400, in 10 x 10 m; in each test gas that both need or that the others do not mind."""
    rivals = [
        {"algorithm": quick(phi1=0, phi2=0, kappa=0.6, restart_after=0), "trials": 8},
        {"algorithm": quick(memory=0, restart_after=0), "trials": 400},
    ]
    run = Run(rivals, Script([9.0, 0.0], 0.6), ((5, 5),), size=(10.0, 10.0), reach=0)
    seen = way_points(run, 15)
    return [seen[run.of(n)] for n in range(2)]


def test_without_pulls_each_step_is_a_share_of_the_last(wide):
    for seen in wide[0]:
        steps = seen[:4, 1] - seen[:4, 0]
        lengths = np.linalg.norm(steps, axis=1)
        assert (lengths <= 0.5).all()
        assert lengths[1:] == pytest.approx(0.6 * lengths[:-1], abs=0.01)
        assert (steps[1:] * steps[:-1]).sum(axis=1) == pytest.approx(lengths[1:] * lengths[:-1], abs=5e-3)


def test_the_mean_of_a_step_follows_from_its_law(wide):
    """Gas only at first: p is the start, x = p + v, so that on average the next v is chi (1 - phi/2) v."""
    along, across = [], []
    for seen in wide[1]:
        first, second = (seen[:2, 1] - seen[:2, 0]) if len(seen) > 1 else np.zeros((2, 2))
        if 0.02 < np.linalg.norm(first) < 0.2:  # then no step is cut to its largest length
            along.append(first @ second / (first @ first))
            across.append(np.cross([*first, 0], [*second, 0])[2] / (first @ first))
    assert len(along) > 80
    expected = 0.72984 * (1 - 2.05)
    assert np.mean(along) == pytest.approx(expected, abs=4 * np.std(along) / np.sqrt(len(along)))
    assert np.mean(across) == pytest.approx(0, abs=4 * np.std(across) / np.sqrt(len(across)))


def test_best_readings_fade(rivals):
    """10 ppm fade to 5 ppm in memory ln 2 = 6.9 s; from then on a place with 5 ppm is the best."""
    begin(rivals, [10.0, 5.0], 1.0)
    cases = [of(rivals, f"memory {n}").start for n in range(len(MEMORIES))]
    rivals.go(6.0)
    assert rivals.swarm.hits.to_numpy()[cases].tolist() == [1, 1]
    rivals.go(6.0)
    assert (rivals.swarm.hits.to_numpy()[cases] > 1).tolist() == [takes_it for _, takes_it in MEMORIES]


def test_each_update_takes_its_measurement(rivals):
    begin(rivals, [1.0], 1.0)
    states, places = rivals.go(10)
    robot = of(rivals, "measures").start
    assert (np.flatnonzero(states[:, robot] == DRIVE)[0] + 1) * TICK == pytest.approx(3.0, abs=1.5 * TICK)
    assert np.ptp(places[:25, robot], axis=0).max() == 0  # stands meanwhile


def cooperation(run, seconds):
    """Whether each robot ever went for a place that was not its own best."""
    differs = np.zeros(run.swarm.count, bool)
    for tick in range(round(seconds / TICK)):
        run.step()
        if tick % 5 == 4:
            goal = run.algorithm.goal.values  # NaN before the first measurement
            differs |= (np.isfinite(goal) & (goal != run.algorithm.best_place.values)).any(axis=1)
    return differs


def test_teams_cooperate_as_far_as_messages_reach(rivals):
    begin(rivals, [100.0], 1.0, is_hill=1)
    all_differ = cooperation(rivals, 25)
    for n, (communication, cooperate) in enumerate(COOPERATE):
        differs = all_differ[of(rivals, f"cooperate {n}")].reshape(4, 5)
        assert differs.any(axis=1).all() == cooperate, communication
        if not cooperate:
            assert not differs.any(), communication


def test_neighbourhoods(rivals):
    """Robot 0 has seen 10 ppm; the others, 0.4 m and more away, tell of these:"""
    reported = [0.0, 30.0, 50.0, 11.0, 14.0]
    senders = [[0, 0], [0.7, 0.4], [1.5, 1.5], [1.5, 1.5], [1.5, 1.5]]
    begin(rivals, [100.0], 1.0, is_hill=1)
    algorithm, count = rivals.algorithm, rivals.swarm.count
    times = [-1.0, 1.0, 1.0, 1.0, 1.0]
    radio = algorithm.radio
    for field, row in ((radio.value, reported), (radio.sender, senders), (radio.time, times)):
        field.from_numpy(np.tile(np.array(row), (count,) + (1,) * np.ndim(row)))
    algorithm.best.fill(10.0)
    result = ti.field(ti.i32, (count, 5))

    @ti.kernel
    def ask():
        for n, m in ti.ndrange(*result.shape):
            result[n, m] = algorithm._is_neighbour(n, m, 1, 2.0)

    ask()
    for n, (neighbourhood, listens) in enumerate(NEIGHBOURS):
        if listens is not None:
            robot = of(rivals, f"neighbours {n}").start
            assert set(np.flatnonzero(result.to_numpy()[robot, 1:]) + 1) == listens, neighbourhood


def test_random_mates_are_heard_with_their_probability(rivals):
    begin(rivals, [100.0], 1.0, is_hill=1)
    algorithm = rivals.algorithm
    robot = of(rivals, f"neighbours {len(NEIGHBOURS) - 1}").start
    result = ti.field(ti.i32, (2000, 5))

    @ti.kernel
    def ask():
        for tick, m in ti.ndrange(*result.shape):
            result[tick, m] = algorithm._is_neighbour(robot, m, tick, 2.0)

    ask()
    assert result.to_numpy().mean(axis=0) == pytest.approx([0.3] * 5, abs=4 * np.sqrt(0.21 / 2000))


def test_after_short_steps_it_starts_anew_anywhere(rivals):
    """Steps shrink to a tenth each time: the third way point is a random one, in all of the floor."""
    begin(rivals, [1.0], 1.0)
    all_of_them, trials = of(rivals, "restarts"), 100
    fields = rivals.swarm.acquisitions, rivals.algorithm.way_point, rivals.algorithm.step
    restarts = np.full((trials, 2), np.nan)
    for _ in range(100):
        rivals.step()
        acquisitions, way_point, step = (field.to_numpy()[all_of_them] for field in fields)
        new = (acquisitions == 3) & np.isnan(restarts[:, 0])
        restarts[new] = way_point[new]
        assert (np.linalg.norm(step, axis=1)[acquisitions < 3] <= 0.5).all()
    assert np.isfinite(restarts).all()
    low, high = np.array([ROOM, ROOM]), np.array(FLOOR) - ROOM
    assert (restarts > low - 1e-5).all()
    assert (restarts < high + 1e-5).all()
    share = (restarts - low) / (high - low)
    assert share.mean(axis=0) == pytest.approx([0.5, 0.5], abs=4 / np.sqrt(12 * trials))
    assert share.std(axis=0) == pytest.approx([1 / 12**0.5] * 2, rel=0.2)


@pytest.mark.slow
def test_teams_climb_a_hill_and_beat_a_random_walk():
    """40 teams of five from the corner, 2.8 m from the top; after 150 s most of each team crowds around it.

    Robots 0.17 m wide that keep 0.2 m between them: one is on top, and its neighbours 0.37 m away.
    """
    trials = 40
    hill = Hill([100.0], 1.0), CORNER, trials, FLOOR
    _, tracks = Run(Dapso(kind="dapso", restart_after=0), *hill, **ALONE).go(150)
    away = np.linalg.norm(tracks[-1] - TOP, axis=-1).reshape(trials, 5)
    assert (np.median(away, axis=1) < 0.6).mean() > 0.9
    _, walked = Run({"kind": "random_walk"}, *hill, reach=0).go(150)
    strayed = np.linalg.norm(walked[-1] - TOP, axis=-1).reshape(trials, 5)
    assert np.median(away) < 0.4 * np.median(strayed)
    apart = np.linalg.norm(tracks[:, :5, None] - tracks[:, None, :5], axis=-1) + 9 * np.eye(5)
    assert apart.min() > 2 * 0.085


def test_one_robot_climbs_as_well(rivals):
    begin(rivals, [100.0], 1.0, is_hill=1)
    _, tracks = rivals.go(150)
    away = np.linalg.norm(tracks[:, of(rivals, "climbs")] - TOP, axis=-1)
    assert np.median(away.min(axis=0)) < 0.5 * away[0, 0]


def test_it_explores_until_it_smells(rivals):
    """Clean air: random places far and wide; the first whiff stops a robot, and then it has a place to return to."""
    begin(rivals, [0.0] * 60 + [5.0], 1.0)
    explorers = of(rivals, "explores")
    states, tracks = (values[:, explorers] for values in rivals.go(60))
    assert set(np.unique(states)) == {MEASURE, EXPLORE}
    assert np.ptp(tracks.reshape(-1, 2), axis=0) == pytest.approx(np.array(FLOOR) - 2 * ROOM, abs=0.2)
    assert (np.ptp(tracks, axis=0) > 1).any(axis=1).mean() > 0.9
    states = rivals.go(6)[0][:, explorers]
    assert not (states[10:] == EXPLORE).any()
    assert (states == DRIVE).any(axis=0).all()
