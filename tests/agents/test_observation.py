"""What policies observe and command, against NumPy."""

import numpy as np
import pytest
from robots import EXTENT, group

from taichi_plume.agents.commands import Commands
from taichi_plume.agents.members import Members
from taichi_plume.agents.observation import Observation
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap

pytestmark = pytest.mark.usefixtures("taichi")

TICK, STEP = 0.1, 0.6
ALL = [
    "wind",
    "gas",
    "memory",
    "rise",
    "resistance",
    "bumper",
    "heading",
    "position",
    "action",
    "clock",
    "mates",
]
PLACES = np.array([[1.0, 1.0], [1.5, 1.2], [3.5, 2.5]])
HEADINGS = np.array([0.4, -2.0, 3.0])


class Learner:
    """Observation and commands of one team, driven from outside."""

    def __init__(self, communication=(("range", 2.0),), **keys):
        team = group(count=3, algorithm={"kind": "policy", **keys}, communication=dict(communication))
        clearance = ClearanceMap([], EXTENT, 0.2)
        self.swarm = Swarm([team], PLACES, HEADINGS, clearance, np.array([[1.0, 1.5]]), 0)
        members = Members(self.swarm, (0,))
        self.seen, self.commands = Observation(self.swarm, members, TICK), Commands(self.swarm, members, TICK)
        self.table = np.full((3, self.seen.size), np.nan, np.float32)

    @ti.kernel
    def sense(self, ppm: ti.types.ndarray(), wind_x: float, wind_y: float, ohm: float):
        for i in range(3):
            self.swarm.reading[i] = ppm[i]
            self.swarm.resistance[i] = ohm
            self.swarm.wind[i] = ti.Vector([wind_x, wind_y])
            self.seen.follow(i, TICK)

    @ti.kernel
    def talk(self, tick: int, t: float):
        for i in range(3):
            self.seen.send(i, tick)
        ti.loop_config(serialize=True)
        for i in range(3):
            self.seen.receive(i, tick, t)

    @ti.kernel
    def look(self, flip: float, elapsed: float, t: float, table: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        for i in range(3):
            self.seen.write(i, flip, i, table, elapsed, t)

    @ti.kernel
    def act(self, flip: float, actions: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        for i in range(3):
            self.commands.take(i, flip, i, actions, 1.0)

    @ti.kernel
    def drive(self):
        for i in range(3):
            self.commands.carry_out(i, TICK)

    @ti.kernel
    def forget(self):
        for i in range(3):
            self.seen.clear(i)
            self.commands.clear(i)

    def observe(self, flip=1.0, elapsed=0.0, t=0.0):
        self.look(flip, elapsed, t, self.table)
        assert (self.table >= np.tile(self.seen.low, (3, 1)) - 1e-6).all()
        assert (self.table <= np.tile(self.seen.high, (3, 1)) + 1e-6).all()
        return [dict(zip(self.seen.names, map(float, row), strict=True)) for row in self.table]


@pytest.fixture
def fresh(taichi):
    learner = Learner(observe=ALL, memory=(1.0, 5.0), history=2, step=STEP, declares=True)
    learner.forget()
    return learner


def entry(ppm):
    return np.clip(np.log10(1.0 + ppm) / 6.0, 0.0, 1.0)


def test_entries_are_what_sensors_give(fresh):
    ppm = np.array([0.0, 99.0, 3e6], np.float32)
    for _ in range(7):
        fresh.sense(ppm, 0.3, -0.4, 1e5)
    fresh.talk(1, 0.1)
    seen = fresh.observe(elapsed=4.0, t=5.1)
    upwind = np.array([-0.6, 0.8])
    for k, one in enumerate(seen):
        ahead = np.array([np.cos(HEADINGS[k]), np.sin(HEADINGS[k])])
        left = np.array([-ahead[1], ahead[0]])
        gas = entry(ppm[k])
        assert one["gas"] == pytest.approx(gas, abs=1e-6)
        assert one["rise"] == pytest.approx(gas, abs=1e-6)
        for time in (1.0, 5.0):
            assert one[f"gas over {time:g} s"] == pytest.approx(gas * (1 - np.exp(-0.7 / time)), abs=1e-5)
        assert one["upwind ahead"] == pytest.approx(upwind @ ahead, abs=1e-6)
        assert one["upwind left"] == pytest.approx(upwind @ left, abs=1e-6)
        assert one["wind speed"] == pytest.approx(0.5)
        assert one["resistance"] == pytest.approx(0.5, abs=1e-6)
        assert [one["heading cos"], one["heading sin"]] == pytest.approx(ahead, abs=1e-6)
        place = 2 * PLACES[k] / EXTENT - 1
        assert [one["position x"], one["position y"]] == pytest.approx(place, abs=1e-6)
        assert one["clock"] == pytest.approx(4 / 64)
        apart = np.linalg.norm(PLACES - PLACES[k], axis=1)
        heard = [m for m in np.argsort(apart) if m != k and apart[m] <= 2.0]
        for m, other in enumerate([*heard, None, None][:2], start=1):
            wanted = [0.0] * 4
            if other is not None:  # 5 s ago
                way = PLACES[other] - PLACES[k]
                wanted = [0.5, way @ ahead / 5.0, way @ left / 5.0, entry(ppm[other])]
            reported = [one[f"mate {m} {name}"] for name in ("heard", "ahead", "left", "gas")]
            assert reported == pytest.approx(wanted, abs=1e-6)


def test_messages_have_a_rate_a_loss_and_an_age(taichi):
    """Of three robots in range each, half of the messages in every fifth tick arrive; only the nearest is observed."""
    learner = Learner({"loss": 0.5, "rate": 2.0}, observe=("mates",), neighbours=1)
    learner.forget()
    assert learner.seen.names == ("mate 1 heard", "mate 1 ahead", "mate 1 left", "mate 1 gas")
    times = []
    for tick in range(1, 1001):
        learner.sense(np.full(3, float(tick), np.float32), 0.0, 0.0, np.nan)
        learner.talk(tick, TICK * tick)
        times.append(learner.seen.radio.time.to_numpy())
    heard = np.diff(np.array(times, float), axis=0) > 0.0
    assert set((np.flatnonzero(heard.any(axis=(1, 2))) + 1) % 5) == {0}
    assert heard.mean(axis=0)[~np.eye(3, dtype=bool)] == pytest.approx(0.1, abs=0.025)
    last = times[-1][0, 1]
    assert last <= 99.6
    one = learner.observe(t=100.0)[0]
    assert one["mate 1 heard"] == pytest.approx(5.0 / (5.0 + 100.0 - last), abs=1e-4)
    assert one["mate 1 gas"] == pytest.approx(entry(last / TICK), abs=1e-5)


def test_what_was_observed_is_stacked(fresh):
    fresh.sense(np.full(3, 9.0, np.float32), 0.0, 0.0, np.nan)
    first = fresh.observe()[0]
    assert first["resistance"] == first["wind speed"] == first["gas, 1 decisions before"] == 0.0
    fresh.sense(np.full(3, 99.0, np.float32), 0.0, 0.0, np.nan)
    second = fresh.observe()[0]
    now = {name for name in first if not name.endswith("before")}
    assert all(second[f"{name}, 1 decisions before"] == first[name] for name in now)
    assert second["rise"] == pytest.approx(1 / 6, abs=1e-6)
    fresh.forget()
    fresh.sense(np.zeros(3, np.float32), 0.0, 0.0, np.nan)
    assert fresh.observe()[0]["gas, 1 decisions before"] == 0.0


def test_in_a_mirror_left_is_right(fresh):
    fresh.sense(np.zeros(3, np.float32), 0.3, -0.4, np.nan)
    fresh.talk(1, 0.0)
    true = fresh.observe()
    mirrored = fresh.observe(flip=-1.0)
    turned = {"upwind left", "heading sin", "position y", "mate 1 left", "mate 2 left"}
    for name in true[0]:
        if not name.endswith("before") and name != "rise":
            sign = -1.0 if name in turned else 1.0
            assert [one[name] for one in mirrored] == pytest.approx([sign * one[name] for one in true])
    action = np.tile(np.array([0.0, 0.5, -1.0], np.float32), (3, 1))
    fresh.act(-1.0, action)
    fresh.drive()
    assert fresh.swarm.turn_rate_command.to_numpy()[:3] == pytest.approx(-0.5 * np.pi)


def test_speed_turn_and_word(fresh):
    action = np.array([[1.0, -1.0, 0.6], [-1.0, 0.5, 0.5], [0.0, 0.0, -1.0]], np.float32)
    fresh.act(1.0, action)
    fresh.drive()
    assert fresh.swarm.speed_command.to_numpy()[:3] == pytest.approx([0.2, 0.0, 0.1])
    assert fresh.swarm.turn_rate_command.to_numpy()[:3] == pytest.approx([-np.pi, 0.5 * np.pi, 0.0])
    reported = fresh.swarm.snapshot()
    assert reported["declarations"].tolist() == [1, 0, 0]
    assert reported["declared_position"][0] == pytest.approx(PLACES[0])


def test_way_points_are_reached(taichi):
    """Each robot ends where its action points to: so far ahead and to the left."""
    learner = Learner(act="waypoint", step=STEP, observe=("gas",))
    action = np.array([[1.0, 0.0], [0.5, 0.5], [0.0, -0.6]], np.float32)
    learner.forget()
    learner.act(1.0, action)
    for tick in range(1, 81):
        learner.drive()
        learner.swarm.move(tick, tick * TICK, TICK)
    ahead = np.stack([np.cos(HEADINGS), np.sin(HEADINGS)], axis=1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    goal = PLACES + STEP * (action[:, :1] * ahead + action[:, 1:2] * left)
    assert learner.swarm.snapshot()["position"] == pytest.approx(goal, abs=5e-3)
