"""Messages reach who is in range, unless they are lost, and the last one is kept."""

import numpy as np
import pytest
from robots import NOWHERE, group

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.radio import NEVER, Radio
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap

pytestmark = pytest.mark.usefixtures("taichi")

RANGES = (0.5, 1.0, 2.5, None)  # m
LOSSES = (0.0, 0.3, 1.0)


class Talk:
    """Groups of robots 1 m apart along x, which tell their number in the team plus `more`."""

    def __init__(self, *communications, trials=1, first_trial=0, count=4):
        places = [(1.0 + i, 1.0) for i in range(count)]
        groups = tuple(
            group(count=count, trials=trials, first_trial=first_trial, communication=communication)
            for communication in communications
        )
        arena = ClearanceMap([], (count + 1.0, 2.0, 1.0), 0.1)
        self.places = np.tile(places, (trials * len(groups), 1))
        self.count = len(self.places)
        self.swarm = Swarm(groups, self.places, np.zeros(self.count), arena, NOWHERE, 5, rivals=True)
        members = Members(self.swarm, range(len(groups)))
        self.radio = Radio(members, Parameters(members, Radio.numbers, radio="radio"))
        self.forget(0, self.count)

    @ti.kernel
    def forget(self, first: int, end: int):
        for n in range(first, end):
            self.radio.forget(n)

    @ti.kernel
    def say(self, who: ti.types.ndarray(), more: float):
        for k in range(who.shape[0]):
            n = who[k] % 4
            self.radio.say(who[k], n + more, ti.Vector([10.0 * n, -1.0]))

    def round(self, speakers, tick=1, more=0.0):
        """Who has heard whom by now, (robots, count)."""
        if len(speakers):
            self.say(np.array(speakers, np.int32), more)
        self.radio.deliver(tick, 0.1 * tick)
        return self.heard()

    def heard(self):
        return self.radio.time.to_numpy() != NEVER


@pytest.fixture
def everywhere(taichi):
    """Four robots whose messages reach all."""
    return Talk({"range": None})


def test_messages_go_as_far_as_the_range():
    heard = Talk(*({"range": reach} for reach in RANGES)).round(range(16)).reshape(4, 4, 4)
    apart = np.abs(np.subtract.outer(np.arange(4), np.arange(4)))
    for of_group, reach in zip(heard, RANGES, strict=True):
        assert (of_group == ((apart > 0) & (apart <= (reach or 9)))).all(), reach


def test_a_message_tells_value_place_sender_and_time(everywhere):
    talk = everywhere
    talk.round([2], tick=7)
    radio = talk.radio
    assert radio.value.to_numpy()[0].tolist() == [0, 0, 2, 0]
    assert radio.place.to_numpy()[0, 2].tolist() == [20, -1]
    assert radio.sender.to_numpy()[0, 2].tolist() == [3, 1]
    assert radio.time.to_numpy()[0, 2] == pytest.approx(0.7)


def test_the_last_message_stays_until_the_next(everywhere):
    talk = everywhere
    talk.round([1], tick=1, more=0.5)
    assert (talk.round([], tick=2)[:, 1] == [True, False, True, True]).all()
    assert talk.radio.value.to_numpy()[0, 1] == 1.5
    talk.round([1], tick=3, more=3.0)
    assert talk.radio.value.to_numpy()[0, 1] == 4.0
    assert talk.radio.time.to_numpy()[0, 1] == pytest.approx(0.3)


def test_the_range_counts_when_it_is_said():
    talk = Talk({"range": 1.5}, count=2)
    talk.swarm.position.from_numpy([[1, 1], [3, 1]])
    assert not talk.round([0, 1]).any()
    talk.swarm.position.from_numpy([[1, 1], [2, 1]])
    assert not talk.round([], tick=2).any()  # nobody speaks now
    assert talk.round([0], tick=3).tolist() == [[False, False], [True, False]]


@pytest.fixture(scope="module")
def lossy(taichi):
    """2000 teams for each of LOSSES; a message of each robot has been delivered: (losses, trials, 4, 4)."""
    talk = Talk(*({"range": None, "loss": loss} for loss in LOSSES), trials=2000)
    return talk.round(range(talk.count)).reshape(len(LOSSES), 2000, 4, 4)


def test_a_share_of_the_messages_is_lost(lossy):
    for heard, loss in zip(lossy, LOSSES, strict=True):
        share = heard.sum() / (2000 * 12)
        assert share == pytest.approx(1 - loss, abs=4 * np.sqrt(loss * (1 - loss) / (2000 * 12))), loss
        assert not heard[:, range(4), range(4)].any()  # nobody hears itself


def test_a_trial_alone_loses_the_same_messages():
    among = Talk({"range": None, "loss": 0.5}, trials=20).round(range(80)).reshape(20, 4, 4)
    alone = Talk({"range": None, "loss": 0.5}, first_trial=13).round(range(4))
    assert (alone == among[13]).all()
    assert len(np.unique(among.reshape(20, 16), axis=0)) > 10


def test_what_is_forgotten_is_not_known(everywhere):
    talk = everywhere
    talk.round(range(4))
    talk.forget(2, 3)
    assert talk.heard().sum(axis=1).tolist() == [3, 3, 0, 3]
