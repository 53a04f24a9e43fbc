"""The clock of a served run: when ticks begin, what goes out after each, and whom it waits for.

A tick of simulated time takes its time of the clock: at its begin robots are told what has been heard for them by then,
at its end what they read goes out. Where that is later than the next tick ought to begin, the tick counts as missed;
the clock catches up where it can, and after SLIP seconds is put back. With `wait`, the next tick begins when all robots
that are not lost have answered the readings of this one: then nothing depends on how fast anything is.
"""

import gc
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from math import ceil, inf
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.agents.external import LOST, ExternalAlgorithm, Orders
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import sensor_fields
from taichi_plume.guard.terminal import say
from taichi_plume.running.signals import Ears
from taichi_plume.serve import topics
from taichi_plume.serve.inbox import Inbox
from taichi_plume.serve.links import Hear, Link
from taichi_plume.serve.view import View
from taichi_plume.simulation import Every, Simulation

SLIP = 1.0  # s of the clock that are caught up
LOOK_S = 0.1  # between looks at signals, while it waits
AGAIN_S = 0.5  # between readings that are told again until robots are there
MOST_TIMES = 1_000_000  # of which latencies are worked out
VIEW_S = 1.0  # between pictures of the gas
SHOWN = 6  # robots that are named


class Pace(NamedTuple):
    """How a run keeps time. speed: simulated time over that of the clock, inf: as fast as it can; wait: for answers to
    each tick; at_once: whether it begins without robots that it has not heard of.
    """

    speed: float = 1.0
    wait: bool = False
    at_once: bool = False


class Outside:
    """A group whose robots are driven from outside: their algorithm and their inbox."""

    def __init__(
        self, sim: Simulation, number: int, algorithm: ExternalAlgorithm, remark: Callable[[str], None]
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
        )
        self.noses = [sensor_fields(one) for one in group.model.sensors.noses]
        self.each = group.size <= topics.MOST_ROBOTS
        self.lost, self.over = np.zeros(group.size, bool), np.zeros(group.size, bool)
        self.times_lost = 0

    def incoming(self) -> dict[str, Hear]:
        """Who hears which topic."""
        inbox = self.inbox
        heard: dict[str, Hear] = {f"{self.name}/commands": inbox.hear_commands}
        kind, hear = ("pose", inbox.hear_pose) if inbox.placed else ("cmd_vel", inbox.hear_twist)
        for n in range(inbox.size if self.each else 0):
            heard[f"{self.name}_{n}/{kind}"] = partial(hear, n)
        return heard

    def told(self, t: float, tick: int) -> list[topics.Message]:
        """What its robots read at time t [s]."""
        told, inbox = self.algorithm.told(), self.inbox
        by_declaring = self.algorithm.members.groups[0].model.found == "declared"
        told["over"] = self.over = told["found"] | (by_declaring & (told["declarations"] > 0))
        more = {"answered": inbox.number, "lost": inbox.lost()}
        messages = [topics.readings(self.name, t, tick, told, **more)]
        return messages + (list(topics.of_each(self.name, t, told, self.noses)) if self.each else [])

    def order(self, t: float) -> list[str]:
        """Let the robots do what was heard for them; returns what is to be said of those that are lost or back."""
        orders = self.inbox.orders()
        self.algorithm.order(orders, t)
        lost = orders.state == LOST
        gone, back = np.flatnonzero(lost & ~self.lost), np.flatnonzero(self.lost & ~lost)
        self.lost, self.times_lost = lost, self.times_lost + len(gone)
        return [
            f"t = {t:.1f} s: {_named(self.name, some)} {what}"
            for some, what in ((gone, "lost: nothing heard, standing still"), (back, "back"))
            if len(some)
        ]


class Service:
    """Keeps a simulation's time, tells what its robots read and lets those outside drive.

    quiet: whether nothing is said.
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
        self.taking: deque[float] = deque(maxlen=MOST_TIMES)  # s, from a tick's begin to its readings
        self._start = self._began = 0.0

    def warm(self, sim: Simulation) -> None:
        sim.tick = 0
        for team in sim.teams:
            if isinstance(team.algorithm, ExternalAlgorithm):
                team.algorithm.order(Orders.none(team.algorithm.size), 0.0)
                team.algorithm.told()
        for message in View(sim).messages():
            message.data()
        sim.advance()
        sim.swarm.snapshot()
        sim.reset()

    def attach(self, sim: Simulation, ears: Ears) -> None:
        self.sim, self.ears = sim, ears
        names = {number: name for number, name in enumerate(group.name for group in sim.swarm.groups)}
        for team in sim.teams:
            if isinstance(team.algorithm, ExternalAlgorithm):
                self.groups.append(Outside(sim, team.numbers[0], team.algorithm, self.remarks.append))
        self.remarks += [
            f"{group.name} has {group.inbox.size} robots, more than {topics.MOST_ROBOTS}: only the group has topics"
            for group in self.groups
            if not group.each
        ]
        incoming = {topic: hear for group in self.groups for topic, hear in group.incoming().items()}
        for link in self.links:
            link.listen(incoming, self._stray)
        first = [group for group in sim.swarm.groups]
        self._first = np.concatenate(
            [np.arange(g.start, g.start + g.count) for g in first] or [np.zeros(0, int)]
        )
        self._names = [f"{ros.word(names[g.number])}_{n}" for g in first for n in range(g.count)]
        sim.observers.insert(0, Every(sim.dt, lambda _: self.publish()))  # before files are written
        view = View(sim)
        sim.observers.append(Every(VIEW_S, lambda _: self._send(view.messages())))
        sim.observers.append(Every(sim.dt, lambda _: self.keep_time()))
        gc.collect()
        gc.freeze()  # to look through all that there is by now takes longer than a tick

    def _stray(self, data: bytes, json: bool = False) -> None:
        """Something came that nobody takes."""
        self.strays += 1
        if self.strays & (self.strays - 1) == 0:
            self.remarks.append(f"messages that nobody takes: {self.strays:,}")

    def close(self) -> None:
        gc.unfreeze()
        tick = max(0, self.sim.tick)
        self._send([topics.ended(group.name, self.sim.t, tick) for group in self.groups])
        for link in self.links:
            link.close()

    # ------------------------------------------------------------ each tick

    def publish(self) -> None:
        """Tell what the robots read."""
        sim = self.sim
        messages = [topics.clock(sim.t)]
        for group in self.groups:
            messages += group.told(sim.t, sim.tick)
        if len(self._names) <= topics.MOST_ROBOTS:
            now = sim.swarm.snapshot()
            altitude = now.get("altitude", np.zeros(len(now["heading"])))
            poses = (one[self._first] for one in (now["position"], now["heading"], altitude))
            messages.append(topics.poses(sim.t, self._names, *poses))
        speed = inf if self.pace.wait else self.pace.speed
        for group in self.groups:  # first: answers may come before the last message is out
            behind = ceil(group.inbox.timeout * speed / sim.dt) if speed < inf else 1 << 40
            group.inbox.published(sim.tick, sim.tick - behind)
        for link in self.links:
            link.go_on(sim.t)
        self._send(messages)
        if sim.tick > 0:
            self.taking.append(self.clock() - self._began)

    def _send(self, messages: Sequence[topics.Message]) -> None:
        """Make and send those that somebody wants."""
        for message in messages:
            wanted = [link for link in self.links if link.wants(message.topic, message.name)]
            if wanted:
                data = message.data()
                for link in wanted:
                    link.publish(message.topic, data)

    def keep_time(self) -> None:
        """Wait for the next tick's begin, then let the robots do what was heard for them."""
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
        """Until this tick is over by the clock."""
        pace = self.sim.dt / self.pace.speed
        due = self._start + tick * pace
        late = self.clock() - due
        if late > 0:
            self.missed += 1
            if late > max(SLIP, pace):
                self._start += late
            return
        while (left := due - self.clock()) > 0 and not self.ears.stopped:
            self.sleep(min(left, LOOK_S))

    def _await_answers(self, tick: int) -> None:
        """Until all robots that are there and search have answered."""
        for group in self.groups:
            inbox = group.inbox
            with inbox.news:
                while not self.ears.stopped:
                    asked = ~(inbox.lost() | inbox.awaited() | group.over)
                    if (inbox.answers[asked] >= tick).all():
                        break
                    inbox.news.wait(LOOK_S)
                    self._tell()

    def _await_all(self) -> None:
        """Until all robots have been heard of, if the run waits for them."""
        told = ""
        while not self.pace.at_once and not self.ears.stopped:
            missing = [(group, np.flatnonzero(group.inbox.awaited())) for group in self.groups]
            line = ", ".join(_named(group.name, some) for group, some in missing if len(some))
            if not line:
                return
            if line != told:
                told = line
                self._say(f"waiting for {line}")
            until = self.clock() + AGAIN_S
            while self.clock() < until and not self.ears.stopped:
                self.sleep(LOOK_S / 5)
                self._tell()
                if not any(group.inbox.awaited().any() for group in self.groups):
                    break
            self.publish()

    def _tell(self) -> None:
        """Say what the transports remarked."""
        while self.remarks:
            self._say(self.remarks.popleft())

    def _say(self, line: str) -> None:
        if not self.quiet:
            say(line, error=True)

    # ------------------------------------------------------------ its end

    def told(self) -> dict[str, Any]:
        taking = 1e3 * np.array(self.taking or [np.nan])
        p50, p99 = (
            round(float(one), 3) if np.isfinite(one) else None for one in np.percentile(taking, [50, 99])
        )
        groups = {
            group.name: {
                name: group.inbox.counts[name] for name in ("taken", "malformed", "oversized", "late")
            }
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
    """Some robots of a group by their names."""
    names = ", ".join(f"{group}_{n}" for n in robots[:SHOWN])
    return names if len(robots) <= SHOWN else f"{names} and {len(robots) - SHOWN} more"
