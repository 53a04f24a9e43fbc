"""Where a service listens, and who may come: an address of this machine alone, or one with a token."""

import os
from argparse import ArgumentTypeError
from collections.abc import Mapping
from ipaddress import ip_address
from typing import NamedTuple
from urllib.parse import urlsplit

TOKEN = "TAICHI_PLUME_TOKEN"  # in the environment
SHORTEST = 8  # characters of a token


class Address(NamedTuple):
    """host: name or number; port: of TCP."""

    host: str
    port: int


def address(text: str) -> Address:
    """An address such as 127.0.0.1:7447 or [::1]:7447. Raises ArgumentTypeError."""
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise ArgumentTypeError(f"takes HOST:PORT, such as 127.0.0.1:7447, not {text}")
    return Address(host, int(port))


def loopback(host: str) -> bool:
    """Whether an address is of this machine alone."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def origin(text: str) -> str:
    """Origin of pages, such as https://app.foxglove.dev, as browsers send it. Raises ArgumentTypeError."""
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
    """The token that the environment gives, without blanks around it."""
    return environment.get(TOKEN, "").strip() or None


def fault_of_token(token: str) -> str | None:
    """What is wrong with a token of a service, if anything."""
    if len(token) < SHORTEST:
        return f"has {len(token)} characters, must have {SHORTEST} or more"
    if not token.isprintable():
        return "must have no character that cannot be printed"
    return None
