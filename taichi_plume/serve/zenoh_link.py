"""The transport for robots and ROS 2: zenoh, over TCP."""

import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import zenoh

from taichi_plume.serve.links import Hear, LinkError
from taichi_plume.serve.zenoh_config import USER, config, endpoint


class ZenohLink:
    """Open at an address; clients need `token`, where there is one. Raises LinkError where it cannot be had."""

    def __init__(self, host: str, port: int, token: str | None):
        with tempfile.TemporaryDirectory() as folder:  # only its owner can look into it
            users = Path(folder) / "users"
            if token is not None:
                users.write_text(f"{USER}:{token}\n", encoding="utf-8")
            ends = {"listen": [endpoint(host, port)]}
            made = config("router", ends, None, users if token is not None else None)
            try:
                self.session = zenoh.open(made)
            except zenoh.ZError as error:
                raise LinkError(
                    f"{host}:{port}: cannot be listened at ({str(error).split(' at /')[0]})"
                ) from None
        self._publishers: dict[str, Any] = {}

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        """Bring what comes to those who hear its topic; other topics are not even sent here."""
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
        """Send a message to all who listen; a slow listener loses the oldest."""
        self._publishers[topic].put(data)

    def go_on(self, t: float) -> None:
        """Who wants to know simulated time listens to the clock."""

    def close(self) -> None:
        with suppress(Exception):
            self.session.close()
