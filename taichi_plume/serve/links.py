"""How messages go out and come in; all transports carry the same bytes (CDR) under the same topics."""

from collections.abc import Callable, Mapping
from typing import Protocol

from taichi_plume.serve.topics import Message

Hear = Callable[[bytes], None]


class LinkError(Exception):
    """A transport that cannot begin; one line."""


class Link(Protocol):
    """A transport, from its making on open to all who may come."""

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        """Bring what comes to those who hear its topic, and to `stray` what comes for none."""
        ...

    def publish(self, message: Message) -> None:
        """Send it to all who listen; returns at once."""
        ...

    def close(self) -> None:
        """End it."""
        ...
