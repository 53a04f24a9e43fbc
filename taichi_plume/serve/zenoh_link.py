"""Transport for robots and ROS 2: zenoh over TCP."""

import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import zenoh

from taichi_plume.serve.address import USER, endpoint, zenoh_config
from taichi_plume.serve.links import Hear, LinkError


class ZenohLink:
    """zenoh router at a TCP address; clients need the `token`, if any. Raises LinkError if the address is not free."""

    def __init__(self, host: str, port: int, token: str | None):
        with tempfile.TemporaryDirectory() as folder:  # readable only by the owner
            users = Path(folder) / "users"
            if token is not None:
                users.write_text(f"{USER}:{token}\n", encoding="utf-8")
            ends = {"listen": [endpoint(host, port)]}
            made = zenoh_config("router", ends, None, users if token is not None else None)
            try:
                self.session = zenoh.open(made)
            except zenoh.ZError as error:
                raise LinkError(f"{host}:{port}: cannot be opened ({str(error).split(' at /')[0]})") from None
        self._publishers: dict[str, zenoh.Publisher] = {}

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        """Pass each incoming message to the receiver of its topic; zenoh does not deliver messages of other topics."""
        self._subscribers = [
            self.session.declare_subscriber(topic, lambda sample, hear=hear: hear(sample.payload.to_bytes()))
            for topic, hear in incoming.items()
        ]

    def wants(self, topic: str, name: str) -> bool:
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self.session.declare_publisher(topic)
        return bool(publisher.matching_status.matching)

    def publish(self, topic: str, data: bytes) -> None:
        """Send a message to all subscribers of a topic; a slow subscriber loses the oldest messages."""
        self._publishers[topic].put(data)

    def announce_time(self, t: float) -> None:
        """Do nothing: zenoh clients read simulated time from the topic `clock`."""

    def close(self) -> None:
        with suppress(Exception):
            self.session.close()
