"""Protocols of the transports (zenoh, WebSocket); all carry the same bytes (CDR) under the same topics."""

from collections.abc import Mapping
from typing import Protocol

from taichi_plume.guard.input_error import InputError


class Hear(Protocol):
    """Receiver of the messages of a topic."""

    def __call__(self, data: bytes, json: bool = False) -> None:
        """Accept a message in CDR or JSON."""
        ...


class LinkError(InputError):
    """Error of a transport that cannot be opened, in a line."""


class Link(Protocol):
    """A transport, which clients can connect to from its construction on."""

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        """Pass each message to the receiver of its topic, and messages of other topics to `stray`."""
        ...

    def wants(self, topic: str, name: str) -> bool:
        """Return whether a topic with messages of type `name` has subscribers; the first call announces the topic."""
        ...

    def publish(self, topic: str, data: bytes) -> None:
        """Send a message to all subscribers without waiting. `wants` must have been called for the topic."""
        ...

    def go_on(self, t: float) -> None:
        """Announce that simulated time is t [s]."""
        ...

    def close(self) -> None:
        """Close the transport."""
        ...
