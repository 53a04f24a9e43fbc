"""How both ends of zenoh are set up: they reach each other, and nothing else."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

USER = "robot"
LONGEST = 1 << 24  # bytes of a message that is taken in at all


def endpoint(host: str, port: int) -> str:
    """An address as zenoh writes it."""
    return f"tcp/[{host}]:{port}" if ":" in host else f"tcp/{host}:{port}"


def config(
    mode: str, endpoints: Mapping[str, list[str]], token: str | None, users: Path | None = None
) -> Any:
    """A configuration that knows no endpoints but these, to `listen` at or to `connect` to.

    token: what a client shows; users: a file with those who may come. Raises ImportError without zenoh.
    """
    import zenoh

    made = zenoh.Config()

    def put(key: str, value: Any) -> None:
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
