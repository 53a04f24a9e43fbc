"""A run in a turned map of ROS as a bag, read by rosbags and by nav2's rules, by our maps and by a replay."""

from math import cos, sin
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from bag_run import cloud, messages_of
from PIL import Image

import taichi_plume as tp
from taichi_plume.__main__ import main
from taichi_plume.assembly.preparation import load
from taichi_plume.cli import run as run_command
from taichi_plume.files.bag_readings import BagOptions, read
from taichi_plume.files.ros_robots import MapFrame
from taichi_plume.serve.inbox import Inbox

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]
RESOLUTION, ORIGIN, BEGIN = 0.05, (-2.0, -1.0), 1_700_000_000.0
SCENARIO = """
name: turned
seed: 3
duration: 4
domain: {size: [3, 2], spacing: 0.1}
obstacles: [{kind: map, file: plan.yaml, unknown: free, CORNER}]
wind: {kind: synthetic, speed: 5 cm/s}
gas: {kind: eulerian, sources: [{position: [2.1, 1.0], rate: 10 mg/s}]}
robots:
  - name: r
    count: 2
    reach: 0
    start: {kind: positions, positions: [[2.2, 1.2], [2.0, 0.8]]}
    algorithm: {kind: random_walk}
    sensors: {gas: {kind: ideal}}
maps: [{kind: time_series, cell: 0.2, window: 1}]
fields: {rate: 2}
"""


class Made(NamedTuple):
    """A run in a map of ROS that is turned by `yaw` [rad]; corner: the domain's in the map, from its key or not."""

    folder: Path
    yaw: float
    corner: np.ndarray
    messages: dict[str, list[Any]]


def turned(yaw):
    return np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])


@pytest.fixture(scope="module", params=[(0.0, True), (np.pi / 2, False), (0.3, False)])
def made(request, tmp_path_factory) -> Made:
    yaw, given = request.param
    folder = tmp_path_factory.mktemp("turned")
    shade = np.full((80, 100), 254, np.uint8)
    shade[10:14, 30:70] = 0  # walls: rows from above
    shade[30:60, 8:11] = 0
    Image.fromarray(shade).save(folder / "plan.pgm")
    (folder / "plan.yaml").write_text(
        f"image: plan.pgm\nresolution: {RESOLUTION}\norigin: [{ORIGIN[0]}, {ORIGIN[1]}, {yaw}]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    corners = np.array([[0, 0], [5, 0], [0, 4], [5, 4]]) @ turned(yaw).T + ORIGIN
    corner = np.array([-1.75, 0.75]) if given else corners.min(axis=0)
    key = f"origin: [{corner[0]}, {corner[1]}]" if given else "base: 0"
    (folder / "s.yaml").write_text(SCENARIO.replace("CORNER", key))
    options = ["--out", str(folder / "run"), "--quiet", "--no-report", "--no-recording"]
    assert run_command.main([str(folder / "s.yaml"), *options]) == 0
    assert main(["export", str(folder / "run"), "--to", "mcap", "--begin", str(BEGIN)]) == 0
    messages = messages_of(folder / "run" / "bag")
    return Made(folder, yaw, corner, {topic: [one for _, one in its] for topic, its in messages.items()})


def cells_of(grid: Any) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 2) [m] and values (n,) of an OccupancyGrid, by nav2's rules."""
    info = grid.info
    q = info.origin.orientation
    yaw = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    i, j = np.meshgrid(np.arange(info.width), np.arange(info.height))
    local = np.column_stack([i.ravel() + 0.5, j.ravel() + 0.5]) * info.resolution
    return local @ turned(yaw).T + (info.origin.position.x, info.origin.position.y), grid.data


def test_walls_are_where_the_map_server_publishes_them(made):
    (grid,) = made.messages["/map"]
    assert grid.header.frame_id == "map"
    places, percent = cells_of(grid)
    np.testing.assert_allclose(places.min(axis=0), made.corner - 0.05, atol=1e-6)
    inside = ((places > made.corner) & (places < made.corner + np.array([3, 2]))).all(axis=1)
    assert inside.sum() == 600
    assert (percent[~inside] == 100).all(), "a border"
    places, percent = places[inside], percent[inside]
    shade = np.asarray(Image.open(made.folder / "plan.pgm"))
    row, column = np.nonzero(shade == 0)
    walls = np.column_stack([column + 0.5, len(shade) - row - 0.5]) * RESOLUTION @ turned(made.yaw).T + ORIGIN
    away = np.sqrt(((places[:, None] - walls) ** 2).sum(axis=-1)).min(axis=1)
    assert (percent[away < 0.01] == 100).all()
    assert (percent[away > 0.06] == 0).all()
    assert 5 < (percent == 100).sum() < 200


def test_robots_and_gas_are_published_in_the_map(made):
    table = tp.open_run(made.folder / "run").robots
    for k in (0, 1):
        rows = table[table.robot == k]
        wanted = rows[["x", "y"]].to_numpy() + made.corner
        truth = made.messages[f"/r_{k}/truth"]
        assert {one.header.frame_id for one in truth} == {"map"}
        np.testing.assert_allclose([(m.pose.position.x, m.pose.position.y) for m in truth], wanted, atol=1e-6)
        odom = [m.pose.pose.position for m in made.messages[f"/r_{k}/odom"]]
        np.testing.assert_allclose([(p.x, p.y) for p in odom], wanted, atol=1e-6)
        moved = [m.transforms[k].transform.translation for m in made.messages["/tf"]]
        np.testing.assert_allclose([(p.x, p.y) for p in moved], wanted, atol=1e-6)
    gas = made.messages["/plume/ethanol"][-1]
    points = cloud(gas)
    peak = points[points["ppm"].argmax()]
    assert gas.header.frame_id == "map"
    assert np.hypot(peak["x"] - made.corner[0] - 2.1, peak["y"] - made.corner[1] - 1.0) < 0.2
    places, _ = cells_of(made.messages["/gas_maps/map_0"][0])
    np.testing.assert_allclose(places.min(axis=0), made.corner + 0.1, atol=1e-6)


def test_our_reader_gives_the_same_positions_times_and_values(made):
    table = tp.open_run(made.folder / "run").robots
    robots = read(made.folder / "run" / "bag")
    for k, robot in enumerate(robots):
        rows = table[(table.robot == k) & (table.t > 0)]
        assert (robot.name, robot.frame, robot.remarks) == (f"r_{k}", "map", ())
        np.testing.assert_allclose(robot.read_at - BEGIN, rows.t, atol=1e-6)
        np.testing.assert_allclose(robot.at - made.corner, rows[["x", "y"]], atol=1e-6)
        np.testing.assert_array_equal(robot.ppm.astype(np.float32), rows.reading_ppm)
        np.testing.assert_allclose(robot.wind, rows[["wind_x", "wind_y"]], atol=1e-5)
    (_, second) = read(made.folder / "run" / "bag", BagOptions(reading=("/r_0/gas.raw", "/r_1/gas.raw")))
    np.testing.assert_array_equal(second.ppm, robots[1].ppm)
    np.testing.assert_allclose(second.at, robots[1].at)


def test_maps_of_the_bag_and_of_the_run_are_the_same(made):
    model = {"kind": "inverse_distance", "cell": "50 cm"}
    bag = tp.maps(made.folder / "run" / "bag", model, size=(3, 2), origin=made.corner.tolist())
    run = tp.maps(made.folder / "run", model)
    assert run.data.estimate.max() > 1
    np.testing.assert_allclose(bag.data.estimate, run.data.estimate, rtol=1e-3, atol=1e-3)
    fields = {"reading": ["/r_0/gas.raw", "/r_1/gas.raw"]}
    named = tp.maps(made.folder / "run" / "bag", model, size=(3, 2), origin=made.corner.tolist(), bag=fields)
    np.testing.assert_array_equal(named.data.estimate, bag.data.estimate)
    assert [line for line in named.readings.facts.remarks if "assumed to be ppm" in line]


@pytest.mark.parametrize("moved", [(0.0, 0.0), (-0.25, 0.5)])
def test_a_replay_in_a_map_goes_where_the_robot_went(made, moved):
    """Also in a domain with another corner; and a live pose of the same frame is there too."""
    corner = made.corner + moved
    table = tp.open_run(made.folder / "run").robots
    source: dict[str, Any] = {
        "duration": 2, "domain": {"size": [3, 2], "spacing": 0.1},
        "obstacles": [{"kind": "map", "file": "plan.yaml", "unknown": "free", "origin": corner.tolist()}],
        "wind": {"kind": "synthetic", "speed": "5 cm/s"},
        "gas": {"kind": "eulerian", "sources": [{"position": [1.2, 1.0], "rate": "10 mg/s"}]},
        "robots": [{"name": "real", "count": 2, "reach": 0, "algorithm": {"kind": "replay", "file": "run/bag"},
                    "start": {"kind": "positions", "positions": [[0.9, 0.8], [0.9, 0.4]]}}],
    }  # fmt: skip
    scenario, resources = load(source, folder=made.folder)
    facts = resources.facts["robots[0].algorithm"]
    assert facts.remarks == ()
    for part in ("2 robots", "4 s from 2023-11-14 22:13:20 UTC", "80 readings"):
        assert part in facts.text
    assert (
        "positions in frame map (origin at ({:.4g}, {:.4g}) m of the domain), x".format(*-corner)
        in facts.text
    )
    for k, way in enumerate(resources.recorded_paths("robots[0].algorithm")):
        rows = table[table.robot == k]
        np.testing.assert_allclose(way.place[:, :2] + moved, rows[["x", "y"]], atol=1e-6)
    frame = MapFrame.of(scenario, resources.obstacles)
    inbox = Inbox("real", 1, True, ((0, 0), (3, 2)), 1.0, frame=frame)
    inbox.hear_pose(0, live(corner + np.array([1.25, 0.5])))
    np.testing.assert_allclose(inbox.orders().position, [[1.25, 0.5]])
    source["robots"][0]["algorithm"]["origin"] = [0.1 - made.corner[0], -0.1 - made.corner[1]]
    (way, _) = load(source, folder=made.folder).resources.recorded_paths("robots[0].algorithm")
    np.testing.assert_allclose(way.place[:, :2] - [0.1, -0.1], table[table.robot == 0][["x", "y"]], atol=1e-6)


def live(place):
    from taichi_plume.files import ros_messages as ros

    pose = {"position": dict(zip("xy", place.tolist(), strict=True)), "orientation": ros.yawed(0.0)}
    header = {"frame_id": "map", "stamp": ros.time(1.0)}
    return ros.encode(ros.message("geometry_msgs/msg/PoseStamped", header=header, pose=pose))
