"""``taichi-plume serve scenario.yaml`` runs a scenario in real time, with robots from outside.

Robots of groups with ``algorithm: {kind: external}`` are driven by clients (see taichi_plume.client), by ROS 2 nodes
through a zenoh bridge, or manually from Foxglove; serve/topics.py lists the topics. The service accepts connections
from this machine only, unless another address is given. Another address needs a token for the service and the clients,
in the environment variable TAICHI_PLUME_TOKEN. Web pages cannot connect unless the origin of their site is allowed.
Files and exit codes are those of ``taichi-plume run``; such a run cannot be resumed.
"""

import gc
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from taichi_plume.api.simulate import simulate
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of, port_number
from taichi_plume.cli.run import carry_out, overrides_of
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say
from taichi_plume.serve.address import TOKEN, Address, address, fault_of_token, loopback, origin, token_of

if TYPE_CHECKING:
    from taichi_plume.serve.links import Link

LOCAL = Address("127.0.0.1", 7447)
NEEDED = {"zenoh": "eclipse-zenoh", "websockets": "websockets", "rosbags": "rosbags"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = parser_of("serve", serve, simulate, leave_out=("seed", "live", "watch", "allow_sha256"))
    given = vars(parser.parse_args(argv))
    speed, wait = given.get("speed", "1"), "wait" in given
    if speed != "max":
        try:
            fine = 0.0 < float(speed) < inf
        except ValueError:
            fine = False
        if not fine:
            parser.error(f"--speed takes a number above 0 or max, not {speed}")
    if wait and "at_once" in given:
        parser.error("--wait waits for robots in each tick, --at-once for none; give one of them")
    if wait and speed not in ("1", "max"):
        parser.error(f"--wait goes as fast as robots answer; --speed {speed} has no meaning with it")
    host, token = given["bind"].host if "bind" in given else "localhost", token_of()
    fault = fault_of_token(token) if token is not None else None
    if fault:
        parser.error(f"{TOKEN} {fault}")
    if not loopback(host) and token is None:
        parser.error(
            f"--bind {host}: others can reach that address: set a token, TAICHI_PLUME_TOKEN, in the "
            "environment of this command and of its clients"
        )
    gc.disable()  # until the run begins
    try:
        return exit_code(
            lambda: serve(**given), "interrupted before the run began", given["debug"], given.get("out")
        )
    finally:
        gc.enable()


def serve(
    scenario: Path,
    *,
    bind: Annotated[Address, "HOST:PORT", address] = LOCAL,
    websocket: Annotated[int, "PORT", port_number] = 8765,
    allow_origin: Annotated[Sequence[str], "--allow-origin ORIGIN ...", origin] = (),
    speed: Annotated[str, "X"] = "1",
    wait: bool = False,
    at_once: bool = False,
    **options: Any,
) -> int:
    """Run a scenario in real time, with robots that are driven from outside.

    scenario: YAML file with a group whose algorithm is {kind: external}. bind: address for robots, by default
    127.0.0.1:7447; other than local addresses take a token. websocket: port for the Foxglove app, on this machine
    alone; 0: none. allow_origin: let pages of this site connect to the WebSocket, such as https://app.foxglove.dev; may
    be repeated. speed: simulated time over that of the clock, or max: as fast as possible. wait: start each tick when
    all robots have answered the previous one. at_once: start without robots that have not connected yet.

    Other options are those of `simulate`.
    """
    debug, quiet = options.pop("debug"), options.get("progress") is False
    missing = [name for package, name in NEEDED.items() if find_spec(package) is None]
    if missing:
        raise InputError(f"needs {', '.join(missing)}: pip install 'taichi_plume[ros]'")
    from taichi_plume.assembly.preparation import load
    from taichi_plume.scenario.loading import ScenarioError

    prepared = load(scenario, overrides_of(options), options.pop("allow_outside", False))
    settings = prepared.scenario
    if not any(group.algorithm.outside for group in settings.robots):
        raise ScenarioError(
            [f"{scenario}: no robot is driven from outside; give a group algorithm: {{kind: external}}"]
        )
    _require_names(scenario, [group.name for group in settings.robots])
    for warning in () if quiet else prepared.resources.warnings:
        say(f"note: {warning}", error=True)
    from taichi_plume.execution.execute import new_run
    from taichi_plume.serve.service import Pace, Service

    settings = settings.model_copy(update={"checkpoint": None})  # external robots cannot be restored
    prepared = prepared._replace(scenario=settings)
    pace = Pace(inf if speed == "max" else float(speed), wait, at_once)
    with _links(bind, websocket, allow_origin, settings.name, quiet) as links:
        service = Service(pace, links, quiet)
        return carry_out(lambda: new_run(prepared, service=service, ask=True, **options), quiet, debug)


def _require_names(file: Path, names: Sequence[str]) -> None:
    """Raise ScenarioError if the names of two robot groups give the same ROS topics. file: of the scenario."""
    from taichi_plume.files.ros_messages import word
    from taichi_plume.scenario.loading import ScenarioError

    for n, name in enumerate(names):
        for other in names[:n]:
            if word(other) == word(name):
                what = f"'{other}' and '{name}' have the same topics, {word(name)}/..."
                raise ScenarioError([f"{file}: robots[{n}].name: {what}; rename one of them"])


@contextmanager
def _links(
    bind: Address, websocket: int, origins: Sequence[str], name: str, quiet: bool
) -> "Iterator[list[Link]]":
    """Open the links to clients (zenoh, WebSocket unless port 0) and close them on exit. Raises LinkError."""
    from taichi_plume.serve.websocket_link import WebSocketLink
    from taichi_plume.serve.zenoh_link import ZenohLink

    with ExitStack() as stack:
        links: list[Link] = [ZenohLink(bind.host, bind.port, token_of())]
        stack.callback(links[0].close)
        if websocket:
            remark = (lambda line: None) if quiet else partial(say, error=True)
            links.append(WebSocketLink(websocket, name, origins, token_of(), remark))
            stack.callback(links[1].close)
        if not quiet:
            say(f"robots: {bind.host}:{bind.port}" + _websocket(websocket), error=True)
        yield links


def _websocket(port: int) -> str:
    query = f"/?token=${TOKEN}" if token_of() else ""
    return f"; Foxglove: ws://127.0.0.1:{port}{query}" if port else ""
