"""Maps that a robot makes: of its own readings and those within the range of its communication, less the lost ones."""

import numpy as np
import pytest

import taichi_plume as tp

pytestmark = pytest.mark.usefixtures("taichi")

PLACES = [[0.5, 0.5], [1.5, 0.5], [2.0, 0.5], [2.5, 1.5], [3.5, 1.5]]
RANGE = 1.2


def law(points, t):
    return 10.0 + points[:, 0] + 5.0 * points[:, 1] + t


def simulation(*robots, trials=1, first=0, kind="inverse_distance", keys=None, **communication):
    group = {
        "trials": trials,
        "first_trial": first,
        "algorithm": {"kind": "random_walk", "speed": 0.0},
        "sensors": {"gas": {"kind": "ideal"}, "wind": {"kind": "ideal"}},
        "communication": communication,
        "body": {"radius": 0.05},
        "reach": 0.0,
    }
    return tp.Simulation(
        {
            "duration": 4,
            "tick": 0.1,
            "domain": {"size": [4.0, 2.0], "spacing": 0.1},
            "wind": {"kind": "uniform", "velocity": [0.1, 0.0]},
            "gas": {"species": "methane", **tp.Own(law)},
            "robots": [
                {"name": "two", "count": 2, "start": {"kind": "positions", "positions": PLACES[:2]}} | group,
                {"name": "three", "count": 3, "start": {"kind": "positions", "positions": PLACES[2:]}}
                | group,
            ],
            "maps": [
                {"kind": kind, "cell": 0.5}
                | ({} if robot is None else {"robot": robot})
                | ({} if kind == "kernel_dmv" else {"window": 1.0})
                for robot in robots
            ],
        }
        | (keys or {})
    )


def test_readings_within_range_arrive():
    """In all trials alike, from other groups too."""
    with simulation(1, 4, trials=2, range=RANGE) as sim:
        sim.run(until=1.0)
        readings = sim.loop.swarm.reading.to_numpy()
        group = np.array([0, 1, 0, 1, 2, 3, 4, 2, 3, 4])  # numbers of the robots in their trials
        for robot, received in sim.loop.received.items():
            apart = np.linalg.norm(np.subtract(PLACES, PLACES[robot]), axis=1)[group]
            assert 2 < (apart <= RANGE).sum() < 10
            expected = np.where(apart <= RANGE, readings, np.nan)
            np.testing.assert_array_equal(received.reading.to_numpy(), expected)


def test_lost_readings_do_not_arrive():
    """As often as the loss says, not all at once, and never those of the map's own robot."""
    with simulation(2, loss=0.4) as sim:
        arrived = []
        for n in range(1, 41):
            sim.run(until=0.1 * n)
            arrived.append(np.isfinite(sim.loop.received[2].reading.to_numpy()))
    others = np.delete(np.array(arrived), 2, axis=1)
    assert np.array(arrived)[:, 2].all()
    assert others.mean() == pytest.approx(0.6, abs=3 * np.sqrt(0.24 / others.size))
    assert abs(np.corrcoef(others.T)[np.triu_indices(4, 1)]).max() < 0.6


def test_a_trial_loses_the_same_alone_and_among_others():
    arrived = []
    for first, trials in ((0, 3), (2, 1)):
        with simulation(1, trials=trials, first=first, loss=0.5) as sim:
            sim.run(until=0.5)
            members = sim.loop.swarm.members.to_numpy()[-1]
            arrived.append(sim.loop.received[1].reading.to_numpy()[members])
    assert 1 < np.isnan(arrived[0]).sum() < 5
    np.testing.assert_array_equal(*arrived)


def test_rivals_are_counted_each_by_itself():
    """Each group has rows of trials of its own, in which its robot 1 receives."""
    with simulation(1, keys={"rivals": True}, range=0.6) as sim:
        sim.run(until=0.2)
        received = np.isfinite(sim.loop.received[1].reading.to_numpy())
    assert received.tolist() == [False, True, False, True, False]


def test_maps_hold_what_their_robot_has_received():
    """A robot that hears nobody maps its own readings of the last window everywhere."""
    with simulation(0, 3, None, range=0.3) as sim:
        sim.run(until=4.0)
        *alone, together = (gas_map.estimate()[0] for gas_map in sim.loop.maps)
    for estimate, robot in zip(alone, (0, 3), strict=True):
        own = np.mean([law(np.array([PLACES[robot]]), t) for t in np.arange(3.1, 4.01, 0.1)])
        assert estimate == pytest.approx(np.full((8, 4), own), rel=0.01)
    assert np.ptp(together) > 3.0


@pytest.mark.parametrize("kind", ["time_series", "kernel_dmv", "gmrf"])
def test_every_kind_of_map_can_be_of_a_robot(kind):
    """The other robots' readings, which are higher, are in the map of all readings alone."""
    with simulation(0, None, kind=kind, range=0.3) as sim:
        sim.run(until=4.0)
        alone, together = (np.nanmax(gas_map.estimate()) for gas_map in sim.loop.maps)
    own = law(np.array(PLACES[:1]), 4.0)[0]
    assert alone < own + 0.1
    assert together > own + 3.0


@pytest.mark.parametrize(
    ("robots", "keys", "reported"),
    [
        ((4, 5), {}, r"maps\[1\]\.robot: 5 is no robot of a trial of 5"),
        ((2,), {"rivals": True}, "a trial of 2"),
    ],
)
def test_other_robots_are_refused(robots, keys, reported):
    with pytest.raises(tp.ScenarioError, match=reported):
        simulation(*robots, keys=keys)
