"""Messages reach who is in range, unless they are lost, and the last one is kept."""

import numpy as np
import pytest
import taichi as ti

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.radio import NEVER, Radio
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.scenario.algorithms import RandomWalk
from taichi_plume.scenario.robots import Communication, Group
from taichi_plume.scenario.starts import StartAt

pytestmark = pytest.mark.usefixtures("taichi")


@ti.data_oriented
class Talk:
    """Robots 1 m apart along x, of which those in `speakers` say their number plus `more`."""

    def __init__(self, count=4, trials=1, first_trial=0, **communication):
        places = [(1.0 + i, 1.0) for i in range(count)]
        group = Group(
            count=count,
            trials=trials,
            first_trial=first_trial,
            start=StartAt(kind="positions", positions=tuple(places)),
            algorithm=RandomWalk(kind="random_walk"),
            communication=Communication(**communication),
        )
        arena = ClearanceMap([], (count + 1.0, 2.0, 1.0), 0.1)
        where = np.tile(places, (trials, 1))
        self.swarm = Swarm((group,), where, np.zeros(len(where)), arena, np.empty((0, 2)), 5)
        members = Members(self.swarm, [0])
        parameters = Parameters(members, Radio.numbers, radio="radio")
        parameters.begin()
        self.radio = Radio(members, parameters)
        self.forget()

    @ti.kernel
    def forget(self):
        for n in range(self.radio.size):
            self.radio.forget(n)

    @ti.kernel
    def say(self, n: int, more: float):
        self.radio.say(n, n + more, ti.Vector([10.0 * n, -1.0]))

    def round(self, speakers, tick=1, more=0.0):
        """Who has heard whom by now, (robots, count)."""
        for n in speakers:
            self.say(n, more)
        self.radio.deliver(tick, 0.1 * tick)
        return self.heard()

    def heard(self):
        return self.radio.time.to_numpy() != NEVER


@pytest.mark.parametrize("reach", [0.5, 1.0, 2.5, None])
def test_messages_go_as_far_as_the_range(reach):
    heard = Talk(range=reach).round(range(4))
    apart = np.abs(np.subtract.outer(np.arange(4), np.arange(4)))
    assert (heard == ((apart > 0) & (apart <= (reach or 9)))).all()


def test_a_message_tells_value_place_sender_and_time():
    talk = Talk(range=None)
    talk.round([2], tick=7)
    radio = talk.radio
    assert radio.value.to_numpy()[0].tolist() == [0, 0, 2, 0]
    assert radio.place.to_numpy()[0, 2].tolist() == [20, -1]
    assert radio.sender.to_numpy()[0, 2].tolist() == [3, 1]
    assert radio.time.to_numpy()[0, 2] == pytest.approx(0.7)


def test_the_last_message_stays_until_the_next():
    talk = Talk(range=None)
    talk.round([1], tick=1, more=0.5)
    assert (talk.round([], tick=2)[:, 1] == [True, False, True, True]).all()
    assert talk.radio.value.to_numpy()[0, 1] == 1.5
    talk.round([1], tick=3, more=3.0)
    assert talk.radio.value.to_numpy()[0, 1] == 4.0
    assert talk.radio.time.to_numpy()[0, 1] == pytest.approx(0.3)


def test_the_range_counts_when_it_is_said():
    talk = Talk(count=2, range=1.5)
    talk.swarm.position.from_numpy(np.array([[1, 1], [3, 1]], np.float32))
    assert not talk.round([0, 1]).any()
    talk.swarm.position.from_numpy(np.array([[1, 1], [2, 1]], np.float32))
    assert not talk.round([], tick=2).any()  # nobody speaks now
    assert talk.round([0], tick=3).tolist() == [[False, False], [True, False]]


@pytest.mark.parametrize("loss", [0.0, 0.3, 1.0])
def test_a_share_of_the_messages_is_lost(loss):
    trials = 2000
    heard = Talk(trials=trials, range=None, loss=loss).round(range(4 * trials))
    share = heard.reshape(trials, 4, 4).sum() / (trials * 12)
    assert share == pytest.approx(1 - loss, abs=4 * np.sqrt(loss * (1 - loss) / (trials * 12)))
    assert not heard.reshape(trials, 4, 4)[:, range(4), range(4)].any()  # nobody hears itself


def test_a_trial_alone_loses_the_same_messages():
    among = Talk(trials=20, range=None, loss=0.5).round(range(80)).reshape(20, 4, 4)
    alone = Talk(first_trial=13, range=None, loss=0.5).round(range(4))
    assert (alone == among[13]).all()
    assert len(np.unique(among.reshape(20, 16), axis=0)) > 10


def test_what_is_forgotten_is_not_known():
    talk = Talk(range=None)
    talk.round(range(4))

    @ti.kernel
    def forget():
        talk.radio.forget(2)

    forget()
    assert talk.heard().sum(axis=1).tolist() == [3, 3, 0, 3]
