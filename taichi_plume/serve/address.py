"""Addresses, origins and tokens of the live service, and the configuration of zenoh at both ends."""

import json
import os
from argparse import ArgumentTypeError
from collections.abc import Mapping
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

if TYPE_CHECKING:
    import zenoh

TOKEN = "TAICHI_PLUME_TOKEN"  # environment variable
SHORTEST = 8  # smallest number of characters of a token
USER = "robot"
LONGEST = 1 << 24  # largest number of bytes of a received message


class Address(NamedTuple):
    """TCP address; host: name or IP address."""

    host: str
    port: int


def address(text: str) -> Address:
    """Return the TCP address in a text such as 127.0.0.1:7447 or [::1]:7447. Raises ArgumentTypeError."""
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise ArgumentTypeError(f"takes HOST:PORT, such as 127.0.0.1:7447, not {text}")
    return Address(host, int(port))


def loopback(host: str) -> bool:
    """Return whether the host, a name or IP address, reaches this machine only."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def origin(text: str) -> str:
    """Return a web origin, such as https://app.foxglove.dev, in the form of browsers. Raises ArgumentTypeError."""
    try:
        scheme, place, *rest = urlsplit(text.strip().lower())
    except ValueError:
        scheme, place, rest = "", "", []
    if (
        not scheme
        or "*" in place
        or not (place or scheme == "file")
        or rest not in (["", "", ""], ["/", "", ""])
    ):
        raise ArgumentTypeError(f"takes an origin, such as https://app.foxglove.dev, not {text}")
    return f"{scheme}://{place}"


def token_of(environment: Mapping[str, str] = os.environ) -> str | None:
    """Return the service's token from the environment variable TOKEN, without surrounding blanks; None if not set."""
    return environment.get(TOKEN, "").strip() or None


def fault_of_token(token: str) -> str | None:
    """Return the reason why a text cannot be the service's token; None if it can."""
    if len(token) < SHORTEST:
        return f"has {len(token)} characters, must have {SHORTEST} or more"
    if not token.isprintable():
        return "has a character that cannot be printed; remove it"
    return None


def endpoint(host: str, port: int) -> str:
    """Return a TCP address in zenoh's notation, such as tcp/127.0.0.1:7447."""
    return f"tcp/[{host}]:{port}" if ":" in host else f"tcp/{host}:{port}"


def zenoh_config(
    mode: str, endpoints: Mapping[str, list[str]], token: str | None, users: Path | None = None
) -> "zenoh.Config":
    """Return a zenoh configuration with only these endpoints, by kind: `connect` of clients, otherwise of servers.

    token: of a client; users: file with the clients that may connect. Raises ImportError without zenoh.
    """
    import zenoh

    made = zenoh.Config()

    def put(key: str, value: object) -> None:
        made.insert_json5(key, json.dumps(value))

    put("mode", mode)
    put("scouting/multicast/enabled", False)
    put("scouting/gossip/enabled", False)
    put("transport/link/rx/max_message_size", LONGEST)
    for kind, ends in endpoints.items():
        put(f"{kind}/endpoints", ends)
    if mode == "client":
        put("connect/timeout_ms", 1000)
    if token is not None:
        put("transport/auth/usrpwd/user", USER)
        put("transport/auth/usrpwd/password", token)
    if users is not None:
        put("transport/auth/usrpwd/dictionary_file", str(users))
    return made
