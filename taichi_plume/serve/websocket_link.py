"""Transport for the Foxglove app and other clients of its protocol, foxglove.sdk.v1: a WebSocket server on loopback.

Browsers let a page of any site open a WebSocket to this machine. The handshake is therefore refused unless

    Host     is this machine (against DNS rebinding: such a page sends its own name)
    Origin   is absent, as from programs, or allowed by the user; browsers always send the origin of the page
    token    is in the query of the URL, if the service has a token
"""

import asyncio
import json
import logging
import struct
import threading
import time
from collections.abc import Callable, Collection, Mapping
from hmac import compare_digest
from http import HTTPStatus
from typing import NamedTuple, TypeVar
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from taichi_plume.files import ros_messages as ros
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.serve.address import LONGEST, loopback
from taichi_plume.serve.links import Hear, LinkError

PROTOCOL = Subprotocol("foxglove.sdk.v1")
T = TypeVar("T")
MOST_CLIENTS = 32
MOST_CHANNELS = 1024  # channels on which a client publishes
LONGEST_NAME = 256  # characters of a topic or an encoding
KINDS = {int: "a whole number", str: f"a text of at most {LONGEST_NAME} characters", list: "a list"}
LONGEST_TEXT = 1 << 20  # characters of a control message
MOST_BUFFERED = 1 << 22  # bytes not yet taken by a client; further messages to the client are dropped
CLOSE_S = 1.0
MESSAGE, TIME = 1, 2  # opcodes of binary messages
WARNING, ERROR = 1, 2  # levels of a status message


class ClientError(ValueError):
    """Error of an invalid message from a client, described in one line."""


class Channel(NamedTuple):
    """Topic of the service on the WebSocket. about: its advertisement; subscribers: subscription id of each client."""

    id: int
    about: Mapping[str, object]
    subscribers: dict[ServerConnection, int]


class WebSocketLink:
    """WebSocket server on 127.0.0.1, which runs in its own thread.

    Clients publish CDR or JSON. origins: of pages that may connect; token: that clients must give, if any; remark:
    called with a line about refused handshakes. Raises LinkError if the port cannot be opened.
    """

    def __init__(
        self,
        port: int,
        name: str,
        origins: Collection[str] = (),
        token: str | None = None,
        remark: Callable[[str], None] = lambda line: None,
    ):
        self.name, self.origins, self.token, self.remark = name, frozenset(origins), token, remark
        self.incoming: Mapping[str, Hear] = {}
        self.stray: Hear = lambda data, json=False: None
        self.refused = 0
        self._session = str(time.time_ns())
        self._channels: dict[str, Channel] = {}  # read by the thread of the clock
        self._advertised: dict[int, Channel] = {}  # from here on: used by the server's thread
        self._clients: set[ServerConnection] = set()
        self._loop = asyncio.new_event_loop()
        try:
            self._server = self._loop.run_until_complete(self._opened(port))
        except (OSError, OverflowError) as error:
            self._loop.close()
            raise LinkError(f"127.0.0.1:{port}: cannot be opened ({error})") from None
        self.port = self._server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    # ------------------------------------------------------------ thread of the clock

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        self.stray, self.incoming = stray, incoming

    def wants(self, topic: str, name: str) -> bool:
        channel = self._channels.get(topic)
        if channel is None:
            number = len(self._channels) + 1
            schema = {"schemaName": name, "schemaEncoding": "ros2msg", "schema": ros.definition(name)}
            about = {"id": number, "topic": f"/{topic}", "encoding": "cdr"} | schema
            channel = self._channels[topic] = Channel(number, about, {})
            self._call(self._advertise, channel)
        return bool(channel.subscribers)

    def publish(self, topic: str, data: bytes) -> None:
        """Send a message to all subscribers of a topic; a client that reads too slowly misses messages."""
        self._call(self._publish, self._channels[topic], data, time.time_ns())

    def announce_time(self, t: float) -> None:
        self._call(self._broadcast, struct.pack("<BQ", TIME, round(1e9 * max(0.0, t))))

    def close(self) -> None:
        self._call(lambda: self._loop.create_task(self._closed()))
        self._thread.join(2 * CLOSE_S)
        if not self._thread.is_alive():
            self._loop.close()

    def _call(self, function: Callable[..., object], *args: object) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(function, *args)

    # ------------------------------------------------------------ thread of the server

    async def _opened(self, port: int) -> Server:
        return await serve(
            self._attend,
            "127.0.0.1",
            port,
            process_request=self._check,
            subprotocols=[PROTOCOL],
            compression=None,
            max_size=LONGEST,
            close_timeout=CLOSE_S,
            server_header=None,
            logger=logging.Logger("websocket", logging.CRITICAL + 1),  # clients cannot fill the terminal
        )

    async def _closed(self) -> None:
        self._server.close()
        await self._server.wait_closed()
        self._loop.stop()

    def _check(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the response that refuses a WebSocket handshake, or None to accept it."""
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        if len(hosts) != 1 or not loopback(_name(hosts[0])):
            host = visible(", ".join(hosts), LONGEST_VALUE)
            return self._refuse(connection, f"a request for host {host}: it must name this machine")
        if not self.origins.issuperset(origin.lower() for origin in origins):
            origin = visible(", ".join(origins), LONGEST_VALUE)
            return self._refuse(
                connection, f"a page of {origin}; --allow-origin {origin} lets its pages drive the robots"
            )
        if self.token is not None and not compare_digest(self.token.encode(), _token(request.path)):
            return self._refuse(connection, "a client without the service's token in its URL, ?token=...")
        if len(self._clients) >= MOST_CLIENTS:
            return connection.respond(
                HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_CLIENTS} clients are connected\n"
            )
        return None

    def _refuse(self, connection: ServerConnection, what: str) -> Response:
        self.refused += 1
        if self.refused & (self.refused - 1) == 0:  # the first, second, fourth, eighth ...
            self.remark(f"WebSocket: refused {what} ({self.refused:,} refused so far)")
        return connection.respond(HTTPStatus.FORBIDDEN, f"refused {what}\n")

    async def _attend(self, client: ServerConnection) -> None:
        """Handle the messages of a client until its connection closes."""
        published: dict[int, tuple[str, bool]] = {}  # by the client's channel id: topic, and whether in JSON
        self._clients.add(client)
        try:
            self._send(client, json.dumps(self._about()))
            self._send(client, _advertisement(self._advertised.values()))
            async for message in client:
                try:
                    if isinstance(message, bytes):
                        self._hear(message, published)
                    else:
                        self._obey(client, message, published)
                except ClientError as error:
                    self._send(client, _status(ERROR, str(error)))
        except ConnectionClosed:
            pass
        finally:
            self._clients.discard(client)
            for channel in self._advertised.values():
                channel.subscribers.pop(client, None)

    def _about(self) -> dict[str, object]:
        about = {"op": "serverInfo", "name": self.name, "capabilities": ["clientPublish", "time"]}
        return about | {"supportedEncodings": ["cdr", "json"], "metadata": {}, "sessionId": self._session}

    def _hear(self, message: bytes, published: dict[int, tuple[str, bool]]) -> None:
        """Pass a client's binary message to the receiver of its topic; published: topics of the client's channels."""
        if len(message) < 5 or message[0] != MESSAGE:
            raise ClientError("binary messages begin with opcode 1 and a channel id of 4 bytes")
        topic, in_json = published.get(int.from_bytes(message[1:5], "little"), ("", False))
        self.incoming.get(topic, self.stray)(message[5:], in_json)

    def _obey(self, client: ServerConnection, message: str, published: dict[int, tuple[str, bool]]) -> None:
        """Execute a client's control message (subscribe, advertise, ...); published: topics of its channels."""
        if len(message) > LONGEST_TEXT:
            raise ClientError(f"control message: {len(message):,} characters, at most {LONGEST_TEXT:,}")
        try:
            given = json.loads(message)
        except (ValueError, RecursionError):
            raise ClientError("control message: is not valid JSON") from None
        given = given if isinstance(given, dict) else {}
        match given.get("op"):
            case "subscribe":
                for item in _field(given, "subscriptions", list):
                    self._subscribe(client, _field(item, "id", int), _field(item, "channelId", int))
            case "unsubscribe":
                gone = _numbers(given, "subscriptionIds")
                for channel in self._advertised.values():
                    if channel.subscribers.get(client) in gone:
                        del channel.subscribers[client]
            case "advertise":
                for item in _field(given, "channels", list):
                    channel_id, encoding = _field(item, "id", int), _field(item, "encoding", str)
                    if len(published) >= MOST_CHANNELS and channel_id not in published:
                        raise ClientError(f"channels: at most {MOST_CHANNELS:,} can be advertised")
                    published[channel_id] = _field(item, "topic", str).strip("/"), encoding == "json"
            case "unadvertise":
                for channel_id in _numbers(given, "channelIds"):
                    published.pop(channel_id, None)
            case other:
                raise ClientError(f"op: {visible(other, LONGEST_VALUE)} is not supported")

    def _subscribe(self, client: ServerConnection, subscription: int, channel_id: int) -> None:
        channel = self._advertised.get(channel_id)
        if channel is None:
            raise ClientError(f"channel {channel_id} does not exist")
        if client in channel.subscribers:
            self._send(client, _status(WARNING, f"channel {channel_id} is already subscribed to"))
        elif not 0 <= subscription < 1 << 32:
            raise ClientError(f"subscription id {subscription}: takes a number of 32 bits")
        else:
            channel.subscribers[client] = subscription

    def _advertise(self, channel: Channel) -> None:
        self._advertised[channel.id] = channel
        self._broadcast(_advertisement([channel]))

    def _publish(self, channel: Channel, data: bytes, time_ns: int) -> None:
        for client, subscription in channel.subscribers.items():
            self._send(client, struct.pack("<BIQ", MESSAGE, subscription, time_ns) + data)

    def _broadcast(self, message: str | bytes) -> None:
        for client in self._clients:
            self._send(client, message)

    def _send(self, client: ServerConnection, message: str | bytes) -> None:
        """Send to a client without waiting. Slow clients miss data; missing a control message ends their connection."""
        if client.transport.get_write_buffer_size() <= MOST_BUFFERED:
            broadcast([client], message)
        elif isinstance(message, str):
            client.transport.abort()


def _name(host: str) -> str:
    """Return the host name in a Host header, without the port; "" if the header is invalid."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _token(path: str) -> bytes:
    """Return the token in the query of a request's path; empty if there is none."""
    try:
        return parse_qs(urlsplit(path).query).get("token", [""])[-1].encode()
    except ValueError:
        return b""


def _advertisement(channels: Collection[Channel]) -> str:
    return json.dumps({"op": "advertise", "channels": [channel.about for channel in channels]})


def _status(level: int, message: str) -> str:
    return json.dumps({"op": "status", "level": level, "message": message})


def _field(given: object, key: str, kind: type[T]) -> T:
    """Return the value of a key of a control message or of its items. Raises ClientError."""
    value = given.get(key) if isinstance(given, dict) else None
    if type(value) is not kind or (isinstance(value, str) and len(value) > LONGEST_NAME):
        raise ClientError(f"{key}: takes {KINDS[kind]}")
    return value


def _numbers(given: object, key: str) -> set[int]:
    """Return the whole numbers in a list of a control message. Raises ClientError."""
    values = _field(given, key, list)
    if not all(type(value) is int for value in values):
        raise ClientError(f"{key}: takes a list of whole numbers")
    return set(values)
