"""tp.Simulation with algorithms of one's own: changes during a run, groups of one algorithm, classes of one name."""

from collections.abc import Iterator

import numpy as np
import pytest

import taichi_plume as tp
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.scenario.vocabulary import AT_START, Model, marked

pytestmark = pytest.mark.usefixtures("taichi")

GROUP = {"count": 1, "algorithm": {"kind": "casting", "speed": 0.1}}
DATA = {
    "duration": 3.0, "domain": {"size": [2, 1.5], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.5, 0.0]},
    "gas": {
        "kind": "gaussian_plume", "intensity": 0.1, "sources": [{"position": [0.2, 0.75], "rate": "10 mg/s"}],
    },
    "robots": [
        GROUP | {"name": "a", "start": {"kind": "positions", "positions": [[1.5, 0.4]], "heading_deg": 0}},
        GROUP | {"name": "b", "start": {"kind": "positions", "positions": [[1.5, 1.1]], "heading_deg": 0}},
    ],
}  # fmt: skip


class Ramp:
    """Drives faster from tick to tick; its count of ticks is its state."""

    def __init__(self, step=0.01):
        if step > 1:
            raise ValueError("too steep")
        self.step, self.ticks = step, 0

    def act(self, robots):
        self.ticks += 1
        robots.speed[:] = self.step * self.ticks


class SavedRamp(Ramp):
    """Ramp whose state moves to a new object, unless the new one is too steep."""

    def state(self):
        return self.ticks

    def restore(self, state):
        if self.step > 0.5:
            raise ValueError("too steep to go on")
        self.ticks = state


def simulation(*algorithms: type, **parameters: float) -> tp.Simulation:
    own = {f"robots.{n}.algorithm": tp.Own(one, **parameters) for n, one in enumerate(algorithms)}
    return tp.Simulation(DATA, overrides=own)


@pytest.mark.parametrize("ramp", [Ramp, SavedRamp])
def test_a_change_keeps_the_state_of_an_algorithm_of_ones_own(ramp):
    sim, beside = simulation(ramp, step=0.01), simulation(ramp, step=0.01)
    for one in (sim, beside):
        one.run(until=1.0)
    sim.change({"robots.1.algorithm.speed": 0.15, "gas.sources.0.rate": "20 mg/s"})
    for one in (sim, beside):
        one.run(until=2.0)
    np.testing.assert_array_equal(sim.robots.x[0], beside.robots.x[0])
    most, half = (float(one.gas.ethanol_ppm.max()) for one in (sim, beside))
    assert most == pytest.approx(2 * half, rel=1e-5)


def test_other_parameters_need_a_state_that_can_be_moved():
    plain, saved = simulation(Ramp, step=0.01), simulation(SavedRamp, step=0.01)
    for sim in (plain, saved):
        sim.run(until=1.0)
    speed = "robots.0.algorithm.parameters.step"
    before = plain.robots
    with pytest.raises(tp.ScenarioError, match=r"robots\[0\]\.algorithm\.parameters: .*Ramp.*state\(\)"):
        plain.change({speed: 0.02, "duration": 5})
    assert plain.robots.equals(before)
    assert plain.scenario.duration == 3.0
    saved.change({speed: 0.02})
    saved.step(2)  # a command moves the robot in the next tick
    assert saved.loop.swarm.speed_command.to_numpy()[0] == pytest.approx(12 * 0.02)
    now = saved.robots
    for wrong in (2.0, 0.6):  # refused by the constructor, by restore()
        with pytest.raises(OwnAlgorithmError, match="too steep"):
            saved.change({speed: wrong})
        assert saved.robots.equals(now)
    saved.step()
    assert saved.loop.swarm.speed_command.to_numpy()[0] == pytest.approx(13 * 0.02)
    with pytest.raises(OwnAlgorithmError, match="too steep"):
        saved.reset(overrides={speed: 2.0})
    assert saved.t == pytest.approx(1.3)
    saved.step()
    assert saved.loop.swarm.speed_command.to_numpy()[0] == pytest.approx(14 * 0.02)


def sections(model: type[Model] = Model) -> Iterator[type[Model]]:
    for below in model.__subclasses__():
        yield below
        yield from sections(below)


def test_the_documentation_names_the_keys_that_cannot_change_during_a_run():
    refused = {
        key for model in sections() for key in model.model_fields if marked(model, key, AT_START)
    }  # fmt: skip
    assert {"seed", "warm_up", "start", "initial"} <= refused
    for key in refused:
        assert f"`{key}`" in str(tp.Simulation.change.__doc__)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("seed", 5),
        ("air_seed", 5),
        ("warm_up", "2 s"),
        ("robots.0.start.positions", [[1.4, 0.4]]),
        ("robots.0.start.heading_deg", 10),
    ],
)
def test_what_acts_at_the_start_alone_cannot_change_during_a_run(taichi, key, value):
    sim = simulation()
    sim.run(until=0.5)
    with pytest.raises(tp.ScenarioError, match=r"start.*reset") as error:
        sim.change({key: value, "duration": 5})
    assert error.value.lines[0].startswith(key.replace(".0.", "[0]."))
    assert sim.scenario.duration == 3.0
    sim.reset(overrides={key: value})


def test_groups_of_one_algorithm_share_the_names_of_its_states():
    robots = simulation().robots
    assert robots.group.tolist() == ["a", "b"]
    assert robots.state.nunique() == 1
    assert robots.state.cat.categories.is_unique


def test_classes_of_one_name_are_two_algorithms():
    def made(pace: float) -> type:
        class Drive:
            def act(self, robots):
                robots.speed[:] = pace

        return Drive

    still, moving = made(0.0), made(0.1)
    sim = simulation(still, moving)
    before = sim.robots
    sim.run(until=1.0)
    moved = np.hypot(sim.robots.x - before.x, sim.robots.y - before.y)
    assert moved.to_numpy() == pytest.approx([0.0, 0.1 * 0.9], abs=1e-3)  # commands come at the end of a tick
    assert tp.Own(moving) == tp.Own(moving)
