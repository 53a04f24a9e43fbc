"""Robots in the recording: poses, trails, readings, declarations and behaviour, sampled often and sent in batches."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import rerun as rr

from taichi_plume.record import drawing, scene
from taichi_plume.record.placement import Stage
from taichi_plume.record.stream import Stream
from taichi_plume.scenario.palette import rgb, robot_color, state_colors
from taichi_plume.scenario.robots import Group
from taichi_plume.time_loop import TimeLoop

MOST_ROBOTS = 50
DECISIONS = "decisions"  # entity of the decision quantities

Event = tuple[float, str, str, tuple[int, ...]]
"""Time [s], level, text and colour of an event."""
Declared = tuple[float, np.ndarray, bool]
"""Time [s] and position (2,) [m] of a declaration, and whether the declaration is right."""


@dataclass
class Robot:
    """Recorded robot, and its changes since the last batch."""

    STATE: ClassVar[tuple[str, ...]] = ("state", "last", "said", "right")

    index: int
    """Index in the swarm."""
    name: str
    color: tuple[int, ...]
    states: tuple[str, ...]
    """Names of the algorithm's states, and "found" at the end."""
    model: Group
    state: int = -1
    changes: list[tuple[float, str]] = field(default_factory=list)
    last: dict[str, np.ndarray] = field(default_factory=dict)
    """End of each trail of the robot."""
    said: int = 0
    """Number of its declarations."""
    right: int = 0
    """Number of its right declarations."""
    declared: list[Declared] = field(default_factory=list)

    @property
    def reckons(self) -> bool:
        """Whether the robot knows its pose with errors only."""
        return self.model.localization is not None


def recorded_robots(sim: TimeLoop) -> list[Robot]:
    """Return up to MOST_ROBOTS robots of the first trial, in equal shares of the groups."""
    groups = list(sim.swarm.groups)
    share = max(1, MOST_ROBOTS // max(1, len(groups)))
    robots, first = [], 0
    for group, names in zip(groups, sim.state_names(), strict=True):
        part = _part(group.name)
        if sum(_part(other.name) == part for other in groups) > 1:
            part = f"{part}{groups.index(group)}"
        states = (*names, "found")
        for i in range(min(group.count, share)):
            name = part if group.count == 1 else f"{part}-{i}"
            color = rgb(robot_color(first + i))
            robots.append(Robot(group.start + i, name, color, states, group.model))
        first += group.count
    return robots[:MOST_ROBOTS]


class Tracks:
    """Sampler of robots that sends the samples in batches.

    thresholds: lines in the plot of the readings [ppm]; events: list to which events are added; decisions: names of
    the decision quantities of the robots' algorithms.
    """

    STATE = ("robots", "states")

    def __init__(
        self,
        stream: Stream,
        stage: Stage,
        robots: list[Robot],
        thresholds: Sequence[float],
        events: list[Event],
        decisions: Sequence[str],
    ):
        self.stream, self.stage = stream, stage
        self.robots, self.thresholds, self.events = robots, thresholds, events
        self.decisions = decisions
        self.index = np.array([robot.index for robot in robots], int)
        self.found = np.array([len(robot.states) - 1 for robot in robots], int)
        self.states = np.full(len(robots), -1)
        """State of each robot in the last sample."""
        self.samples: list[np.ndarray] = []
        """Samples not yet sent for all robots, (robots, 9 + decisions) each: time, x, y, heading, reading, believed x,
        y and heading, altitude, decision quantities.
        """
        self.sent = np.zeros(len(robots), int)
        """Number of these samples that have been sent, per robot."""
        stream.log_still(self._styles())

    def _styles(self) -> scene.Entities:
        """Yield static data of each recorded robot: body, and colours of trail, sensor plot and behaviour."""
        colors = state_colors(name for robot in self.robots for name in robot.states[:-1])
        for robot in self.robots:
            body, name = robot.model.body, robot.name
            yield f"robots/{name}", scene.body(body.radius, body.height, robot.color, self.stage)
            trail = rr.LineStrips3D.from_fields(colors=robot.color, radii=rr.Radius.ui_points(1.8))
            yield f"trails/{name}", trail
            if robot.reckons:
                pale = drawing.pale(robot.color)
                yield f"believed/{name}", scene.ghost(body.radius, pale, self.stage)
                trail = rr.LineStrips3D.from_fields(colors=pale, radii=rr.Radius.ui_points(1.0))
                yield f"believed_trails/{name}", trail
            yield f"sensors/{name}", rr.SeriesLines(colors=robot.color, names=name, widths=1.6)
            for decision in self.decisions:
                line = rr.SeriesLines(colors=robot.color, names=name, widths=1.6)
                yield f"{DECISIONS}/{decision}/{name}", line
            yield f"states/{name}", scene.lanes(robot.states, colors)
        for threshold in self.thresholds:
            line = rr.SeriesLines(colors=[200, 200, 200], names=f"threshold {threshold:g} ppm", widths=1.0)
            yield _threshold(threshold), line

    def sample(self, sim: TimeLoop) -> None:
        """Gather pose, gas reading and behaviour changes of each recorded robot at the present time."""
        if not self.robots:
            return
        now = sim.swarm.snapshot()
        k = self.index
        names = ("position", "heading", "above_ppm", "believed_position", "believed_heading")
        altitude = now["altitude"][k] if "altitude" in now else np.zeros(len(k))
        columns = [np.full(len(k), sim.t), *(now[name][k] for name in names), altitude]
        decided = sim.decisions()
        columns += [decided[name][k] for name in self.decisions]
        self.samples.append(np.column_stack(columns))
        states = np.where(now["found"][k], self.found, now["state"][k])
        for n in np.flatnonzero(states != self.states):
            self._note_state(self.robots[n], int(states[n]), self.samples[-1][n], now)
        self.states = states
        for robot in self.robots:
            if now["declarations"][robot.index] != robot.said:
                self._note_declared(robot, sim.t, now)

    def _note_declared(self, robot: Robot, t: float, now: dict[str, np.ndarray]) -> None:
        """Add a declaration as an event and a mark. The swarm keeps the position of the first right declaration."""
        declared, false, place, when = (
            now[name][robot.index]
            for name in ("declarations", "false_declarations", "declared_position", "declared_time")
        )
        before, right = robot.right > 0, declared - false > robot.right
        word = "rightly" if right else "falsely"
        if before:
            text = f"{robot.name} declared again, {word}; its first right place counts"
        else:
            text = f"{robot.name} declared a source at ({place[0]:.2f}, {place[1]:.2f}) m, {word}"
            robot.declared.append((float(when), place.copy(), bool(right)))
        self.events.append((t if before else float(when), "DECLARED", text, robot.color))
        robot.said, robot.right = int(declared), int(declared - false)

    def _note_state(self, robot: Robot, state: int, sample: np.ndarray, now: dict[str, np.ndarray]) -> None:
        """Add a change of state as an event; sample: as in `samples`."""
        t, x, y, _, reading = (float(value) for value in sample[:5])
        name = robot.states[state]
        robot.changes.append((t, name))
        place = f"at ({x:.2f}, {y:.2f}) m"
        if now["found"][robot.index]:
            how = "by declaring, " if robot.model.found == "declared" else ""
            text = f"{robot.name} found a source {how}{place}, {now['path_length'][robot.index]:.2f} m driven"
            self.events.append((t, "FOUND", text, robot.color))
        elif robot.state >= 0:
            text = f"{robot.name}: {robot.states[robot.state]} -> {name} {place}, {reading:.3g} ppm"
            self.events.append((t, "STATE", text, robot.color))
        robot.state = state

    def send(self, share: int = 0, of: int = 1) -> None:
        """Send the gathered samples of every `of`-th robot, from number `share` on."""
        for n in range(share, len(self.robots), of):
            robot = self.robots[n]
            if robot.changes:
                times, states = zip(*robot.changes, strict=True)
                self.stream.send(f"states/{robot.name}", times, rr.StateChange.columns(state=states))
                robot.changes.clear()
            for t, place, right in robot.declared:
                text = f"{robot.name}: {'right' if right else 'wrong'}"
                self.stream.log(t, f"declared/{robot.name}", scene.declared(place, right, text, self.stage))
            robot.declared.clear()
            samples = [sample[n] for sample in self.samples[self.sent[n] :]]
            self.sent[n] = len(self.samples)
            if samples:
                self._send_samples(robot, np.array(samples).T)
        done = self.sent.min(initial=len(self.samples))
        del self.samples[:done]
        self.sent -= done

    def _send_samples(self, robot: Robot, columns: np.ndarray) -> None:
        t, reading, z = columns[0], columns[4], columns[8]
        self._send_way(robot, "robots", "trails", t, columns[1:4], z)
        if robot.reckons:
            self._send_way(robot, "believed", "believed_trails", t, columns[5:8], z)
        self.stream.send(f"sensors/{robot.name}", t, rr.Scalars.columns(scalars=reading))
        for name, values in zip(self.decisions, columns[9:], strict=True):
            known = np.isfinite(values)  # NaN: the robot has another algorithm, or nothing to decide by yet
            if known.any():
                scalars = rr.Scalars.columns(scalars=values[known])
                self.stream.send(f"{DECISIONS}/{name}/{robot.name}", t[known], scalars)
        if robot is self.robots[0]:
            for threshold in self.thresholds:
                level = rr.Scalars.columns(scalars=np.full(len(t), threshold))
                self.stream.send(_threshold(threshold), t, level)

    def _send_way(
        self, robot: Robot, poses: str, trails: str, t: np.ndarray, way: np.ndarray, z: np.ndarray
    ) -> None:
        """Send poses (3, n) at altitudes z (n,) [m] to an entity in `poses`, and the steps to an entity in `trails`."""
        x, y, heading = way
        place = np.column_stack([x, y, z + 2 * self.stage.lift])
        turn = np.column_stack([0 * x, 0 * x, np.sin(heading / 2), np.cos(heading / 2)])
        transforms = rr.Transform3D.columns(translation=place, quaternion=turn)
        self.stream.send(f"{poses}/{robot.name}", t, transforms)
        path = np.vstack([robot.last.get(trails, place[:1]), place])
        robot.last[trails] = place[-1:]
        steps = rr.LineStrips3D.columns(
            strips=np.stack([path[:-1], path[1:]], axis=1, dtype=np.float32, casting="same_kind")
        )
        self.stream.send(f"{trails}/{robot.name}", t, steps)


def _part(name: str) -> str:
    """Return a name with characters replaced that an entity path of the recording does not allow."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", name) or "_"


def _threshold(ppm: float) -> str:
    return "sensors/threshold_" + _part(f"{ppm:g}")
