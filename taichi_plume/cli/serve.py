"""``python -m taichi_plume.serve scenario.yaml`` runs a scenario in real time, with robots from outside.

Robots of groups with ``algorithm: {kind: external}`` are driven by clients (see taichi_plume.client), by ROS 2 nodes
through a zenoh bridge, or manually from Foxglove; serve/topics.py lists the topics. The service accepts connections
from this machine only, unless another address is given. Another address needs a token for the service and the clients,
in the environment variable TAICHI_PLUME_TOKEN. Web pages cannot connect unless the origin of their site is allowed.
Files and exit codes are those of ``python -m taichi_plume.run``; such a run cannot be resumed.
"""

import argparse
import gc
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, option, overrides_of, whole_number
from taichi_plume.cli.run import carry_out
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say
from taichi_plume.serve.address import TOKEN, Address, address, fault_of_token, loopback, origin, token_of

if TYPE_CHECKING:
    from taichi_plume.serve.links import Link

PORT = 7447
WEBSOCKET = 8765
NEEDED = {"zenoh": "eclipse-zenoh", "websockets": "websockets", "rosbags": "rosbags"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    gc.disable()  # until the run begins
    try:
        return exit_code(lambda: _serve(args), "interrupted before the run began", args.debug, args.out)
    finally:
        gc.enable()


def _serve(args: argparse.Namespace) -> int:
    missing = [name for package, name in NEEDED.items() if find_spec(package) is None]
    if missing:
        raise InputError(f"needs {', '.join(missing)}: pip install 'taichi_plume[ros]'")
    from taichi_plume.assembly.preparation import load
    from taichi_plume.scenario.loading import ScenarioError

    prepared = load(args.scenario, overrides_of(args, "duration"), args.allow_outside)
    scenario = prepared.scenario
    if not any(group.algorithm.outside for group in scenario.robots):
        raise ScenarioError(
            [f"{args.scenario}: no robot is driven from outside; give a group algorithm: {{kind: external}}"]
        )
    _require_names(args.scenario, [group.name for group in scenario.robots])
    for warning in () if args.quiet else prepared.resources.warnings:
        say(f"note: {warning}", error=True)
    from taichi_plume.assembly.own_code import execute
    from taichi_plume.engine import program
    from taichi_plume.execution.execute import Job, inputs_of, run
    from taichi_plume.files.run_folder import RunFolder
    from taichi_plume.serve.service import Pace, Service

    execute(prepared, args.allow_code, ask=True)
    scenario = scenario.model_copy(update={"checkpoint": None})  # external robots cannot be restored
    prepared = prepared._replace(scenario=scenario)
    backend = program.start(args.arch)
    pace = Pace(inf if args.speed == "max" else float(args.speed), args.wait, args.at_once)
    with _links(args, scenario.name) as links:
        service = Service(pace, links, args.quiet)
        with RunFolder(scenario.name, args.out, args.force, inputs=inputs_of(prepared)) as folder:
            job = Job(
                prepared, folder, args.arch, backend, not args.no_recording, report=not args.no_report,
                service=service, progress=False if args.quiet else None,
            )  # fmt: skip
            return carry_out(lambda: run(job), args.quiet, args.debug)


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
def _links(args: argparse.Namespace, name: str) -> "Iterator[list[Link]]":
    """Open the links to clients (zenoh, WebSocket unless port 0) and close them on exit. Raises LinkError."""
    from taichi_plume.serve.websocket_link import WebSocketLink
    from taichi_plume.serve.zenoh_link import ZenohLink

    bind: Address = args.bind
    with ExitStack() as stack:
        links: list[Link] = [ZenohLink(bind.host, bind.port, token_of())]
        stack.callback(links[0].close)
        if args.websocket:
            remark = (lambda line: None) if args.quiet else partial(say, error=True)
            links.append(WebSocketLink(args.websocket, name, args.allow_origin, token_of(), remark))
            stack.callback(links[1].close)
        if not args.quiet:
            say(f"robots: {bind.host}:{bind.port}" + _websocket(args.websocket), error=True)
        yield links


def _websocket(port: int) -> str:
    query = f"/?token=${TOKEN}" if token_of() else ""
    return f"; Foxglove: ws://127.0.0.1:{port}{query}" if port else ""


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.serve",
        description="Run a scenario in real time, with robots that are driven from outside.",
    )
    scenario = "YAML file with a group whose algorithm is {kind: external}"
    parser.add_argument("scenario", type=Path, help=scenario)
    bind = f"address for robots (default: 127.0.0.1:{PORT}); other than local addresses take a token"
    option(parser, "--bind", address, "HOST:PORT", bind, default=Address("127.0.0.1", PORT))
    port = f"port for the Foxglove app, on this machine alone (default: {WEBSOCKET}; 0: none)"
    option(parser, "--websocket", whole_number(0, 65535), "PORT", port, default=WEBSOCKET)
    site = (
        "let pages of this site connect to the WebSocket, such as https://app.foxglove.dev; may be repeated"
    )
    option(parser, "--allow-origin", origin, "ORIGIN", site, action="append", default=[])
    speed = "simulated time over that of the clock, or max: as fast as possible (default: 1)"
    option(parser, "--speed", str, "X", speed, default="1")
    flag(parser, "--wait", "start each tick when all robots have answered the previous one")
    flag(parser, "--at-once", "start without robots that have not connected yet")
    add(parser, "--duration", "--out", "--arch", "--engine", "--set")
    add(parser, "--no-recording", "--no-report", "--quiet", "--force")
    add(parser, "--allow-code", "--allow-outside", "--debug")
    args = parser.parse_args(argv)
    if args.speed != "max":
        try:
            fine = 0.0 < float(args.speed) < inf
        except ValueError:
            fine = False
        if not fine:
            parser.error(f"--speed takes a number above 0 or max, not {args.speed}")
    if args.wait and args.at_once:
        parser.error("--wait waits for robots in each tick, --at-once for none; give one of them")
    if args.wait and args.speed not in ("1", "max"):
        parser.error(f"--wait goes as fast as robots answer; --speed {args.speed} has no meaning with it")
    token = token_of()
    fault = fault_of_token(token) if token is not None else None
    if fault:
        parser.error(f"{TOKEN} {fault}")
    if not loopback(args.bind.host) and token is None:
        parser.error(
            f"--bind {args.bind.host}: others can reach that address: set a token, TAICHI_PLUME_TOKEN, in the "
            "environment of this command and of its clients"
        )
    return args
