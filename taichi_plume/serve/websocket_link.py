"""The transport for the Foxglove app and whatever speaks its protocol: a WebSocket."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import foxglove
from foxglove.websocket import Capability, ServerListener

from taichi_plume.files import ros_messages as ros
from taichi_plume.serve.links import Hear, LinkError


class WebSocketLink:
    """A server at an address; there is no token, so it had better be of this machine alone.

    What clients publish may be CDR or JSON. Raises LinkError where the port cannot be had.
    """

    def __init__(self, host: str, port: int, name: str):
        self._listener = Listener()
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        try:
            self._server = foxglove.start_server(
                name=name,
                host=host,
                port=port,
                capabilities=[Capability.ClientPublish, Capability.Time],
                server_listener=self._listener,
                supported_encodings=["cdr", "json"],
                context=self._context,
            )
        except (RuntimeError, OSError, ValueError) as error:
            raise LinkError(f"{host}:{port}: cannot be listened at ({error})") from None
        self.port = self._server.port

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        """Bring what comes to those who hear its topic; to `stray` what is for none."""
        self._listener.stray, self._listener.incoming = stray, incoming

    def wants(self, topic: str, name: str) -> bool:
        """Whether anybody listens to a topic of messages of that name."""
        channel = self._channels.get(topic)
        if channel is None:
            schema = foxglove.Schema(name=name, encoding="ros2msg", data=ros.definition(name).encode())
            channel = self._channels[topic] = foxglove.Channel(
                f"/{topic}", schema=schema, message_encoding="cdr", context=self._context
            )
        return channel.has_sinks()

    def publish(self, topic: str, data: bytes) -> None:
        """Send a message to all who listen; a slow listener loses the oldest."""
        self._channels[topic].log(data)

    def go_on(self, t: float) -> None:
        """Let clients go by simulated time."""
        self._server.broadcast_time(round(1e9 * max(0.0, t)))

    def close(self) -> None:
        """End it."""
        with suppress(Exception):
            self._server.stop()


class Listener(ServerListener):
    """What clients of the WebSocket publish, by the topics that they have told before."""

    def __init__(self):
        self.incoming: Mapping[str, Hear] = {}
        self.stray: Hear = lambda data: None
        self.topics: dict[tuple[int, int], tuple[str, str]] = {}

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """A client tells what it is going to publish."""
        self.topics[client.id, channel.id] = channel.topic.strip("/"), channel.encoding

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """It will publish that no more."""
        self.topics.pop((client.id, client_channel_id), None)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """A message came."""
        topic, encoding = self.topics.get((client.id, client_channel_id), ("", ""))
        self.incoming.get(topic, self.stray)(data, encoding == "json")
