"""How messages go out and come in; all transports carry the same bytes (CDR) under the same topics."""

from collections.abc import Mapping
from typing import Protocol

from taichi_plume.guard.input_error import InputError


class Hear(Protocol):
    """What hears of a topic."""

    def __call__(self, data: bytes, json: bool = False) -> None:
        """A message came, as CDR or as a text in JSON."""
        ...


class LinkError(InputError):
    """A transport that cannot begin; one line."""


class Link(Protocol):
    """A transport, from its making on open to all who may come."""

    def listen(self, incoming: Mapping[str, Hear], stray: Hear) -> None:
        """Bring what comes to those who hear its topic, and to `stray` what comes for none."""
        ...

    def wants(self, topic: str, name: str) -> bool:
        """Whether anybody listens to a topic of messages of that name; it is told that there is one."""
        ...

    def publish(self, topic: str, data: bytes) -> None:
        """Send a message to all who listen; returns at once. The topic is one that was wanted."""
        ...

    def go_on(self, t: float) -> None:
        """Simulated time is t [s] now."""
        ...

    def close(self) -> None:
        """End it."""
        ...
