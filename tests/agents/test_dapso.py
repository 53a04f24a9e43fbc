"""DAPSO: its rules against closed forms and statistics, and whether a team climbs a hill of gas."""

import numpy as np
import pytest
import taichi as ti
from arena import TICK, Run, Script

from taichi_plume.agents.dapso import DRIVE, EXPLORE, MEASURE, constriction
from taichi_plume.scenario.algorithms import Dapso, FunctionValue, RandomMates, RandomWalk, SearchSpace
from taichi_plume.scenario.robots import Communication
from taichi_plume.scenario.species import SPECIES

pytestmark = pytest.mark.usefixtures("taichi")

TOP = (3.0, 2.2)
CORNER = ((0.4, 0.4), (0.8, 0.4), (0.4, 0.8), (0.8, 0.8), (1.2, 0.4))
FLOOR = (4.0, 3.0)
ROOM = 0.085 + 0.2  # radius and avoidance


@ti.data_oriented
class Hill:
    """Ethanol with a peak of 100 ppm at TOP, Gaussian with a width of 1 m, for all time."""

    species = (SPECIES["ethanol"],)

    @ti.func
    def ppm(self, x, t):
        apart = ti.Vector([x[0] - TOP[0], x[1] - TOP[1]])
        return ti.Vector([100.0 * ti.exp(-0.5 * apart.dot(apart))])

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([0.0, 0.0])


def swarm_on_hill(trials=2, communication=None, **keys):
    model = Dapso(kind="dapso", **keys)
    return Run(
        model,
        Hill(),
        CORNER,
        trials,
        FLOOR,
        communication=communication or Communication(range=None),
        reach=0,
    )


def quick(**keys):
    """A model that hardly stops to measure, nor looks for gas."""
    return Dapso(kind="dapso", acquisition=0.5, settle=0, way_point_tolerance=0.005, threshold_ppm=0, **keys)


def way_points(run, seconds):
    """Those of each update, per robot, with where the robot stood: (updates, 2, 2)."""
    seen = [[] for _ in range(run.swarm.count)]
    before = run.swarm.state.to_numpy()
    for _ in range(round(seconds / TICK)):
        places = run.swarm.position.to_numpy()
        run.go(TICK)
        now = run.swarm.state.to_numpy()
        chosen = np.flatnonzero((before == MEASURE) & (now == DRIVE))
        if len(chosen):
            goals = run.team.algorithm.way_point.to_numpy()
            for n in chosen:
                seen[n].append((places[n], goals[n]))
        before = now
    return [np.array(one) for one in seen]


def test_constriction():
    """Roots of z² - (1 + chi - chi phi) z + chi: their size is the root of chi where they are complex."""
    assert constriction(4.1) == pytest.approx(0.7298437881, abs=1e-9)
    assert constriction(5.0, 0.5) == pytest.approx(0.5 * constriction(5.0))
    assert [constriction(phi, 0.8) for phi in (0.0, 2.0, 4.0)] == pytest.approx([0.8] * 3)
    for phi in (4.1, 5.0, 8.0):
        chi = constriction(phi)
        assert np.abs(np.roots([1, -(1 + chi - chi * phi), chi])).max() == pytest.approx(chi**0.5)


def test_without_pulls_each_step_is_a_share_of_the_last():
    run = Run(
        quick(phi1=0, phi2=0, kappa=0.6, restart_after=0), Script([1.0], 1.0), size=(8.0, 8.0), trials=8
    )
    for seen in way_points(run, 15):
        steps = seen[:4, 1] - seen[:4, 0]
        lengths = np.linalg.norm(steps, axis=1)
        assert (lengths <= 0.5).all()
        assert lengths[1:] == pytest.approx(0.6 * lengths[:-1], abs=0.01)
        assert (steps[1:] * steps[:-1]).sum(axis=1) == pytest.approx(lengths[1:] * lengths[:-1], abs=5e-3)


def test_the_mean_of_a_step_follows_from_its_law():
    """Gas only at first: p is the start, x = p + v, so that on average the next v is chi (1 - phi/2) v."""
    trials = 400
    run = Run(
        quick(memory=0, restart_after=0),
        Script([9.0] + [0.0] * 99, 0.6),
        ((5, 5),),
        trials,
        (10.0, 10.0),
        reach=0,
    )
    along, across = [], []
    for seen in way_points(run, 14):
        first, second = (seen[:2, 1] - seen[:2, 0]) if len(seen) > 1 else np.zeros((2, 2))
        if 0.02 < np.linalg.norm(first) < 0.2:  # then no step is cut to its largest length
            along.append(first @ second / (first @ first))
            across.append(np.cross([*first, 0], [*second, 0])[2] / (first @ first))
    assert len(along) > 80
    expected = 0.72984 * (1 - 2.05)
    assert np.mean(along) == pytest.approx(expected, abs=4 * np.std(along) / np.sqrt(len(along)))
    assert np.mean(across) == pytest.approx(0, abs=4 * np.std(across) / np.sqrt(len(across)))


@pytest.mark.parametrize(("memory", "takes_it"), [(10.0, True), (0, False)])
def test_best_readings_fade(memory, takes_it):
    """10 ppm fade to 5 ppm in memory ln 2 = 6.9 s; from then on a place with 5 ppm is the best."""
    run = Run(quick(memory=memory), Script([10.0] + [5.0] * 9, 1.0), reach=0)
    run.go(6.0)
    assert run.swarm.hits.to_numpy()[0] == 1
    run.go(6.0)
    assert (run.swarm.hits.to_numpy()[0] > 1) == takes_it


def test_each_update_takes_its_measurement():
    run = Run(Dapso(kind="dapso", acquisition=2.0, settle=1.0), Script([1.0], 1.0))
    states, places = run.go(10)
    assert (np.flatnonzero(states[:, 0] == DRIVE)[0] + 1) * TICK == pytest.approx(3.0, abs=1.5 * TICK)
    assert np.ptp(places[:25, 0], axis=0).max() == 0  # stands meanwhile


def cooperation(run, seconds):
    """Whether each robot ever went for a place that was not its own best."""
    differs = np.zeros(run.swarm.count, bool)
    for _ in range(round(seconds / 0.5)):
        run.go(0.5)
        algorithm = run.team.algorithm
        differs |= (algorithm.goal.to_numpy() != algorithm.best_place.to_numpy()).any(axis=1)
    return differs


@pytest.mark.parametrize(
    ("communication", "cooperate"),
    [
        (Communication(range=None), True),
        (Communication(range=None, loss=1.0), False),
        (Communication(range=0.1), False),
    ],
)
def test_teams_cooperate_as_far_as_messages_reach(communication, cooperate):
    differs = cooperation(swarm_on_hill(4, communication), 25).reshape(4, 5)
    assert differs.any(axis=1).all() == cooperate
    if not cooperate:
        assert not differs.any()


@pytest.mark.parametrize(
    ("neighbourhood", "listens"),
    [
        (SearchSpace(kind="search_space", distance=0.5), {1}),
        (SearchSpace(kind="search_space", distance=5), {1, 2, 3, 4}),
        (FunctionValue(kind="function_value", number=1), {3}),
        (FunctionValue(kind="function_value", number=3), {1, 3, 4}),
        (RandomMates(kind="random", probability=1), {1, 2, 3, 4}),
        (RandomMates(kind="random", probability=0), set()),
    ],
)
def test_neighbourhoods(neighbourhood, listens):
    """Robot 0 has seen 10 ppm; the others, 0.4 m and more away, tell of these:"""
    told = [0.0, 30.0, 50.0, 11.0, 14.0]
    run = swarm_on_hill(1, neighbourhood=neighbourhood, memory=0)
    algorithm = run.team.algorithm
    algorithm.radio.value.from_numpy(np.tile(np.array(told, np.float32), (5, 1)))
    algorithm.radio.sender.from_numpy(
        np.tile(np.array([[0, 0], *np.array(CORNER[1:])], np.float32), (5, 1, 1))
    )
    algorithm.radio.sender[0, 1] = [0.7, 0.4]
    algorithm.radio.sender[0, 2] = algorithm.radio.sender[0, 3] = algorithm.radio.sender[0, 4] = [1.5, 1.5]
    algorithm.radio.time.fill(1.0)
    algorithm.radio.time[0, 0] = -1.0
    algorithm.best.fill(10.0)
    result = ti.field(ti.i32, 5)

    @ti.kernel
    def ask():
        for m in result:
            result[m] = algorithm._is_neighbour(0, m, 1, 2.0)

    ask()
    assert set(np.flatnonzero(result.to_numpy()[1:]) + 1) == listens


def test_random_mates_are_heard_with_their_probability():
    run = swarm_on_hill(1, neighbourhood=RandomMates(kind="random", probability=0.3))
    algorithm = run.team.algorithm
    result = ti.field(ti.i32, (2000, 5))

    @ti.kernel
    def ask():
        for tick, m in result:
            result[tick, m] = algorithm._is_neighbour(0, m, tick, 2.0)

    ask()
    assert result.to_numpy().mean(axis=0) == pytest.approx([0.3] * 5, abs=4 * np.sqrt(0.21 / 2000))


def test_after_short_steps_it_starts_anew_anywhere():
    """Steps shrink to a tenth each time: the third way point is a random one, in all of the floor."""
    trials = 100
    run = Run(
        quick(phi1=0, phi2=0, kappa=0.1, restart_step=0.055),
        Script([1.0], 1.0),
        ((2.0, 1.5),),
        trials,
        FLOOR,
    )
    restarts = np.full((trials, 2), np.nan)
    for _ in range(100):
        run.go(TICK)
        new = (run.swarm.acquisitions.to_numpy() == 3) & np.isnan(restarts[:, 0])
        restarts[new] = run.team.algorithm.way_point.to_numpy()[new]
        waiting = run.swarm.acquisitions.to_numpy() < 3
        assert (np.linalg.norm(run.team.algorithm.step.to_numpy(), axis=1)[waiting] <= 0.5).all()
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
    run = swarm_on_hill(trials, restart_after=0)
    _, tracks = run.go(150)
    away = np.linalg.norm(tracks[-1] - TOP, axis=-1).reshape(trials, 5)
    assert (np.median(away, axis=1) < 0.6).mean() > 0.9
    walk = Run(RandomWalk(kind="random_walk"), Hill(), CORNER, trials, FLOOR, reach=0)
    _, walked = walk.go(150)
    strayed = np.linalg.norm(walked[-1] - TOP, axis=-1).reshape(trials, 5)
    assert np.median(away) < 0.4 * np.median(strayed)
    apart = np.linalg.norm(tracks[:, :5, None] - tracks[:, None, :5], axis=-1) + 9 * np.eye(5)
    assert apart.min() > 2 * 0.085


def test_one_robot_climbs_as_well():
    run = Run(Dapso(kind="dapso"), Hill(), ((2.0, 1.4),), 20, FLOOR, reach=0)
    _, tracks = run.go(150)
    away = np.linalg.norm(tracks - TOP, axis=-1)
    assert np.median(away.min(axis=0)) < 0.5 * away[0, 0]


def test_it_explores_until_it_smells():
    """Clean air: random places far and wide; the first whiff stops a robot, and then it has a place to return to."""
    run = Run(Dapso(kind="dapso"), Script([0.0] * 60 + [5.0] * 9, 1.0), ((2.0, 1.5),), 40, FLOOR, reach=0)
    states, tracks = run.go(60)
    assert set(np.unique(states)) == {MEASURE, EXPLORE}
    assert np.ptp(tracks.reshape(-1, 2), axis=0) == pytest.approx(np.array(FLOOR) - 2 * ROOM, abs=0.2)
    assert (np.ptp(tracks, axis=0) > 1).any(axis=1).mean() > 0.9
    states, _ = run.go(6)
    assert not (states[10:] == EXPLORE).any()
    assert (states == DRIVE).any(axis=0).all()


@pytest.mark.slow
def test_a_trial_alone_is_the_same_as_among_many():
    keys = {"communication": Communication(range=2.0, loss=0.2), "reach": 0}
    model = Dapso(kind="dapso", neighbourhood=RandomMates(kind="random"))
    _, among = Run(model, Hill(), CORNER, 6, FLOOR, **keys).go(30)
    _, alone = Run(model, Hill(), CORNER, 1, FLOOR, first_trial=4, **keys).go(30)
    assert (alone == among[:, 20:25]).all()
    assert (among[:, :5] != among[:, 5:10]).any()
