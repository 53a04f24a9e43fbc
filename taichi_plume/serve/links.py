"""Protocols of the transports (zenoh, WebSocket), which all carry the same bytes (CDR) under the same topics."""

from collections.abc import Callable, Mapping
from typing import Protocol, TypeAlias

from taichi_plume.guard.input_error import InputError

Hear: TypeAlias = Callable[..., None]
"""Receiver of the messages of a topic: called with a message, encoded in CDR or, with `json=True`, in JSON."""


class LinkError(InputError):
    """Error of a transport that cannot be opened, described in one line."""


class Link(Protocol):
    """Protocol of a transport, to which clients can connect from its construction on."""

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        """Pass each incoming message to the receiver of its topic, and messages of other topics to `stray`."""
        ...

    def wants(self, topic: str, name: str) -> bool:
        """Return whether a topic with messages of ROS type `name` has subscribers; the first call announces it."""
        ...

    def publish(self, topic: str, data: bytes) -> None:
        """Send a message to all subscribers of a topic without waiting; `wants` must have been called before."""
        ...

    def announce_time(self, t: float) -> None:
        """Announce to clients that simulated time is t [s]."""
        ...

    def close(self) -> None:
        """Close the transport and all connections."""
        ...
