"""Real-time clock of a served run: start of ticks, messages after each tick, waiting for external robots.

In real time a time step (tick) lasts as long on the clock as in the simulation. At its start the robots get the
commands received so far; at its end their readings are sent. If a tick ends late, it counts as missed and the
simulation catches up; if the delay exceeds SLIP seconds, the schedule is shifted. With `wait`, the next tick starts
when all robots that are not lost have answered this tick's readings: results are then independent of computer speed.
"""

import gc
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import ceil, inf
from typing import NamedTuple

import numpy as np

from taichi_plume.agents.external import LOST, ExternalAlgorithm, Orders
from taichi_plume.execution.signals import SignalRequests
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_odometry import DeadReckoning
from taichi_plume.files.ros_robots import MapFrame, sensor_fields
from taichi_plume.guard.terminal import say
from taichi_plume.serve import topics
from taichi_plume.serve.inbox import Inbox
from taichi_plume.serve.links import Hear, Link
from taichi_plume.time_loop import Every, TimeLoop

SLIP = 1.0  # s, largest delay that the simulation catches up
LOOK_S = 0.1  # s, time between checks for signals while waiting
AGAIN_S = 0.5  # s, time between repeated readings until all robots are connected
MOST_TIMES = 1_000_000  # largest number of recorded latencies
VIEW_S = 1.0  # s, time between messages with the gas
SHOWN = 6  # largest number of robots named in a message


class Pace(NamedTuple):
    """Timing of a served run. speed: simulated over clock time, inf for as fast as possible; wait: whether each step
    waits for the robots' answers; at_once: whether the run starts before all robots have connected.
    """

    speed: float = 1.0
    wait: bool = False
    at_once: bool = False


class Outside:
    """Group of external robots with its algorithm and its inbox for commands."""

    def __init__(
        self,
        sim: TimeLoop,
        number: int,
        algorithm: ExternalAlgorithm,
        remark: Callable[[str], None],
        frame: MapFrame,
    ):
        group = sim.swarm.groups[number]
        model, floor = algorithm.model, sim.scenario.floor
        self.name, self.algorithm = ros.word(group.name), algorithm
        self.inbox = Inbox(
            self.name,
            group.size,
            model.placed,
            (floor.low, floor.high),
            model.timeout,
            remark,
            ceiling=sim.grid.extent[2] if algorithm.flies else None,
            frame=frame,
        )
        self.frame = frame
        self.noses = [sensor_fields(nose) for nose in group.model.sensors.noses]
        self.each = group.size <= topics.MOST_ROBOTS
        self.reckoning = DeadReckoning(group.model.localization, group.size)
        self.lost, self.over = np.zeros(group.size, bool), np.zeros(group.size, bool)
        self.times_lost = 0

    def incoming(self) -> dict[str, Hear]:
        """Return the receiver of each incoming topic of the group, by topic."""
        inbox = self.inbox
        heard: dict[str, Hear] = {f"{self.name}/commands": inbox.hear_commands}
        kind, hear = ("pose", inbox.hear_pose) if inbox.placed else ("cmd_vel", inbox.hear_twist)
        for n in range(inbox.size if self.each else 0):
            heard[f"{self.name}_{n}/{kind}"] = partial(hear, n)
        return heard

    def readings(self, t: float, tick: int) -> list[topics.Message]:
        """Return the messages with the robots' readings at time t [s]; tick: number of the time step."""
        readings, inbox = self.algorithm.sample(), self.inbox
        by_declaring = self.algorithm.members.groups[0].model.found == "declared"
        readings["over"] = self.over = readings["found"] | (by_declaring & (readings["declarations"] > 0))
        messages = [topics.readings(self.name, t, tick, readings, answered=inbox.number, lost=inbox.lost())]
        if self.each:
            place = np.column_stack([readings["believed_position"], readings["altitude"]])
            self.reckoning.advance(t, place, readings["believed_heading"])
            messages += topics.of_each(self.name, t, readings, self.noses, self.reckoning, self.frame)
        return messages

    def order(self, t: float) -> list[str]:
        """Pass the clients' commands to the robots at time t [s]; return a line for robots that are lost or back."""
        orders = self.inbox.orders()
        self.algorithm.order(orders, t)
        lost = orders.state == LOST
        news = {"lost: no command received, standing still": lost & ~self.lost, "back": self.lost & ~lost}
        self.lost, self.times_lost = lost, self.times_lost + int((lost & ~self.lost).sum())
        return [
            f"t = {t:.1f} s: {_named(self.name, np.flatnonzero(robots))} {what}"
            for what, robots in news.items()
            if robots.any()
        ]


class Service:
    """Live service of a simulation: real-time clock, sensor readings to external programs and commands from them.

    quiet: whether nothing is printed.
    """

    def __init__(
        self,
        pace: Pace,
        links: Sequence[Link],
        quiet: bool = False,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.pace, self.links, self.quiet, self.clock, self.sleep = pace, links, quiet, clock, sleep
        self.remarks: deque[str] = deque(maxlen=100)
        self.groups: list[Outside] = []
        self.ticks = self.missed = self.strays = 0
        self.taking: deque[float] = deque(maxlen=MOST_TIMES)  # s, from a tick's start to its readings
        self._start = self._began = 0.0

    def warm(self, sim: TimeLoop) -> None:
        sim.tick = 0
        for team in sim.teams:
            if isinstance(team.algorithm, ExternalAlgorithm):
                team.algorithm.order(Orders.none(team.algorithm.size), 0.0)
                team.algorithm.sample()
        for message in topics.Scene(sim).messages():
            message.data()
        sim.advance()
        sim.swarm.snapshot()
        sim.reset()

    def attach(self, sim: TimeLoop, signals: SignalRequests) -> None:
        self.sim, self.signals = sim, signals
        scene = topics.Scene(sim)
        self._frame = scene.frame
        for team in sim.teams:
            if isinstance(team.algorithm, ExternalAlgorithm):
                remark = self.remarks.append
                self.groups.append(Outside(sim, team.numbers[0], team.algorithm, remark, self._frame))
        self.remarks += [
            f"{group.name} has {group.inbox.size} robots, more than {topics.MOST_ROBOTS}: no topics of single robots"
            for group in self.groups
            if not group.each
        ]
        incoming = {topic: hear for group in self.groups for topic, hear in group.incoming().items()}
        for link in self.links:
            link.listen(incoming, self._stray)
        groups = sim.swarm.groups
        first_trials = [np.arange(group.start, group.start + group.count) for group in groups]
        self._first = np.concatenate(first_trials or [np.zeros(0, int)])
        self._names = [f"{ros.word(group.name)}_{n}" for group in groups for n in range(group.count)]
        sim.observers.insert(0, Every(sim.dt, lambda _: self.publish()))  # before files are written
        sim.observers.append(Every(VIEW_S, lambda _: self._send(scene.messages())))
        sim.observers.append(Every(sim.dt, lambda _: self.keep_time()))
        gc.collect()
        gc.freeze()  # a collection of all objects made so far would take longer than a tick

    def _stray(self, data: bytes, json: bool = False) -> None:
        """Count a message of an unknown topic, and note a remark now and then."""
        self.strays += 1
        if self.strays & (self.strays - 1) == 0:
            self.remarks.append(f"messages of unknown topics: {self.strays:,}")

    def close(self) -> None:
        gc.unfreeze()
        tick = max(0, self.sim.tick)
        self._send([topics.ended(group.name, self.sim.t, tick) for group in self.groups])
        for link in self.links:
            link.close()

    # ------------------------------------------------------------ each tick

    def publish(self) -> None:
        """Send the present readings and poses of all robots."""
        sim = self.sim
        messages = [topics.clock(sim.t)]
        for group in self.groups:
            messages += group.readings(sim.t, sim.tick)
        if len(self._names) <= topics.MOST_ROBOTS:
            now = {name: values[self._first] for name, values in sim.swarm.snapshot().items()}
            messages.append(topics.poses(sim.t, self._names, now, self._frame))
        speed = inf if self.pace.wait else self.pace.speed
        for group in self.groups:  # before sending: answers may arrive before the last message is out
            behind = ceil(group.inbox.timeout * speed / sim.dt) if speed < inf else 1 << 40
            group.inbox.published(sim.tick, sim.tick - behind)
        for link in self.links:
            link.announce_time(sim.t)
        self._send(messages)
        if sim.tick > 0:
            self.taking.append(self.clock() - self._began)

    def _send(self, messages: Sequence[topics.Message]) -> None:
        """Encode and send those messages whose topics have subscribers."""
        for message in messages:
            links = [link for link in self.links if link.wants(message.topic, message.name)]
            if links:
                data = message.data()
                for link in links:
                    link.publish(message.topic, data)

    def keep_time(self) -> None:
        """Wait for the start of the next time step, then pass the clients' commands to the robots."""
        sim = self.sim
        self.ticks = max(0, sim.tick)
        if sim.tick == 0:
            self._await_all()
            for group in self.groups:
                group.inbox.begin()
            self._start = self.clock()
        elif self.pace.wait:
            self._await_answers(sim.tick)
        elif self.pace.speed < inf:
            self._await_time(sim.tick)
        for group in self.groups:
            for line in group.order(sim.t):
                self._say(line)
        self._tell()
        self._began = self.clock()

    def _await_time(self, tick: int) -> None:
        """Wait until time step `tick` is over by the clock; count the step as missed if that time has passed."""
        pace = self.sim.dt / self.pace.speed
        due = self._start + tick * pace
        late = self.clock() - due
        if late > 0:
            self.missed += 1
            if late > max(SLIP, pace):
                self._start += late
            return
        while (left := due - self.clock()) > 0 and not self.signals.stopped:
            self.sleep(min(left, LOOK_S))

    def _await_answers(self, tick: int) -> None:
        """Wait until all connected robots that still search have answered the readings of time step `tick`."""
        for group in self.groups:
            inbox = group.inbox
            with inbox.news:
                while not self.signals.stopped:
                    asked = ~(inbox.lost() | inbox.awaited() | group.over)
                    if (inbox.answers[asked] >= tick).all():
                        break
                    inbox.news.wait(LOOK_S)
                    self._tell()

    def _await_all(self) -> None:
        """Wait until all robots have connected, unless the run starts at once."""
        shown = ""
        while not self.pace.at_once and not self.signals.stopped:
            missing = [(group, np.flatnonzero(group.inbox.awaited())) for group in self.groups]
            line = ", ".join(_named(group.name, robots) for group, robots in missing if len(robots))
            if not line:
                return
            if line != shown:
                shown = line
                self._say(f"waiting for {line}")
            until = self.clock() + AGAIN_S
            while self.clock() < until and not self.signals.stopped:
                self.sleep(LOOK_S / 5)
                self._tell()
                if not any(group.inbox.awaited().any() for group in self.groups):
                    break
            self.publish()

    def _tell(self) -> None:
        """Print and remove the queued remarks of the transports."""
        while self.remarks:
            self._say(self.remarks.popleft())

    def _say(self, line: str) -> None:
        if not self.quiet:
            say(line, error=True)

    # ------------------------------------------------------------ summary

    def summary(self) -> dict[str, object]:
        p50, p99 = (
            np.percentile(1e3 * np.array(self.taking), [50, 99]).round(3) if self.taking else (None, None)
        )
        kinds = ("taken", "malformed", "oversized", "late")
        groups = {
            group.name: {kind: group.inbox.counts[kind] for kind in kinds}
            | {"times_lost": group.times_lost, "never_heard": int(group.inbox.awaited().sum())}
            for group in self.groups
        }
        return {
            "ticks": self.ticks,
            "ticks_missed": self.missed,
            "tick_ms": {"p50": p50, "p99": p99},
            "messages": groups,
            "strays": self.strays,
        }


def _named(group: str, robots: np.ndarray) -> str:
    """Return the names of these robots of a group, for a message; at most SHOWN of them."""
    names = ", ".join(f"{group}_{n}" for n in robots[:SHOWN])
    return names if len(robots) <= SHOWN else f"{names} and {len(robots) - SHOWN} more"
