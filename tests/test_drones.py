"""Whole runs with drones: what they smell, where they search, what is reported about them, and what is refused."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from taichi_plume import open_run
from taichi_plume.__main__ import main
from taichi_plume.agents.casting_3d import RISE
from taichi_plume.agents.external import Orders
from taichi_plume.api.own import Own
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.cli import run
from taichi_plume.execution.signals import SignalRequests
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import TRANSFORMS
from taichi_plume.grid.fields import ppm_at
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scoring.trials import trial_outcomes
from taichi_plume.serve.service import Pace, Service

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SCENARIO = """
duration: 60
domain: {size: [5, 3, 2.4], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0, 0]}
gas:
  kind: gaussian_plume
  intensity: 0.08
  walls: []
  sources: [{position: [0.8, 1.6, 1.5], rate: 20 mg/s, radius: 0.1}]
robots:
  - name: flock
    count: 2
    start: {kind: positions, positions: [[4.6, 0.5], [4.4, 2.6]], heading_deg: 180, altitude: 0.8}
    algorithm: {kind: casting_3d, threshold_ppm: 2, speed: 0.5}
    body: {kind: crazyflie}
    sensors: {gas: {kind: ideal, height: 0.2}, wind: {kind: ideal}}
"""


POSED = """
  - name: floor
    count: 1
    start: {kind: positions, positions: [[3.4, 1.7]]}
    algorithm: {kind: external, takes: pose}
    sensors: {gas: {kind: ideal, height: 0.1}, wind: {kind: ideal}}
    body: {kind: drone}
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "flock.yaml").write_text(SCENARIO)
    return tmp_path / "flock.yaml"


@pytest.fixture(scope="module")
def flock(taichi, tmp_path_factory):
    """Reset the simulation that tests share, with some keys changed."""
    path = tmp_path_factory.mktemp("flock") / "flock.yaml"
    path.write_text(SCENARIO)
    sim = assemble(load_scenario(path), path.parent)

    def reset(*keys):
        sim.reset(load_scenario(path, keys))
        return sim

    return reset


class Flock:
    """Two drones that fly to places for 8 s, and then by their speeds."""

    def __init__(self):
        self.altitudes = []

    def act(self, robots):
        if robots.t < 8:
            robots.go_to([2.0, 3.0], [1.6, 1.4], 1.3, heading=0.5)
        robots.left_speed, robots.climb_rate = 0.2, np.array([0.1, -0.1])
        self.altitudes.append(robots.altitude.copy())


def test_casting_in_space_finds_a_source_above_where_it_starts(flock):
    """Both start 0.7 m lower than the source."""
    sim = flock()
    sim.run()
    now = sim.swarm.snapshot()
    assert now["found"].all()
    middle = np.column_stack([now["position"], now["altitude"] + 0.029 / 2])
    assert (np.linalg.norm(middle - [0.8, 1.6, 1.5], axis=1) <= 0.35 + 1e-4).all()
    assert sim.t < 60


def test_casting_in_space_rises_whole_steps(flock):
    """Without gas: after each wall by `find_rise`, or to the lowest or highest altitude."""
    sim = flock("robots.0.algorithm.threshold_ppm=1e6", "robots.0.start.positions=[[4, 1], [0.2, 2.8]]")
    model = sim.scenario.robots[0].algorithm
    seen = []
    while sim.t < 59.9:
        sim.advance()
        now = sim.swarm.snapshot()
        seen.append((now["state"][0] == RISE, now["altitude"][0]))
    rising, z = np.array(seen).T
    begins, ends = (np.flatnonzero(np.diff(rising) == step) for step in (1, -1))
    rises = [(z[a], z[b]) for a, b in zip(begins, ends[ends > begins[0]], strict=False)]
    assert len(rises) > 5
    for low, high in rises:
        whole = abs(high - low) > 0.9 * model.find_rise
        assert whole or high < model.lowest + 0.06 or high > model.highest - 0.06, (low, high)


def test_segments_of_casts_in_space_alternate(flock):
    """Segments 0, 2 ... of a cast are horizontal, 1 along the vertical sense and 3 against it; RISE is along it."""
    short = (f"robots.0.algorithm.{key}=0.05" for key in ("cast_distance", "cast_rise"))
    sim = flock("robots.0.reach=0", *short)  # casts upwind of the source see no gas
    names, seen = sim.state_names()[0], set()
    vertical = {("RISE", 0): 1.0, ("CAST", 1): 1.0, ("CAST", 3): -1.0}
    while sim.t < 50:
        sim.advance()
        now, command = sim.decisions(), sim.swarm.climb_command.to_numpy()
        for n, number in enumerate(sim.swarm.snapshot()["state"]):
            state, sense = names[number], -1.0 if now["vertical_sense"][n] < 0 else 1.0
            case = (state, int(now["cast_segment"][n]) % 4 if state == "CAST" else 0)
            assert command[n] == pytest.approx(0.5 * sense * vertical.get(case, 0.0)), case
            seen.add(case)
    assert {("RISE", 0), *(("CAST", k) for k in range(4))} <= seen


def test_sensors_and_scores_of_drones_are_in_space(flock):
    """Scores count from the middle of a body, here straight below the source; sensors are above its feet."""
    sim = flock("robots.0.start.positions=[[0.8, 1.6], [3.4, 1.7]]")
    sim.observe()
    (group,) = sim.swarm.groups
    reported = trial_outcomes(sim, group, sim.swarm.snapshot())
    assert reported["final_distance_m"][0] == pytest.approx(1.5 - 0.8 - group.model.body.height / 2, abs=1e-5)
    keys = "robots.0.start.positions=[[3.4, 1.7], [3.8, 1.5]]", "gas.sources.0.position=[0.8, 1.6, 1.0]"
    sim = flock(*keys)
    sim.advance()
    now = sim.swarm.snapshot()
    noses = np.column_stack([now["position"], now["altitude"] + 0.2])
    assert now["true_ppm"].min() > 1.0
    assert now["true_ppm"] == pytest.approx(ppm_at(sim.gas, noses, sim.t)[:, 0], rel=1e-5)


def test_an_own_algorithm_flies_drones(path):
    scenario = load_scenario(path, {"robots.0.algorithm": Own(Flock), "duration": 10})
    sim = assemble(scenario, path.parent)
    while sim.t < 7.95:
        sim.advance()
    now = sim.swarm.snapshot()
    np.testing.assert_allclose(now["position"], [[2.0, 1.6], [3.0, 1.4]], atol=5e-3)
    np.testing.assert_allclose(now["altitude"], 1.3, atol=5e-3)
    np.testing.assert_allclose(now["heading"], 0.5, atol=1e-3)
    sim.run()
    now = sim.swarm.snapshot()
    np.testing.assert_allclose(now["climb_rate"], [0.1, -0.1], atol=1e-5)
    left = np.array([-np.sin(0.5), np.cos(0.5)])
    np.testing.assert_allclose((now["position"] - [[2.0, 1.6], [3.0, 1.4]]) @ left, 0.4, atol=0.03)
    seen = np.array(sim.teams[0].algorithm.algorithm.altitudes)
    assert seen[0] == pytest.approx(0.8)
    assert np.abs(seen[79] - 1.3).max() < 5e-3


WAKE = """
name: wake
duration: 1.5
domain: {size: [1.6, 1.2, 1.2], spacing: 0.1}
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-, speed: 0.2}, {kind: outlet, face: x+}]
gas: {kind: eulerian, sources: [{position: [0.4, 0.6, 0.9], rate: 10 mg/s}]}
robots:
  - name: flock
    count: 1
    start: {kind: positions, positions: [[1.0, 0.6]], altitude: 0.7, heading_deg: 0}
    algorithm: {kind: casting}
    body: {kind: crazyflie}
    reach: 0.1
    wake: true
"""


def test_a_run_with_downwash_leaves_altitudes(tmp_path):
    (tmp_path / "wake.yaml").write_text(WAKE)
    options = ["--out", str(tmp_path / "out"), "--quiet", "--no-recording"]
    assert run.main([str(tmp_path / "wake.yaml"), *options]) == 0
    table = pq.read_table(tmp_path / "out/robots.parquet")
    assert table["z"].to_numpy() == pytest.approx(0.7, abs=1e-5)
    assert table.schema.field("z").metadata[b"unit"] == b"m"
    assert (tmp_path / "out/report.html").exists()
    check_bag(tmp_path)
    check_replay(tmp_path)


def check_bag(folder):
    """It tells how high the drone is, and how high on it the sensors are."""
    from rosbags.highlevel import AnyReader

    assert main(["export", str(folder / "out"), "--to", "mcap"]) == 0
    with AnyReader([folder / "out/bag"]) as reader:
        said = [(one.topic, reader.deserialize(data, one.msgtype)) for one, _, data in reader.messages()]
    for topic in ("/flock_0/odom", "/flock_0/truth"):
        poses = [getattr(one.pose, "pose", one.pose) for name, one in said if name == topic]
        assert [one.position.z for one in poses] == pytest.approx([0.7] * len(poses), abs=1e-5)
        assert len(poses) == 16
    speeds = [one.twist.twist.linear for name, one in said if name == "/flock_0/odom"]
    way = np.hypot(*np.diff([(one.position.x, one.position.y) for one in poses], axis=0).T)
    assert np.array([np.hypot(one.x, one.y) for one in speeds[1:]]) * 0.1 == pytest.approx(way, abs=1e-5)
    assert way.max() > 0.01
    moved = [one.transforms[0].transform.translation.z for name, one in said if name == "/tf"]
    assert moved == pytest.approx([0.7] * 16, abs=1e-5)
    (still,) = (one.transforms for name, one in said if name == "/tf_static")
    assert {one.child_frame_id: one.transform.translation.z for one in still} == {
        "flock_0/odom": 0.0,
        "flock_0/gas_sensor": 0.1,
        "flock_0/anemometer": 0.1,
    }


def check_replay(folder):
    """Of the run and of its bag: where it was, in space."""
    world, robots = WAKE.replace("    wake: true\n", "").replace("0.7, h", "0.2, h").split("  - name: flock")
    robots = robots.replace("reach: 0.1", "reach: 0")
    again = [
        f"  - name: {name}" + robots.replace("kind: casting", f"kind: replay, file: out/{file}")
        for name, file in (("run", "robots.parquet"), ("bag", "bag"))
    ]
    (folder / "again.yaml").write_text(world + "".join(again))
    keys = ["wind={kind: uniform, velocity: [0.2, 0, 0]}", "rivals=true"]
    sim = assemble(load_scenario(folder / "again.yaml", keys), folder)
    for _ in range(5):
        sim.advance()
    now = sim.swarm.snapshot()
    table = open_run(folder / "out").robots.set_index("t").loc[sim.t]
    assert now["altitude"] == pytest.approx([0.7, 0.7], abs=1e-5)
    assert now["position"] == pytest.approx(np.array([[table.x, table.y]] * 2), abs=1e-4)


def test_drones_are_driven_from_outside(path):
    """One by velocities in three directions, one put to poses in space."""
    with path.open("a") as file:
        file.write(POSED)
    keys = ["rivals=true", "robots.0.algorithm={kind: external}", "robots.0.count=1"]
    keys += ["robots.0.start.positions=[[3.0, 1.0]]"]
    sim = assemble(load_scenario(path, keys), path.parent, driven=True)
    speeds, poses = (team.algorithm for team in sim.teams)
    orders = Orders.none(1)
    orders.speed[:], orders.left, orders.climb = 0.3, np.array([0.1]), np.array([0.2])
    speeds.order(orders, 0.0)
    orders = Orders.none(1)
    orders.position[:], orders.altitude = [1.5, 2.0], np.array([1.7])
    poses.order(orders, 0.0)
    for _ in range(20):
        sim.advance()
    now = sim.swarm.snapshot()
    np.testing.assert_allclose(now["position"], [[3.0 - 0.6, 1.0 - 0.2], [1.5, 2.0]], atol=0.03)
    np.testing.assert_allclose(now["altitude"], [0.8 + 0.4, 1.7], atol=0.03)
    link = Link()
    service = Service(Pace(), [link], quiet=True)
    service.attach(sim, SignalRequests())
    service.publish()
    service.close()
    reported = ros.decode(TRANSFORMS, dict(link.messages)["tf"]).transforms
    bodies = [one.transform.translation.z for one in reported if one.child_frame_id.endswith("/base_link")]
    assert bodies == pytest.approx(now["altitude"].tolist())


class Link:
    """Keeps what it is asked for."""

    def __init__(self):
        self.messages = []

    def listen(self, incoming, stray):
        assert {"flock/commands", "flock_0/cmd_vel", "floor_0/pose"} <= set(incoming)

    def wants(self, topic, name):
        return True

    def publish(self, topic, data):
        self.messages.append((topic, data))

    def announce_time(self, t):
        pass

    def close(self):
        pass


def test_drones_fly_again_as_before(flock):
    """After a reset, and from a state that was saved in between."""
    sim = flock("duration=10")
    state = State(sim)
    while sim.t < 4.95:
        sim.advance()
    saved = state.save()
    sim.run()
    first = sim.swarm.snapshot()
    state.restore(saved)
    sim.run()
    again = sim.swarm.snapshot()
    sim.reset()
    sim.run()
    for name, values in sim.swarm.snapshot().items():
        np.testing.assert_array_equal(values, first[name], err_msg=name)
        np.testing.assert_array_equal(again[name], first[name], err_msg=name)


def test_a_drone_starts_above_a_box_but_not_in_it(tmp_path):
    (tmp_path / "wake.yaml").write_text(WAKE)
    box = "obstacles=[{kind: box, center: [1.0, 0.6, 0.3], size: [0.4, 0.4, 0.6]}]"
    load_scenario(tmp_path / "wake.yaml", [box])
    with pytest.raises(ScenarioError, match=r"robot 0 at \(1, 0.6\) m is inside obstacles\[0\]"):
        load_scenario(tmp_path / "wake.yaml", [box, "robots.0.start.altitude=0.55"])


def test_drones_need_the_third_dimension(path):
    flat = ["domain.size=[5, 3]", "wind.velocity=[0.5, 0]", "gas.sources.0.position=[0.8, 1.6]"]
    with pytest.raises(ScenarioError, match=r"robots\[0\].body.kind: a crazyflie needs a 3-D run"):
        load_scenario(path, [*flat, "obstacles=[]", "gas.walls=[]"])
