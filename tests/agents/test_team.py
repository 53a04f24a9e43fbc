"""Which robots an algorithm drives: those of all groups of its kind, or of one group."""

import numpy as np
import pytest
from robots import NOWHERE, Driver, Floor, group

from taichi_plume.agents.algorithm_table import ALGORITHMS
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.team import teams
from taichi_plume.scenario.algorithms import Casting, Own, Sweep

pytestmark = pytest.mark.usefixtures("taichi")


class Together:
    """Tells what it has been given."""

    PER_GROUP = False
    STATE = ()
    STATE_NAMES = ("A", "B")
    DECISIONS = ()

    def __init__(self, swarm, members, tick):
        self.members = members

    def act(self, tick, t, dt):
        pass


class Apart(Together):
    PER_GROUP = True
    STATE_NAMES = ("C",)


class Mine:
    """An algorithm of the user's."""

    def __init__(self, pace=0.1):
        self.pace, self.ticks = pace, 0

    def act(self, robots):
        self.ticks += 1
        robots.speed[:] = self.pace * self.ticks
        robots.turn_rate = robots.trial + 0.1 * robots.robot


def swarm_of(*algorithms):
    groups = [
        group(
            count=2,
            trials=2,
            name=f"group {n}",
            algorithm=one,
            body={"max_speed": 1.0, "max_turn_rate_deg": 360},
        )
        for n, one in enumerate(algorithms)
    ]
    places = np.column_stack([0.2 * np.arange(1, 4 * len(groups) + 1), np.ones(4 * len(groups))])
    return Swarm(groups, places, np.zeros(len(places)), Floor(), NOWHERE, 0)


def test_groups_of_a_kind_have_one_algorithm_unless_it_wants_them_apart(monkeypatch):
    monkeypatch.setitem(ALGORITHMS, "casting", Together)
    monkeypatch.setitem(ALGORITHMS, "sweep", Apart)
    casting, sweep = Casting(kind="casting"), Sweep(kind="sweep")
    made = teams(swarm_of(casting, sweep, casting, sweep), 0.1)
    assert [one.numbers for one in made] == [(0, 2), (1,), (3,)]
    assert [one.state_names for one in made] == [("A", "B"), ("C",), ("C",)]
    together = made[0].algorithm
    assert isinstance(together, Together)
    assert together.members.robot.to_numpy().tolist() == [*range(4), *range(8, 12)]
    assert together.members.number.to_numpy().tolist() == [*range(4), *range(4)]


def test_own_algorithms_have_their_parameters():
    own = Own(kind="own")

    def drive(pace):
        swarm = swarm_of(own.model_copy(update={"parameters": {"pace": pace}}), own)
        made = teams(swarm, 0.1, own={"group 0": Mine, "group 1": Mine})
        assert [one.numbers for one in made] == [(0,), (1,)]
        driver = Driver(swarm)
        for tick in range(1, 4):
            for one in made:
                one.act(tick, 0.1 * tick, 0.1)
            driver.move()
        return swarm.speed_command.to_numpy(), swarm.turn_rate_command.to_numpy()

    for pace in (0.2, 0.3):
        speed, turn_rate = drive(pace)
        assert speed == pytest.approx([3 * pace] * 4 + [0.3] * 4)
        assert turn_rate == pytest.approx([0, 0.1, 1, 1.1] * 2)
