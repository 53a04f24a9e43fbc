"""The service and its clients as processes of their own, on this machine's loopback."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest
import yaml

pytest.importorskip("zenoh")
pytest.importorskip("websockets")

from taichi_plume.cli.serve import main
from taichi_plume.client import Team
from taichi_plume.files import ros_messages as ros
from taichi_plume.serve.address import TOKEN, endpoint, zenoh_config

pytestmark = pytest.mark.slow
SCENARIO = {
    "name": "live",
    "duration": 4.0,
    "domain": {"size": [4, 3], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.5, 0]},
    "gas": {"kind": "gaussian_plume", "diffusivity": 0.002, "sources": [{"position": [0.5, 1.5], "rate": "10 mg/s"}]},
    "robots": [
        {
            "name": "team", "count": 2, "trials": 2,
            "start": {"kind": "positions", "positions": [[3, 1], [3, 2]], "heading_deg": 180},
            "algorithm": {"kind": "external"},
        },
    ],
}  # fmt: skip
TWINS = ", ".join(
    f"{{name: {name}, count: 1, start: {{kind: positions, positions: [[3, {y}]]}}, algorithm: {{kind: external}}}}"
    for name, y in (("the-team", 1), ("the team", 2))
)
ENOUGH = 60.0


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@contextmanager
def served(folder, *options: str, port: int, scenario=SCENARIO, env=None):
    """The service as a process; yields it, and ends it where the test has not."""
    file = folder / "live.yaml"
    file.write_text(yaml.safe_dump(scenario))
    command = [
        sys.executable, "-m", "taichi_plume.serve", str(file), "--bind", f"127.0.0.1:{port}", "--out",
        str(folder / "out"), "--no-report", "--no-recording", *options,
    ]  # fmt: skip
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ | (env or {}))
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def end(process) -> str:
    reported = process.communicate(timeout=ENOUGH)[1]
    assert process.returncode == 0, reported
    return reported


def result(folder) -> dict:
    return json.loads((folder / "out/result.json").read_text())


def test_ten_lines_drive_a_robot(tmp_path):
    """At once, through the client, ROS's own messages and a WebSocket."""
    port, web = free_port(), free_port()
    with served(tmp_path, "--websocket", str(web), port=port) as process:
        with Team(f"127.0.0.1:{port}", group="team", robots=[0, 1]) as team:
            team.drive(0.1)
            others = by_zenoh(port), by_websocket(web)
            seen = [now for now in team if team.drive(0.1)]  # it ends with the run
            for close in others:
                close()
        end(process)
    assert seen[-1].position[:, 0] == pytest.approx([3 - 0.1 * seen[-1].t] * 2, abs=0.03)
    assert seen[-1].robot.tolist() == [0, 1]
    reported = result(tmp_path)["service"]
    assert reported["messages"]["team"]["malformed"] == 0
    import pyarrow.parquet as pq

    table = pq.read_table(tmp_path / "out/robots.parquet").to_pandas()
    last = table[table["t"] == table["t"].max()]
    assert last["x"].to_numpy() == pytest.approx([2.6] * 4, abs=0.05)


def by_zenoh(port: int):
    """Drive robot 2 with a Twist, as a bridge of ROS 2 does."""
    import zenoh

    session = zenoh.open(zenoh_config("client", {"connect": [endpoint("127.0.0.1", port)]}, None))
    twist = ros.encode(ros.message("geometry_msgs/msg/Twist", linear={"x": 0.1}))
    return repeated(lambda: session.put("team_2/cmd_vel", twist), session.close)


def by_websocket(port: int):
    """Drive robot 3 as the Foxglove app's teleoperation does."""
    from websockets.sync.client import connect

    until = time.monotonic() + ENOUGH
    while True:
        try:
            link = connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], legacy=True)  # type: ignore
            break
        except OSError:
            assert time.monotonic() < until
            time.sleep(0.1)
    about = {"id": 1, "topic": "/team_3/cmd_vel", "encoding": "json", "schemaName": "geometry_msgs/msg/Twist"}
    link.send(json.dumps({"op": "advertise", "channels": [about]}))
    assert subscribed(link, "/team_3/gas").raw_units == ros.UNITS["ppm"]
    text = json.dumps({"linear": {"x": 0.1}}).encode()
    return repeated(lambda: link.send(b"\x01" + (1).to_bytes(4, "little") + text), link.close)


def subscribed(link, topic: str):
    """The first message of a topic."""
    while True:
        said = link.recv(ENOUGH)
        if isinstance(said, bytes):
            if said[0] == 2:  # the time
                continue
            assert said[0] == 1
            return ros.decode(ros.GAS_SENSOR, said[13:])
        reported = json.loads(said)
        for one in reported.get("channels", ()) if reported["op"] == "advertise" else ():
            if one["topic"] == topic:
                assert (one["encoding"], one["schemaEncoding"]) == ("cdr", "ros2msg")
                wanted = [{"id": 1, "channelId": one["id"]}]
                link.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def repeated(send, close):
    """Send ten times a second; returns what ends it."""
    import threading

    over = threading.Event()

    def run():
        while not over.wait(0.1):
            try:
                send()
            except Exception:
                return

    thread = threading.Thread(target=run, daemon=True)
    thread.start()

    def stop():
        over.set()
        thread.join()
        try:
            close()
        except Exception:
            return

    return stop


def test_a_token_is_asked_for(tmp_path):
    port = free_port()
    with served(tmp_path, "--websocket", "0", port=port, env={TOKEN: "a long secret"}) as process:
        with Team(f"127.0.0.1:{port}", group="team", token="a long secret") as team:
            assert team.wait() is not None
            for wrong, why in (
                ({"speed": [0.1, 0.2, 0.3]}, r"speed: got an array of shape \(3,\), must have shape \(4,\)"),
                ({"speed": [0.1, 0.2, np.nan, 0.3]}, "speed of robot 2: got nan, must be finite"),
                ({"speed": 0.1, "declared": [1.0, 2.0, 3.0]}, "declared: got an array of shape"),
            ):
                with pytest.raises(ValueError, match=why):
                    team.drive(**wrong)
        with Team(f"127.0.0.1:{port}", group="nobody", token=" a long secret ", patience=1.0) as team:  # noqa: SIM117
            with pytest.raises(ConnectionError, match="no readings came of group nobody for 1 s"):
                next(iter(team))
        with Team(f"127.0.0.1:{port}", group="team", robots=[4], token="a long secret") as team:  # noqa: SIM117
            with pytest.raises(ValueError, match="robot 4 of group team is none of 0 to 3"):
                team.wait()
        for token in (None, "another secret"):
            with pytest.raises(ConnectionError, match="no service answers there"):
                Team(f"127.0.0.1:{port}", group="team", token=token, patience=1.0)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=ENOUGH)
        assert process.returncode == 130


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--bind", "0.0.0.0:7447"], "others can reach that address: set a token, TAICHI_PLUME_TOKEN"),
        (["--bind", "7447"], "takes HOST:PORT"),
        (["--bind", "127.0.0.1:99999"], "takes HOST:PORT"),
        (["--wait", "--at-once"], "--wait waits for robots in each tick"),
        (["--wait", "--speed", "2"], "--speed 2 has no meaning with it"),
        (["--speed", "fast"], "--speed takes a number above 0 or max"),
        (["--speed", "nan"], "--speed takes a number above 0 or max"),
        (["--duration", "-1"], "duration: got -1 s"),
        (["--set", "robots.0.algorithm={kind: casting}"], "no robot is driven from outside"),
        (["--set", f"robots=[{TWINS}]"], "have the same topics, the_team/..."),
    ],
)
def test_what_is_wrong_is_reported_in_a_line(tmp_path, monkeypatch, capsys, options, why):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "live.yaml").write_text(yaml.safe_dump(SCENARIO))
    try:
        code = main(["live.yaml", *options])
    except SystemExit as error:
        code = error.code
    assert code == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize(
    ("token", "why"), [("a", "has 1 characters"), ("a secret\n\nof mine", "cannot be printed")]
)
def test_a_token_that_is_none(monkeypatch, capsys, token, why):
    monkeypatch.setenv(TOKEN, token)
    with pytest.raises(SystemExit) as error:
        main(["live.yaml"])
    assert error.value.code == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize("robots", [[-1], [0.5], [], "a", [[0]]])
def test_numbers_of_robots(robots):
    with pytest.raises(ValueError, match="must be whole numbers from 0 on"):
        Team(robots=robots)


def test_an_address_that_is_taken(tmp_path):
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        one.listen()
        with served(tmp_path, "--websocket", "0", port=one.getsockname()[1]) as process:
            reported = process.communicate(timeout=ENOUGH)[1]
            assert process.returncode == 2, reported
            assert "cannot be opened" in reported
            assert "Traceback" not in reported


def test_a_team_needs_an_address():
    for where in ("localhost", "127.0.0.1:x"):
        with pytest.raises(ConnectionError, match="HOST:PORT"):
            Team(where)
    with pytest.raises(ConnectionError, match="no service answers there, without a token"):
        Team(f"127.0.0.1:{free_port()}", patience=0.5)
