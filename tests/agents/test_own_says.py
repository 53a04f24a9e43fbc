"""What robots of an own algorithm declare and tell each other."""

from typing import Any

import numpy as np
import pytest
from robots import room, team

from taichi_plume.api.own import Own
from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import program
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.grid.state import State
from taichi_plume.scenario.scenario import Scenario

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

PLACES = [[1.0, 1.0], [1.5, 1.0], [3.0, 1.0]]


class Talkers:
    """Robot k says k, its place and the time, in every third tick; in the fourth it declares."""

    MESSAGE = 4

    def act(self, robots: Any) -> None:
        self.heard, self.heard_at = robots.heard.copy(), robots.heard_at.copy()
        tick = round(robots.t / robots.dt)
        if tick % 3 == 1:
            k = np.arange(len(robots.robot))
            robots.tell(np.column_stack([k, robots.position, np.full(len(k), robots.t)]))
        if tick == 4:
            robots.declare(robots.robot == 1)
            robots.declare([0, 3], (2.0, 2.5))

    def state(self) -> int:
        return 0

    def restore(self, state: int) -> None:
        pass


def scenario(**keys: Any) -> Scenario:
    """Two teams of three, 0.5, 1.5 and 2 m apart."""
    mine = team(*PLACES, heading_deg=0) | {"name": "mine", "trials": 2, "algorithm": {"kind": "own"}} | keys
    gas = {"kind": "eulerian", "sources": [{"position": [2.0, 2.2], "rate": "1 mg/s"}]}
    return Scenario.model_validate(room(mine, gas=gas, duration=2, tick=0.1))


def made(own: type, **keys: Any) -> Any:
    return assemble(scenario(algorithm=Own(own), **keys))


@pytest.fixture(scope="module")
def near():
    """Their simulation where messages reach 1 m."""
    program.start("cpu")
    return made(Talkers, communication={"range": 1.0})


def algorithm(sim: Any) -> Any:
    return sim.teams[0].algorithm.algorithm


def advance(sim: Any, ticks: int) -> None:
    for _ in range(ticks):
        sim.advance()


def test_those_in_range_hear_in_the_next_tick(near):
    near.reset(near.scenario)
    advance(near, 2)
    own = algorithm(near)
    assert own.heard.shape == (6, 3, 4)
    pairs = {(n, m) for n, m in np.argwhere(np.isfinite(own.heard_at)).tolist()}
    assert pairs == {(0, 1), (1, 0), (3, 1), (4, 0)}, "0.5 m apart; never oneself, never another trial"
    assert own.heard[3, 1] == pytest.approx([4.0, 1.5, 1.0, 0.1])
    assert own.heard_at[3, 1] == pytest.approx(0.1)
    assert np.isnan(own.heard[0, 2]).all()
    advance(near, 3)
    assert algorithm(near).heard[3, 1, 3] == pytest.approx(0.4), "the last message"


def test_declarations_are_judged(near):
    near.reset(near.scenario)
    advance(near, 6)
    now = near.swarm.snapshot()
    assert now["declarations"].tolist() == [1, 1, 0, 1, 1, 0]
    assert now["false_declarations"].tolist() == [0, 1, 0, 0, 1, 0]
    assert now["declared_position"][[0, 1]] == pytest.approx(np.array([[2.0, 2.5], [1.5, 1.0]]))
    assert now["declared_time"][3] == pytest.approx(0.4)


def test_a_reset_and_a_checkpoint_keep_what_was_heard(near):
    near.reset(near.scenario)
    assert np.isnan(near.teams[0].algorithm.messages.heard_at).all()
    advance(near, 3)
    state = State(near)
    saved = state.save()
    advance(near, 4)
    late = algorithm(near).heard.copy(), near.swarm.snapshot()["declarations"].copy()
    near.reset(near.scenario)
    state.restore(saved)
    advance(near, 4)
    np.testing.assert_array_equal(algorithm(near).heard, late[0])
    np.testing.assert_array_equal(near.swarm.snapshot()["declarations"], late[1])


def test_messages_are_lost_at_the_groups_rate():
    class Calls:
        MESSAGE = 1

        def act(self, robots: Any) -> None:
            robots.tell(robots.t)
            new = robots.heard_at > robots.t - 1.5 * robots.dt
            self.came = getattr(self, "came", 0) + new.sum()

    sim = made(Calls, trials=200, communication={"loss": 0.3})
    advance(sim, 10)
    sent = 9 * 600 * 2  # of the tenth tick nothing has been heard yet
    rate = algorithm(sim).came / sent
    assert rate == pytest.approx(0.7, abs=4 * np.sqrt(0.21 / sent))


WRONG = [
    ("robots.declare(robots.robot[:2] == 0)", "which must be a boolean mask of length 6"),
    ("robots.declare([0, 6])", "robot indices from 0 to 5"),
    ("robots.declare(0.5)", "which must be"),
    ("robots.declare([0, 1], [[1, 2, 3]])", "place has the shape (1, 3), not (2, 2) or (2,)"),
    ("robots.declare(True, 3)", "place has the shape (), not (6, 2) or (2,)"),
    ("robots.declare(2, [1, float('nan')])", "place[0, 1] is nan, not a finite number"),
    ("robots.declare(2, 'ab')", "place has the shape (), not (1, 2) or (2,)"),
    ("robots.tell([1, 2, 3])", "values has the shape (3,), not (6, 2) or (2,)"),
    ("robots.tell([1, 1e39])", "values[0, 1] is 1e+39, not a finite number"),
    ("robots.heard[:] = 0", "read-only"),
    ("robots.speed = robots.reading[:3] * 0", "robots.speed has the shape (3,), not (6,)"),
    ("robots.turn_rate[2] = float('nan')", "robots.turn_rate[2] is nan, not a finite number"),
    ("robots.speed[1] = 1e39", "robots.speed[1] is 1e+39, not a finite number"),
    ("robots.turnrate = 0.1", "Robots has no attribute 'turnrate'; did you mean 'turn_rate'?"),
    ("robots.heading = 0.1", "Robots.heading can only be read; attributes to set: "),
    ("robots.climb_rate = 0.1", "Robots has no attribute 'climb_rate'"),
    ("robots.state[:] = 5", "robots.state must be whole numbers from 0 to 0"),
    ("robots.go_to(1, 1, 1)", "go_to needs drones"),
]


@pytest.fixture(scope="module")
def wrong():
    """A simulation whose algorithm does what `what` says."""
    program.start("cpu")

    class Wrong:
        MESSAGE = 2
        what = ""

        def act(self, robots: Any) -> None:
            exec(self.what, {"robots": robots})

    return made(Wrong)


@pytest.mark.parametrize(("what", "reported"), WRONG)
def test_what_cannot_be_said_is_reported(wrong, what, reported):
    wrong.reset(wrong.scenario)
    algorithm(wrong).what = what
    with pytest.raises(OwnAlgorithmError) as error:
        advance(wrong, 1)
    assert reported in str(error.value)
    assert "\n" not in str(error.value)


def test_nobody_is_meant(wrong):
    wrong.reset(wrong.scenario)
    algorithm(wrong).what = "robots.declare([]); robots.declare(False); robots.tell([1, 2], robots.robot > 9)"
    advance(wrong, 2)
    assert not wrong.swarm.snapshot()["declarations"].any()


@pytest.mark.parametrize("words", [-1, 17, "2", 1.0])
def test_a_message_has_a_few_numbers(words):
    own = type("Own", (), {"MESSAGE": words, "act": lambda *_: None})
    with pytest.raises(OwnAlgorithmError, match=r"MESSAGE of Own is .*, not a whole number from 0 to 16"):
        made(own)


def test_without_a_message_there_is_nothing_to_tell():
    class Mute:
        def act(self, robots: Any) -> None:
            robots.tell([1.0])

    with pytest.raises(OwnAlgorithmError, match="the class has no MESSAGE"):
        made(Mute).teams[0].act(1, 0.1, 0.1)
