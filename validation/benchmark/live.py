"""Latency of the live service under load: ``python -m taichi_plume.validation.benchmark live [--minutes 10]``.

A separate process serves a 2-D room in real time, with gas, recording, fifty external robots and two internal robots.
This process runs a client for each external robot on the same loopback. It cuts the link of robot 2, which goes through
a relay, for 20 s, and sends malformed messages at random times. Figures:

    reading after command [ms]   p50 and p99 of the time from sending a command to the arrival of the next
                                 readings, which includes the wait for a tick, half a tick in the mean.
    reading after tick [ms]      computing time of a tick, the share of the service.
    ticks, missed                ticks whose readings came after the start of the next tick.
    readings missed              ticks whose readings a client did not receive, over all clients.
"""

import argparse
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from taichi_plume.client import Readings, Team
from taichi_plume.files import ros_messages as ros
from taichi_plume.guard.terminal import Parser, say
from taichi_plume.validation.case import Keys

ROOM = Path(__file__).resolve().parents[2] / "configs/live/room.yaml"
CUT_S = 20.0
CUT = 2  # robot whose link is cut
PACE_S = 0.2  # between commands of a client, in the mean
CLIENTS = 50
MALFORMED = 10_000
START_S = 120.0


def free_port() -> int:
    """Return the number of an unused port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Relay:
    """TCP relay from `port` to another port, whose links can be cut and mended."""

    def __init__(self, to: int):
        self.to, self.whole = to, True
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.links: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Close all links of the relay and refuse new ones."""
        self.whole = False
        for link in self.links:
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
            link.close()
        self.links = []

    def mend(self) -> None:
        """Accept new connections of the relay again."""
        self.whole = True

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self.listener.accept()
            except OSError:
                return
            if not self.whole:
                near.close()
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self.to))
            except OSError:
                near.close()
                continue
            self.links += [near, far]
            for a, b in ((near, far), (far, near)):
                threading.Thread(target=_pump, args=(a, b), daemon=True).start()


def _pump(a: socket.socket, b: socket.socket) -> None:
    with suppress(OSError):
        while data := a.recv(65536):
            b.sendall(data)
    for end in (a, b):
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


class Noting(Team):
    """Client that records the tick of every received reading."""

    def __init__(self, *args: Any, **keys: Any):
        self.ticks: list[int] = []
        super().__init__(*args, **keys)

    def _hear(self, sample: Any) -> None:
        super()._hear(sample)
        if self._newest is not None:
            self.ticks.append(self._newest.tick)


class Driver:
    """Client in a thread that drives a robot at random times and records latencies."""

    def __init__(self, port: int, robot: int, pace: float, seed: int):
        self.team = Noting(f"127.0.0.1:{port}", "remote", [robot], patience=START_S)
        self.rng, self.pace = np.random.default_rng(seed), pace
        self.sent: dict[int, float] = {}
        self.latencies: list[float] = []
        self.lost: list[bool] = []
        self.over = threading.Event()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._listen, self._drive)]
        for thread in self._threads:
            thread.start()

    def _listen(self) -> None:
        while not self.over.is_set():
            now = self.team.wait(0.5)
            if now is not None:
                self._note(now, time.perf_counter())

    def _note(self, now: Readings, when: float) -> None:
        self.lost.append(bool(now.lost[0]))
        for number in [sent for sent in list(self.sent) if sent <= int(now.answered[0])]:
            sent_at = self.sent.pop(number)
            if now.tick > 1:  # earlier commands waited for the run to start
                self.latencies.append(when - sent_at)

    def _drive(self) -> None:
        while not self.over.wait(self.rng.uniform(0.5, 1.5) * self.pace):
            turn = self.rng.uniform(-1.0, 1.0)
            when = time.perf_counter()
            with suppress(Exception):  # the link may be cut
                self.sent[self.team.drive(0.1, turn)] = when

    def close(self) -> None:
        """Stop the client's threads and close its connection."""
        self.over.set()
        for thread in self._threads:
            thread.join()
        with suppress(Exception):
            self.team.close()

    @property
    def ticks(self) -> list[int]:
        """Ticks of the received readings."""
        return self.team.ticks

    @property
    def missed(self) -> int:
        """Number of ticks without readings between the first and the last received tick."""
        return len(range(self.ticks[0], self.ticks[-1] + 1)) - len(set(self.ticks)) if self.ticks else 0


def disturb(port: int, count: int, seconds: float, over: threading.Event) -> None:
    """Send `count` malformed messages to the service, spread over `seconds`."""
    rng = np.random.default_rng(7)
    team = Team(f"127.0.0.1:{port}", "remote", [0], patience=START_S)
    session: Any = team._session
    publishers = [
        session.declare_publisher(f"remote{end}") for end in ("/commands", "_0/cmd_vel", "_3/cmd_vel")
    ]
    good = ros.encode(ros.message(ros.COMMANDS, number=1, robot=[1 << 20], speed=[0.1], turn_rate=[0.0]))
    for k in range(count):
        data = bytearray(rng.bytes(int(rng.integers(300))) if k % 2 else good)
        for _ in range(rng.integers(4)):
            if data:
                data[rng.integers(len(data))] = rng.integers(256)
        publishers[rng.integers(len(publishers))].put(
            bytes(data[: rng.integers(1, 400)]) if k % 50 else bytes(100_000)
        )
        if k % 10 == 9 and over.wait(10 * seconds / count):
            break
    team.close()


@contextmanager
def service(folder: Path, port: int, seconds: float, clients: int) -> Iterator["subprocess.Popen[str]"]:
    """Serve the room in real time in another process; yield the process."""
    changes = {
        "duration": seconds,
        "robots.0.count": clients,
        "robots.0.start": "{kind: area, low: [2, 0.2], high: [3.9, 2.8]}",
        "robots.1.start": "{kind: positions, positions: [[1, 0.3], [1, 2.7]]}",
    }
    command = [
        sys.executable, "-m", "taichi_plume.serve", str(ROOM), "--bind", f"127.0.0.1:{port}", "--websocket", "0",
        "--out", str(folder / "run"), "--no-report",
        *(part for key, value in changes.items() for part in ("--set", f"{key}={value}")),
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        until(lambda: process.poll() is not None or _answers(port), "the service to accept connections")
        yield process
    finally:
        if process.poll() is None:
            process.kill()


def _answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
        return True
    return False


def measure(seconds: float, clients: int, malformed: int) -> Keys:
    """Run the live service for `seconds` with these clients and malformed messages; return the figures."""
    port, over = free_port(), threading.Event()
    with TemporaryDirectory() as name, ExitStack() as stack:
        process = stack.enter_context(service(Path(name), port, seconds, clients))
        relay = Relay(port)
        everyone = [Driver(relay.port if k == CUT else port, k, PACE_S, k) for k in range(clients)]
        for driver in everyone:
            stack.callback(driver.close)
        until(
            lambda: any(driver.ticks[-1:] > [0] for driver in everyone) or process.poll() is not None,
            "the run to start",
        )
        if process.poll():
            raise RuntimeError(process.communicate()[1])
        noise = threading.Thread(target=disturb, args=(port, malformed, 0.8 * seconds, over), daemon=True)
        noise.start()
        stack.callback(over.set)
        time.sleep(0.4 * seconds)
        cut = min(CUT_S, 0.2 * seconds)
        relay.cut()
        time.sleep(cut)
        relay.mend()
        _, output = process.communicate(timeout=2 * seconds + START_S)
        result = json.loads((Path(name) / "run/result.json").read_text())["service"]
    lat = 1e3 * np.concatenate([driver.latencies for driver in everyone if driver is not everyone[CUT]])
    after = np.array(everyone[CUT].ticks)
    gap = np.diff(after).max() if len(after) > 1 else 0
    return {
        "seconds": seconds,
        "exit code": process.returncode,
        "clients": len(everyone),
        "reading after command [ms], p50": float(np.percentile(lat, 50)),
        "reading after command [ms], p99": float(np.percentile(lat, 99)),
        "commands": len(lat),
        "reading after tick [ms], p50": result["tick_ms"]["p50"],
        "reading after tick [ms], p99": result["tick_ms"]["p99"],
        "ticks": result["ticks"],
        "ticks missed": result["ticks_missed"],
        "readings missed, of all but the cut": sum(
            driver.missed for driver in everyone if driver is not everyone[CUT]
        ),
        "cut [s]": cut,
        "longest gap of robot 2 [ticks]": int(gap),
        "robot 2 was reported back": " remote_2 back" in output,
        "robot 2 lost at the end": bool(everyone[CUT].lost[-1]),
        **{f"messages {name}": count for name, count in result["messages"]["remote"].items()},
    }


def until(true: Callable[[], bool], what: str) -> None:
    """Wait until the condition `true` holds. Raises TimeoutError, with `what`, after START_S."""
    end = time.monotonic() + START_S
    while not true():
        if time.monotonic() > end:
            raise TimeoutError(f"waited for {what}")
        time.sleep(0.05)


def main(argv: list[str]) -> int:
    """Measure and print the figures of the live service; return the exit code."""
    parser = Parser(
        prog="python -m taichi_plume.validation.benchmark live",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--minutes", type=float, default=10.0, help="duration of the run, real time (default: 10)"
    )
    parser.add_argument("--clients", type=int, default=CLIENTS)
    parser.add_argument("--malformed", type=int, default=MALFORMED, help="number of malformed messages")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args(argv)
    figures = measure(60.0 * args.minutes, args.clients, args.malformed)
    if args.json:
        say(json.dumps(figures))
    else:
        for name, value in figures.items():
            say(f"{name:<40} {value:.4g}" if isinstance(value, float) else f"{name:<40} {value}")
    return 0 if figures["exit code"] == 0 else 1
