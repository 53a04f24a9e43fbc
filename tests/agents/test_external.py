"""Robots that are driven from outside: orders in, readings out, and how others meet them."""

from pathlib import Path

import numpy as np
import pytest
from robots import room, team

from taichi_plume.agents.external import DRIVEN, LOST, Orders
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import checked
from taichi_plume.scenario.loading import ScenarioError, scenario_from

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

IDEAL = {"kind": "ideal"}
PLUME = {
    "kind": "gaussian_plume",
    "diffusivity": 0.002,
    "sources": [{"position": [0.5, 1.5], "rate": "10 mg/s"}],
}
POSE = {"algorithm": {"kind": "external", "takes": "pose"}, "sensors": {"gas": IDEAL}}
REAL = team([3, 1], [3, 2], name="real", trials=2, **POSE)
BOTH = {"algorithm": {"kind": "external"}, "sensors": {"gas": IDEAL, "wind": IDEAL}}
REMOTE = team([2, 0.5], name="remote", trials=2, heading_deg=0, **BOTH)
SCENARIO = room(REAL, REMOTE, gas=PLUME, duration=20.0)


@pytest.fixture(scope="module")
def made(taichi):
    return assemble(scenario_from(SCENARIO), driven=True)


@pytest.fixture
def sim(made):
    made.reset()
    while made.tick < 0:
        made.advance()
    return made


def algorithm(sim, name):
    numbers = {group.name: group.number for group in sim.swarm.groups}
    return next(team.algorithm for team in sim.teams if numbers[name] in team.numbers)


def robots(sim, name):
    group = next(group for group in sim.swarm.groups if group.name == name)
    return {key: values[group.slice] for key, values in sim.swarm.snapshot().items()}


def placed(places, heading=0.0) -> Orders:
    orders = Orders.none(len(places))
    orders.position[:], orders.heading[:], orders.state[:] = places, heading, DRIVEN
    return orders


def test_they_wait_until_they_are_reported(sim):
    before = sim.swarm.snapshot()["position"]
    for _ in range(5):
        sim.advance()
    np.testing.assert_array_equal(sim.swarm.snapshot()["position"], before)
    assert [team.state_names for team in sim.teams] == [("AWAITED", "DRIVEN", "LOST")] * 2


def test_a_robot_is_where_it_is_said_to_be_and_smells_there(sim):
    """As a robot that stands at the same place from the begin on."""
    places = np.array([[1.5, 1.5], [2.5, 1.6], [1.0, 1.4], [3.5, 1.5]])
    algorithm(sim, "real").order(placed(places, 0.5), sim.t)
    sim.advance()
    reported = algorithm(sim, "real").sample()
    np.testing.assert_allclose(reported["believed_position"], places, rtol=1e-6)
    np.testing.assert_allclose(reported["believed_heading"], 0.5)
    other = assemble(scenario_from(SCENARIO | {"robots": [team(*places.tolist(), **POSE)]}), driven=True)
    while other.tick < 1:
        other.advance()
    assert reported["reading"].min() > 0.1
    np.testing.assert_allclose(reported["reading"][:, 0], other.swarm.snapshot()["reading_ppm"], rtol=1e-5)


def test_a_real_robot_drives_and_jumps(sim):
    start = np.tile([[3.0, 1.0], [3.0, 2.0]], (2, 1))
    for k in range(1, 4):
        algorithm(sim, "real").order(placed(start - [0.01 * k, 0.0]), sim.t)
        sim.advance()
    assert robots(sim, "real")["path_length"] == pytest.approx(0.03, abs=1e-6)
    assert sim.swarm.velocity.to_numpy()[:4] == pytest.approx(np.tile([-0.1, 0.0], (4, 1)), abs=1e-5)
    algorithm(sim, "real").order(placed(start - [2.0, 0.0]), sim.t)  # its cameras had lost it
    sim.advance()
    assert np.hypot(*sim.swarm.velocity.to_numpy()[0]) == pytest.approx(0.2)  # as fast as its body can


def test_one_that_is_not_reported_stays(sim):
    orders = placed(np.tile([[3.0, 1.0], [3.0, 2.0]], (2, 1)) - [0.5, 0.0])
    orders.position[1:] = np.nan
    algorithm(sim, "real").order(orders, sim.t)
    sim.advance()
    moved = robots(sim, "real")["position"] - np.tile([[3.0, 1.0], [3.0, 2.0]], (2, 1))
    np.testing.assert_allclose(moved, [[-0.5, 0], [0, 0], [0, 0], [0, 0]], atol=1e-6)


def test_a_remote_robot_drives_as_commanded_and_stops(sim):
    remote = algorithm(sim, "remote")
    orders = Orders.none(2)
    orders.speed[:], orders.turn_rate[:], orders.state[:] = [0.1, 0.1], [0.0, 0.5], DRIVEN
    remote.order(orders, sim.t)
    for _ in range(20):
        sim.advance()
    now = robots(sim, "remote")
    assert now["position"][0] == pytest.approx([2.2, 0.5], abs=1e-4)
    # the arc of radius v / w
    assert now["position"][1] == pytest.approx(
        [2 + 0.2 * np.sin(1.0), 0.5 + 0.2 * (1 - np.cos(1.0))], abs=1e-3
    )
    assert remote.sample()["wind"][0] == pytest.approx([0.5, 0.0], abs=1e-5)
    orders = Orders.none(2)
    orders.state[:] = LOST
    remote.order(orders, sim.t)
    sim.advance()
    assert (robots(sim, "remote")["state"] == LOST).all()
    np.testing.assert_array_equal(robots(sim, "remote")["position"], now["position"])


def test_simulated_robots_stop_before_real_ones_of_their_trial(sim):
    """In trial 0 a real robot stands in the way, in trial 1 it does not."""
    places = np.array([[2.6, 0.5], [3.0, 2.0], [3.0, 1.5], [3.0, 2.0]])
    algorithm(sim, "real").order(placed(places), sim.t)
    orders = Orders.none(2)
    orders.speed[:], orders.state[:] = 0.2, DRIVEN
    algorithm(sim, "remote").order(orders, sim.t)
    for _ in range(40):
        sim.advance()
    now = robots(sim, "remote")
    assert now["position"][0, 0] == pytest.approx(2.6 - 2 * 0.08, abs=3e-3)
    assert now["blocked"].tolist() == [True, False]
    assert now["position"][1, 0] == pytest.approx(2.8, abs=1e-3)


def test_it_may_declare(sim):
    orders = Orders.none(2)
    orders.declared[1] = [0.6, 1.4]
    algorithm(sim, "remote").order(orders, 3.0)
    now = robots(sim, "remote")
    assert now["declarations"].tolist() == [0, 1]
    assert now["false_declarations"].tolist() == [0, 0]


def test_a_real_robot_goes_on_when_it_has_found_the_source(sim):
    algorithm(sim, "real").order(placed(np.array([[0.6, 1.5], [3, 2], [3, 1], [3, 2]])), sim.t)
    sim.advance()
    assert robots(sim, "real")["found"].tolist() == [True, False, False, False]
    algorithm(sim, "real").order(placed(np.array([[0.9, 1.5], [3, 2], [3, 1], [3, 2]])), sim.t)
    sim.advance()
    assert robots(sim, "real")["position"][0] == pytest.approx([0.9, 1.5])


def test_what_is_wrong_is_reported():
    with pytest.raises(ScenarioError, match=r"robots\[0\].algorithm: external: nothing drives"):
        assemble(scenario_from(SCENARIO))
    group = REAL | {"localization": {"kind": "odometry"}}
    with pytest.raises(ScenarioError, match=r"robots\[0\].localization: the poses of these robots come"):
        checked(scenario_from(SCENARIO | {"robots": [group]}), Path())
