"""A run as a bag of ROS 2, read by two libraries of others: what is in it is what is in the run's own files."""

import subprocess
import sys
from math import atan2
from pathlib import Path

import bag_run
import made_run
import numpy as np
import pytest
import rerun as rr
from bag_run import cloud, messages_of
from scripts import refusal

from taichi_plume import __version__, open_run
from taichi_plume.__main__ import main
from taichi_plume.cli import maps
from taichi_plume.cli import run as run_command
from taichi_plume.files import disk
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.readings import read
from taichi_plume.files.ros_robots import MapFrame
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results import bag_of_fields, bag_of_run

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]
BEGIN = 1_700_000_000.0
TOPICS = {"topic": "gas", "pose": "odom"}


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A run that has ended."""
    return bag_run.made(tmp_path_factory.mktemp("bags"))


@pytest.fixture(scope="module")
def bag(run) -> Path:
    """Its second trial as a bag."""
    assert main(["export", str(run), "--to", "mcap", "--trial", "1", "--begin", str(BEGIN)]) == 0
    return run / "bag"


@pytest.fixture(scope="module")
def said(bag) -> dict[str, list]:
    return messages_of(bag)


def angle(q):
    return atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def numbers(messages, get):
    return np.array([get(one) for _, one in messages])


def test_counts_and_values_are_those_of_the_table(run, said):
    table = open_run(run).robots
    table = table[table.trial == 1]
    robots = {one.split("/")[1] for one in said if one.endswith("odom")}
    assert robots == {"oxides_0", "oxides_1"}, "the other group has one trial only"
    for k in (0, 1):
        rows = table[(table.group == "oxides") & (table.robot == k)]
        gas, wind, odom, truth = (said[f"/oxides_{k}/{name}"] for name in ("gas", "wind", "odom", "truth"))
        for topic in (odom, truth):
            np.testing.assert_allclose([t * 1e-9 - BEGIN for t, _ in topic], rows.t, atol=1e-6)
        np.testing.assert_array_equal(numbers(odom, lambda m: m.pose.pose.position.x), rows.believed_x)
        np.testing.assert_array_equal(numbers(odom, lambda m: m.pose.pose.position.y), rows.believed_y)
        np.testing.assert_array_equal(numbers(truth, lambda m: m.pose.position.x), rows.x)
        heading = numbers(odom, lambda m: angle(m.pose.pose.orientation))
        np.testing.assert_allclose(np.exp(1j * heading), np.exp(1j * rows.believed_heading), atol=1e-6)
        measured = rows[rows.t > 0]
        np.testing.assert_array_equal(numbers(gas, lambda m: m.raw), measured.resistance_ohm)
        speed = numbers(wind, lambda m: m.wind_speed)
        to = numbers(wind, lambda m: m.wind_direction) + heading[1:]
        np.testing.assert_allclose(speed * np.cos(to), measured.wind_x, atol=1e-5)
        np.testing.assert_allclose(speed * np.sin(to), measured.wind_y, atol=1e-5)
        stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for _, m in gas]
        np.testing.assert_allclose(stamps, measured.t + BEGIN, atol=1e-6)
    assert len(said["/clock"]) == len(rows)


def test_options_of_bags_are_of_bags(run, capsys):
    for options, reported in (
        (["--to", "csv", "--trial", "0"], "--trial: is only for --to mcap, plumesim"),
        (["--to", "mcap", "--from", "film"], "--from: film is only for --to netcdf"),
    ):
        assert reported in refusal(capsys, "export", str(run), *options)


def test_walls_from_files_elsewhere_are_asked_for(tmp_path, capsys):
    """Unless the run's manifest names them; a line says what the map lacks without."""
    (tmp_path / "plan.pgm").write_bytes(b"P5 20 15 255\n" + (b"\xff" * 10 + b"\x00" + b"\xff" * 9) * 15)
    (tmp_path / "plan.yaml").write_text(
        "image: plan.pgm\nresolution: 0.1\norigin: [-2, -1, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    (tmp_path / "s.yaml").write_text(
        "duration: 1\ndomain: {size: [2, 1.5], spacing: 0.1}\nwind: {kind: synthetic, speed: 5 cm/s}\n"
        "gas: {kind: eulerian, sources: [{position: [0.4, 0.3], rate: 1 mg/s}]}\n"
        "obstacles: [{kind: map, file: plan.yaml}]\nfields: {rate: 1}\n"
    )
    out = tmp_path / "runs/one"
    options = ["--out", str(out), "--quiet", "--no-report", "--no-recording"]
    assert run_command.main([str(tmp_path / "s.yaml"), *options]) == 0
    named = (bag_of_fields.floor(open_run(out), False)[0].data == 100).sum()
    (out / "manifest.json").unlink()
    taken = []
    for options in ([], ["--allow-outside"]):
        capsys.readouterr()
        bag = str(tmp_path / f"bag{len(options)}")
        assert main(["export", str(out), "--to", "mcap", "--out", bag, *options]) == 0
        assert ("note: /map: Obstacle 0" in capsys.readouterr().err) is not bool(options)
        taken.append((bag_of_fields.floor(open_run(out), bool(options))[0].data == 100).sum())
        (_, plan), *_ = messages_of(Path(bag))["/map"]
        frame, corner = ("map", (-2.1, -1.1)) if options else ("domain", (-0.1, -0.1))
        assert plan.header.frame_id == frame
        assert (plan.info.origin.position.x, plan.info.origin.position.y) == pytest.approx(corner)
        gas = messages_of(Path(bag))["/plume/ethanol"][-1][1]
        assert gas.header.frame_id == frame
        points = cloud(gas)
        n = points["ppm"].argmax()
        source = np.array([0.4, 0.3]) + ((-2.0, -1.0) if options else (0.0, 0.0))
        assert np.hypot(points["x"][n] - source[0], points["y"][n] - source[1]) < 0.15
    assert taken[1] - taken[0] == 15
    assert named == taken[1]


def test_each_sensor_of_a_robot_has_a_topic(run):
    """A detector ahead, and a metal oxide for another gas to the left, with the law of that."""
    assert main(["export", str(run), "--to", "mcap", "--trial", "0", "--out", str(run / "first")]) == 0
    said = messages_of(run / "first")
    table = open_run(run).robots
    rows = table[(table.group == "linear") & (table.t > 0)]
    detector, oxide = said["/linear_0/gas"], said["/linear_0/gas_1"]
    np.testing.assert_array_equal(numbers(detector, lambda m: m.raw), rows.reading_ppm)
    np.testing.assert_array_equal(numbers(oxide, lambda m: m.raw), rows.resistance_1_ohm)
    (_, first), (_, second) = detector[0], oxide[0]
    assert (first.technology, first.raw_units, first.header.frame_id) == (51, 3, "linear_0/gas_sensor")
    assert (second.technology, second.mpn, second.raw_units) == (1, 52, 5)
    assert second.header.frame_id == "linear_0/gas_sensor_1"
    (still,) = (one.transforms for _, one in said["/tf_static"])
    assert {one.child_frame_id: one.transform.translation.y for one in still}[second.header.frame_id] == 0.1
    c0 = second.calib_a ** (-1 / second.calib_b)
    ppm = c0 * ((numbers(oxide, lambda m: m.raw) / second.raw_air) ** (1 / second.calib_b) - 1)
    assert rows.reading_1_ppm.max() > 1
    np.testing.assert_allclose(np.maximum(ppm, 0), rows.reading_1_ppm, rtol=1e-3, atol=0.01)


def test_the_law_in_a_message_makes_its_resistance_the_reading(run, said):
    """raw / raw_air = (1 + c / c0)^calib_b with c0 = calib_a^(-1 / calib_b), of units that differ."""
    table = open_run(run).robots
    air = []
    for k in (0, 1):
        one = said[f"/oxides_{k}/gas"][0][1]
        assert (one.technology, one.manufacturer, one.mpn, one.raw_units) == (1, 1, 50, 5)
        c0 = one.calib_a ** (-1 / one.calib_b)
        raw = numbers(said[f"/oxides_{k}/gas"], lambda m: m.raw)
        ppm = np.maximum(c0 * ((raw / one.raw_air) ** (1 / one.calib_b) - 1), 0)
        rows = table[(table.trial == 1) & (table.group == "oxides") & (table.robot == k) & (table.t > 0)]
        assert rows.reading_ppm.max() > 1
        np.testing.assert_allclose(ppm, rows.reading_ppm, rtol=1e-3, atol=1e-3)
        air.append(one.raw_air)
    assert air[0] != pytest.approx(air[1], rel=1e-3)


def test_speeds_lead_from_pose_to_pose(said):
    odom = said["/oxides_0/odom"]
    way = numbers(odom, lambda m: m.twist.twist.linear.x)[1:] * 0.1
    x, y = (numbers(odom, lambda m: getattr(m.pose.pose.position, d)) for d in "xy")
    moved = np.hypot(np.diff(x), np.diff(y))
    assert (np.abs(way) <= moved + 1e-6).all()
    assert np.mean(np.abs(np.abs(way) - moved) < 1e-6) > 0.9, "all but where it slides along a wall"
    assert moved.sum() > 0.3
    turns = numbers(odom, lambda m: m.twist.twist.angular.z)[1:] * 0.1
    heading = np.unwrap(numbers(odom, lambda m: angle(m.pose.pose.orientation)))
    np.testing.assert_allclose(turns, np.diff(heading), atol=1e-6)


def test_frames_lead_from_the_map_to_the_sensors(said):
    (_, still), *others = said["/tf_static"]
    assert not others
    links = [(x.child_frame_id, x.header.frame_id, x.transform.translation.x) for x in still.transforms]
    assert ("oxides_0/gas_sensor", "oxides_0/base_link", 0.05) in links
    assert ("oxides_1/anemometer", "oxides_1/base_link", 0.0) in links
    assert len(said["/tf"]) == len(said["/oxides_0/odom"])
    for (_, moved), (_, odom) in zip(said["/tf"], said["/oxides_1/odom"], strict=True):
        assert [one.child_frame_id for one in moved.transforms] == [f"oxides_{k}/base_link" for k in (0, 1)]
        assert moved.transforms[1].transform.translation.x == odom.pose.pose.position.x
        assert moved.transforms[1].header.frame_id == odom.header.frame_id == "oxides_1/odom"
    ((origin, turn),) = {
        (link.transform.translation.x, link.transform.rotation.w)
        for link in still.transforms
        if link.header.frame_id == "map" and link.child_frame_id in ("oxides_0/odom", "oxides_1/odom")
    }
    assert (origin, turn) == (0, 1), (
        "readings stand where the robots believed to be, as in the maps of the run"
    )


def test_the_variance_of_the_heading_is_that_of_turns_and_paths(run, said):
    """k1 |w| + k2 |s| of each step, var b (sum w)² + var c (sum s)² of all; none without odometry errors."""
    (model,) = (group.localization for group in open_run(run).scenario.robots if group.name == "oxides")
    odom = said["/oxides_0/odom"]

    def along(message):
        speed = message.twist.twist.linear
        return np.copysign(np.hypot(speed.x, speed.y), speed.x)  # walls may push it aside

    turns, paths = (0.1 * numbers(odom, get) for get in (lambda m: m.twist.twist.angular.z, along))
    k1, k2, *_ = model.variances
    _, b, c = np.square(model.deviations)
    wanted = (
        np.cumsum(k1 * abs(turns) + k2 * abs(paths)) + b * np.cumsum(turns) ** 2 + c * np.cumsum(paths) ** 2
    )
    found = numbers(odom, lambda m: m.pose.covariance[35])
    assert wanted[-1] > 1e-3
    np.testing.assert_allclose(found, wanted, rtol=1e-3)
    assert main(["export", str(run), "--to", "mcap", "--trial", "0", "--out", str(run / "known")]) == 0
    exact = [one for _, one in messages_of(run / "known")["/linear_0/odom"]]
    assert not any(one.pose.covariance.any() or one.twist.covariance.any() for one in exact)


def test_the_map_is_free_where_robots_can_be(said, tmp_path):
    ((t, one),) = said["/map"]
    assert t == round(BEGIN * 1e9)
    assert (one.info.width, one.info.height) == (18, 14)
    assert (one.data.reshape(14, 18)[1:-1, 1:-1] == 0).all()
    reported = made_run.result(made_run.scenario(), version=__version__)
    one, _ = bag_of_fields.floor(open_run(made_run.made(tmp_path, recording=False, content=reported)), False)
    assert one.info.resolution == pytest.approx(0.1)
    assert (one.info.origin.position.x, one.info.origin.position.y) == (-0.1, -0.1)
    assert (one.info.height, one.info.width) == (32, 42)
    cells = one.data.reshape(32, 42)
    assert set(np.unique(cells)) == {0, 100}
    inner = cells[1:-1, 1:-1]
    assert (cells == 100).sum() - (inner == 100).sum() == 2 * 42 + 2 * 30, "a frame around"
    x, y = np.meshgrid((np.arange(40) + 0.5) * 0.1, (np.arange(30) + 0.5) * 0.1)
    np.testing.assert_array_equal(inner == 100, np.hypot(x - 3.2, y - 2.4) < 0.2)  # its pillar


def test_the_plume_is_the_recorded_field(run, said):
    fields = open_run(run).fields
    clouds = said["/plume/ethanol"]
    assert len(clouds) == fields.sizes["time"] == 9
    for n, (_, one) in enumerate(clouds):
        points = cloud(one)
        gas = fields.ethanol_ppm.isel(time=n)
        assert len(points) == one.width == int((gas >= 0.1).sum())
        j, i = ((points[axis] / 0.1).astype(int) for axis in "yx")
        np.testing.assert_array_equal(points["ppm"], gas.values[j, i])
    assert len(points) > 20


def test_maps_are_those_at_the_end(run, said):
    (wanted,) = open_run(run).maps
    ((t, grid),), ((_, one),) = said["/gas_maps/map_0"], said["/gas_maps/map_0/cells"]
    assert t == round((BEGIN + 4) * 1e9)
    points = cloud(one)
    known = np.isfinite(wanted.estimate[1].values)
    for name, key in (("ppm", "estimate"), ("weight", "weight"), ("truth", "truth")):
        np.testing.assert_array_equal(points[name], wanted[key].values[1][known])
    shown = grid.data.reshape(wanted.estimate.shape[1:])
    np.testing.assert_array_equal(shown >= 0, known)
    np.testing.assert_allclose(shown[known], 100 * points["ppm"] / points["ppm"].max(), atol=0.501)


def test_another_library_decodes_the_same(bag, said):
    """mcap-ros2-support: another reader of the container, and of the bytes in it."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    counts: dict[str, int] = {}
    with (bag / "bag.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, one in reader.iter_decoded_messages():
            topic, n = channel.topic, counts.get(channel.topic, 0)
            counts[topic] = n + 1
            t, wanted = said[topic][n]
            assert message.log_time == t
            if topic.endswith("/gas"):
                assert (one.raw, one.raw_air) == (wanted.raw, wanted.raw_air)
            if topic.endswith("/wind"):
                assert one.wind_direction == wanted.wind_direction
            if topic == "/plume/ethanol":
                assert bytes(one.data) == wanted.data.tobytes()
    assert counts == {topic: len(messages) for topic, messages in said.items()}


def test_what_comes_once_is_latched(bag):
    from rosbags.interfaces import QosDurability
    from rosbags.rosbag2 import Reader

    with Reader(bag) as reader:
        offered = {one.topic: one.ext.offered_qos_profiles[0].durability for one in reader.connections}
    kept = {topic for topic, durability in offered.items() if durability == QosDurability.TRANSIENT_LOCAL}
    assert kept == {"/map", "/tf_static", "/gas_maps/map_0", "/gas_maps/map_0/cells"}


def test_rerun_opens_it(bag, tmp_path):
    """Its viewer draws what the bag is converted to: points, grids, frames, and all other topics as they are."""
    out = tmp_path / "a.rrd"
    command = [sys.executable, "-m", "rerun_cli", "mcap", "convert", bag / "bag.mcap", "-o", out]
    subprocess.run(command, check=True, capture_output=True)
    found: dict[str, dict[str, int]] = {}
    for chunk in rr.chunk.RrdReader(str(out)).stream():
        batch = chunk.to_record_batch()
        its = found.setdefault(chunk.entity_path, {})
        for name in batch.schema.names:
            its[name] = its.get(name, 0) + batch.num_rows
    assert found["/plume/ethanol"]["Points3D:positions"] == found["/plume/ethanol"]["Points3D:ppm"] == 9
    assert found["/map"]["GridMap:data"] == found["/gas_maps/map_0"]["GridMap:data"] == 1
    assert found["/tf"]["Transform3D:translation"] == 2 * 41
    assert found["/oxides_0/truth"]["InstancePoses3D:translations"] == 41
    assert found["/oxides_1/gas"]["olfaction_msgs.msg.GasSensor:message"] == 40


def test_readings_of_the_bag_are_those_of_the_table(run, bag):
    """By the law in its messages, by its frames; a robot's sensor is ahead of its middle, where its table has it."""
    there = read(run / "robots.parquet", 1, "oxides")
    for k in (0, 1):
        one = read(bag, group=f"oxides_{k}")
        mine = slice(k, None, 2)
        np.testing.assert_allclose(one.t - BEGIN, there.t[mine], atol=1e-6)
        np.testing.assert_allclose(one.reading, there.reading[mine], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(one.wind, there.wind[mine], atol=1e-5)
        away = np.linalg.norm(one.place - there.place[mine], axis=1)
        np.testing.assert_allclose(away, 0.05, atol=1e-6)
        centre = read(bag, options=BagOptions((f"/oxides_{k}/gas",), (f"/oxides_{k}/odom",)))
        np.testing.assert_allclose(centre.place, there.place[mine], atol=1e-6)


def test_the_maps_command_takes_a_bag(run, bag, tmp_path, capsys):
    """The whole of it, and what it takes is said."""
    options = ["--size", "1.6", "1.2", "--map={kind: kernel_dmv, cell: 0.2}"]
    topics = [f"--{option}=/oxides_{k}/{name}" for k in "01" for option, name in TOPICS.items()]
    assert maps.main([str(bag), *topics, *options, "--out", str(tmp_path / "a")]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("oxides_1: ")]
    for part in (
        "gas of /oxides_1/gas in ohm",
        "positions of /oxides_1/odom",
        "in map",
        "wind of /oxides_1/wind",
    ):
        assert part in line
    table = [str(run / "robots.parquet"), "--trial", "1"]
    assert maps.main([*table, *options, "--out", str(tmp_path / "b")]) == 0
    a, b = (np.genfromtxt(tmp_path / name / "map.csv", delimiter=",", names=True) for name in "ab")
    np.testing.assert_allclose(a["ppm"], b["ppm"], rtol=1e-3, atol=1e-3)
    for wrong, reported in (
        (["--topic", "/no"], "has no topic '/no'"),
        (["--frame"], "--frame: expected one argument"),
        (["--air", "0"], "air: got 0 ohm; at least 1 ohm"),
        (["--model", "nose"], "--model: invalid choice: 'nose'"),
        (["--trial", "3"], "from which to select trial 3"),
    ):
        assert reported in refusal(capsys, "maps", str(bag), *options, "--out", str(tmp_path / "c"), *wrong)


def test_a_run_again_on_its_own_ways_reads_the_same(run, tmp_path):
    """Its robots are put where they were and their sensors have the same noise: so they read the same."""
    bag_of_run.write(open_run(run), tmp_path / "bag")
    text = bag_run.SCENARIO.replace("trials: 2", "trials: 1")
    text = text.replace("    localization: {kind: odometry, veer_deg: 10, distance_scale: 0.1}\n", "")
    for kind in ("random_walk", "casting"):
        names = "[linear_0]" if kind == "casting" else "[oxides_0, oxides_1]"
        text = text.replace(f"{{kind: {kind}}}", f"{{kind: replay, file: bag, robots: {names}}}")
    (tmp_path / "s.yaml").write_text(text)
    options = ["--out", str(tmp_path / "again"), "--quiet", "--no-report", "--no-recording"]
    assert run_command.main([str(tmp_path / "s.yaml"), *options]) == 0
    oxides, linear = (group["beside_recorded"] for group in open_run(tmp_path / "again").result["groups"])
    assert (oxides["readings"], linear["readings"]) == (80, 40)
    assert linear["mae_ppm"][0] < 1e-4, "it does not err in where it is, so its way is the true one"
    assert linear["correlation"][0] == pytest.approx(1.0)
    assert oxides["mae_ppm"][0] > 0.1, "these were elsewhere than they believed, which is what the bag tells"


# ---------------------------------------------------------------- many cells


def test_more_cells_than_points_are_averaged_and_no_gas_is_lost(run):
    one = open_run(run)
    data = one.fields
    rng = np.random.default_rng(2)
    air = data.air.copy(data=rng.choice([0.0, 0.3, 1.0], data.air.shape).astype(np.float32))
    gas = data.ethanol_ppm.copy(data=rng.uniform(1, 9, data.ethanol_ppm.shape).astype(np.float32))
    one.__dict__["fields"] = data.assign(air=air, ethanol_ppm=gas)
    data, names = bag_of_fields.scalars(one)
    assert names == ["ethanol_ppm"]
    clouds = bag_of_fields.clouds(data, one.folder, "ethanol_ppm", 60, 0.0, MapFrame())
    for n, (_, topic, message) in enumerate(clouds):
        points = cloud(message)
        assert topic == "/plume/ethanol"
        assert 20 < len(points) <= 60
        assert np.unique(np.diff(np.unique(points["x"])).round(5)).tolist() == [pytest.approx(0.2)]
        whole = air.values[:12, :16].reshape(6, 2, 8, 2).sum(axis=(1, 3))
        there = whole[(points["y"] / 0.2).astype(int), (points["x"] / 0.2).astype(int)]
        assert (there * points["ppm"]).sum() == pytest.approx((gas[n].values * air.values).sum(), rel=1e-5)


# ---------------------------------------------------------------- what may be wrong


def test_what_cannot_be_is_reported_in_a_line(run, tmp_path, capsys):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.txt").touch()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(run)
    for options, reported in (
        (["--trial", "2"], "has no trial 2; the last is 1"),
        (["--begin", "3e9"], "ends at 3e+09 s"),
        (["--out", str(tmp_path / "mine"), "--force"], "is a folder, but no bag alone"),
        (["--out", str(tmp_path / "file"), "--force"], "is no folder"),
        (["--out", str(tmp_path / "link"), "--force"], "is no folder"),
        (["--out", str(tmp_path / "no" / "bag")], "its folder does not exist"),
    ):
        assert reported in refusal(capsys, "export", str(run), "--to", "mcap", *options)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file", "link", "mine"]


def test_a_bag_is_replaced_by_force_and_no_half_is_left(run, tmp_path, capsys, monkeypatch):
    out = tmp_path / "bag"
    command = [str(run), "--to", "mcap", "--out", str(out)]
    assert main(["export", *command]) == 0
    before = (out / "bag.mcap").read_bytes()
    assert main(["export", *command]) == 2
    assert "exists; choose another --out or add --force" in capsys.readouterr().err

    def full(file: Path, coming: int = 0) -> None:
        if coming:
            raise OSError(28, "the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(disk, "require_room", full)
        patch.setattr("taichi_plume.files.bag_writer.CHECKED_EVERY", 1 << 10)
        assert main(["export", *command, "--trial", "1", "--force"]) == 1
    assert capsys.readouterr().err.endswith(": the disk is full\n")
    assert [one.name for one in tmp_path.iterdir()] == ["bag"]
    assert (out / "bag.mcap").read_bytes() == before
    assert main(["export", *command, "--trial", "1", "--force"]) == 0
    assert (out / "bag.mcap").read_bytes() != before


def test_without_rosbags_it_is_reported_what_to_install(run, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert main(["export", str(run), "--to", "mcap"]) == 2
    assert 'pip install "taichi_plume[ros]"' in capsys.readouterr().err


def test_a_run_without_robots_and_fields_has_no_bag(run, tmp_path):
    one = open_run(run)
    one.__dict__["scenario"] = one.scenario.model_copy(update={"robots": []})
    one.folder = tmp_path
    with pytest.raises(RunFolderError, match="has neither robots nor fields"):
        bag_of_run.write(one, tmp_path / "bag")
