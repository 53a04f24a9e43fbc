"""The WebSocket server: who may connect, what clients may send, what is kept of clients."""

import json
import socket
import time
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("websockets")
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from taichi_plume.cli.serve import main
from taichi_plume.serve import websocket_link
from taichi_plume.serve.address import origin
from taichi_plume.serve.links import LinkError
from taichi_plume.serve.websocket_link import WebSocketLink

pytestmark = pytest.mark.slow

APP = "https://app.foxglove.dev"
GAS = "team_0/gas", "olfaction_msgs/msg/GasSensor"
ENOUGH = 10.0


@contextmanager
def opened(*args, **keys):
    link = WebSocketLink(0, "test", *args, **keys)
    try:
        yield link
    finally:
        link.close()


@pytest.fixture
def link():
    with opened() as one:
        yield one


def client(link, path="/", host=None, **keys) -> Any:
    """A client whose Host header is `host`."""
    place = f"127.0.0.1:{link.port}" if host is None else host
    sock = socket.create_connection(("127.0.0.1", link.port))
    keys |= {"subprotocols": [websocket_link.PROTOCOL], "open_timeout": ENOUGH, "legacy": True}
    return connect(f"ws://{place}{path}", sock=sock, **keys)


def status_of(link, *args, **keys) -> int:
    """HTTP status of a handshake."""
    try:
        client(link, *args, **keys).close()
    except InvalidStatus as error:
        return error.response.status_code
    return 101


def until(true):
    end = time.monotonic() + ENOUGH
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)


def answer(link, *messages) -> dict:
    """The last answer to some messages."""
    with client(link) as one:
        one.recv(ENOUGH)
        one.recv(ENOUGH)
        for message in messages:
            one.send(message if isinstance(message, str | bytes) else json.dumps(message))
        return json.loads(one.recv(ENOUGH))


# ---------------------------------------------------------------- who may connect


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:9000", "LOCALHOST:1", "[::1]:8765"])
def test_names_of_this_machine(link, host):
    assert status_of(link, host=host) == 101


@pytest.mark.parametrize(
    "host", ["evil.example:8765", "127.0.0.1.evil.example", "localhost.evil.example:1", "192.168.1.2"]
)
def test_a_rebound_name_is_refused(link, host):
    with socket.create_connection(("127.0.0.1", link.port), ENOUGH) as sock:
        lines = [f"GET / HTTP/1.1\r\nHost: {host}", "Connection: Upgrade", "Upgrade: websocket"]
        lines += ["Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="]
        sock.sendall(("\r\n".join([*lines, "Sec-WebSocket-Protocol: foxglove.sdk.v1"]) + "\r\n\r\n").encode())
        assert sock.recv(100).split()[1] == b"403"


@pytest.mark.parametrize(
    "given", ["http://evil.example", "http://localhost:3000", "null", "file://", f"{APP}.evil.example"]
)
def test_pages_are_refused_unless_allowed(given):
    lines = []
    with opened([APP], remark=lines.append) as link:
        assert status_of(link) == 101  # a program
        assert status_of(link, origin=APP) == 101
        assert status_of(link, origin=given) == 403
        assert status_of(link, additional_headers={"Origin": given}, origin=APP) == 403
        assert [line.count(f"--allow-origin {given}") for line in lines[:1]] == [1]
    with opened([origin("file://")]) as link:
        assert (status_of(link, origin="file://"), status_of(link, origin=APP)) == (101, 403)


def test_refused_handshakes_do_not_fill_the_terminal(capfd):
    lines = []
    with opened(remark=lines.append) as link:
        for _ in range(40):
            assert status_of(link, origin="http://evil.example") == 403
        for garbage in (b"\0", b"GET / HTTP/1.1", b"POST / HTTP/1.1\r\nHost: localhost"):
            with socket.create_connection(("127.0.0.1", link.port), ENOUGH) as sock:
                sock.sendall(garbage + b"\r\n\r\n")
                sock.recv(1000)
    assert len(lines) == 6
    assert capfd.readouterr() == ("", "")


def test_a_token_in_the_url():
    with opened(token="a long secret") as link:
        assert status_of(link, "/?token=a%20long%20secret") == 101
        for path in ("/", "/?token=", "/?token=another", "/a%20long%20secret"):
            assert status_of(link, path) == 403
        assert status_of(link, "/?token=a%20long%20secret", origin=APP) == 403


@pytest.mark.parametrize(
    "text",
    [
        "",
        *[
            "*",
            "null",
            "app.foxglove.dev",
            "https://*",
            "https://a.b/path",
            "https://",
            "http://[",
            "https://a?b",
        ],
    ],
)
def test_what_is_no_origin(text, capsys):
    with pytest.raises(SystemExit) as error:
        main(["live.yaml", "--allow-origin", text])
    assert error.value.code == 2
    assert "--allow-origin: takes an origin" in capsys.readouterr().err


def test_origins_are_read_as_browsers_send_them():
    assert [origin(text) for text in ("HTTPS://App.Foxglove.dev/", "http://localhost:3000", "file://")] == [
        APP, "http://localhost:3000", "file://",
    ]  # fmt: skip


def test_a_missing_package_is_named_alone(monkeypatch, capsys):
    monkeypatch.setattr("taichi_plume.cli.serve.NEEDED", {"no_such_package": "no-such-package"})
    assert main(["live.yaml"]) == 2
    assert capsys.readouterr().err == "needs no-such-package: pip install 'taichi_plume[ros]'\n"


def test_a_port_that_is_taken(link):
    with pytest.raises(LinkError, match=f"127.0.0.1:{link.port}"):
        WebSocketLink(link.port, "second")


# ---------------------------------------------------------------- what is sent


def test_topics_and_time_reach_subscribers(link):
    assert not link.wants(*GAS)
    with client(link) as one:
        assert json.loads(one.recv(ENOUGH))["capabilities"] == ["clientPublish", "time"]
        (about,) = json.loads(one.recv(ENOUGH))["channels"]
        assert (
            about.items() >= {"topic": "/team_0/gas", "encoding": "cdr", "schemaEncoding": "ros2msg"}.items()
        )
        one.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": about["id"]}]}))
        until(lambda: link.wants(*GAS))
        link.publish(GAS[0], b"data")
        link.announce_time(1.5)
        message, clock = one.recv(ENOUGH), one.recv(ENOUGH)
        assert (message[:5], message[13:]) == (b"\x01\x07\0\0\0", b"data")
        assert abs(int.from_bytes(message[5:13], "little") / 1e9 - time.time()) < ENOUGH
        assert clock == b"\x02" + (1_500_000_000).to_bytes(8, "little")
        link.wants("clock", "rosgraph_msgs/msg/Clock")
        assert json.loads(one.recv(ENOUGH))["channels"][0]["topic"] == "/clock"
        one.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [7]}))
        until(lambda: not link.wants(*GAS))
        one.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 8, "channelId": about["id"]}]}))
        until(lambda: link.wants(*GAS))
    until(lambda: not link.wants(*GAS))  # the client has left


def test_messages_before_and_after_the_service_listens(link, capfd):
    advertised = {"op": "advertise", "channels": [{"id": 3, "topic": "/team_0/cmd_vel", "encoding": "json"}]}
    heard, stray = [], []
    with client(link) as one:
        one.recv(ENOUGH)
        one.recv(ENOUGH)
        one.send(json.dumps(advertised))
        for channel in (3, 4):
            one.send(b"\x01" + channel.to_bytes(4, "little") + b"early")
        one.send("{}")
        assert "status" in one.recv(ENOUGH)  # what came before has been dealt with
        link.listen(
            {"team_0/cmd_vel": lambda data, json=False: heard.append((data, json))},
            lambda data, json=False: stray.append(data),
        )
        for channel in (3, 4):
            one.send(b"\x01" + channel.to_bytes(4, "little") + b"data")
        one.send(json.dumps({"op": "unadvertise", "channelIds": [3]}))
        one.send(b"\x01\x03\0\0\0late")
        until(lambda: len(stray) == 2)
    assert (heard, stray) == ([(b"data", True)], [b"data", b"late"])
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("message", "why"),
    [
        ("{", "JSON"),
        ("[" * 100_000, "JSON"),
        ("[]", "op: None"),
        ({"op": "getParameters"}, "op: getParameters"),
        ({"op": "subscribe"}, "subscriptions: takes a list"),
        ({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}, "channel 99"),
        ({"op": "subscribe", "subscriptions": [{"id": 1 << 32, "channelId": 1}]}, "32 bits"),
        ({"op": "subscribe", "subscriptions": [{"id": True, "channelId": 1}]}, "id: takes a whole number"),
        ({"op": "advertise", "channels": [{"id": 1, "topic": "x" * 300, "encoding": "json"}]}, "topic: takes a text"),
        ({"op": "unadvertise", "channelIds": 3}, "channelIds: takes a list"),
        ({"op": "unsubscribe", "subscriptionIds": [None]}, "subscriptionIds: takes a list of whole numbers"),
        ({"op": "subscribe", "subscriptions": [3]}, "id: takes a whole number"),
        ({"op": "x" * websocket_link.LONGEST_TEXT}, "characters"),
        (b"", "opcode"),
        (b"\x09\0\0\0\0", "opcode"),
    ],
)  # fmt: skip
def test_invalid_messages_are_answered(link, message, why):
    link.wants(*GAS)
    reported = answer(link, message)
    assert (reported["op"], reported["level"]) == ("status", 2)
    assert why in reported["message"]


# ---------------------------------------------------------------- what is kept


def test_channels_of_a_client_are_bounded(link):
    many = [{"id": n, "topic": f"/t{n}", "encoding": "json"} for n in range(websocket_link.MOST_CHANNELS + 1)]
    assert "at most 1,024" in answer(link, {"op": "advertise", "channels": many})["message"]


def test_clients_are_bounded(link, monkeypatch):
    monkeypatch.setattr(websocket_link, "MOST_CLIENTS", 1)
    with client(link) as one:
        one.recv(ENOUGH)
        assert status_of(link) == 503
    until(lambda: status_of(link) == 101)


def test_a_client_that_does_not_read_is_not_waited_for(link, monkeypatch):
    monkeypatch.setattr(websocket_link, "MOST_BUFFERED", 1 << 20)
    link.wants(*GAS)
    with client(link, max_queue=1, max_size=None) as slow:
        slow.recv(ENOUGH)
        slow.recv(ENOUGH)
        slow.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": 1}]}))
        until(lambda: link.wants(*GAS))
        for _ in range(100):
            link.publish(GAS[0], bytes(1 << 20))
            time.sleep(0.01)  # for what the system's buffers take
        with client(link) as other:
            other.recv(ENOUGH)
            until(lambda: len(link._clients) == 2)
            (behind,) = [one for one in link._clients if link._channels[GAS[0]].subscribers.get(one)]
            assert behind.transport.get_write_buffer_size() < 3 << 20
            link.wants("clock", "rosgraph_msgs/msg/Clock")
            until(lambda: len(link._clients) == 1)  # cut off: it would not know of the topic
