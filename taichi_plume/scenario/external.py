"""Robots that are driven from outside, by other programs, and robots that replay recorded paths."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario.listening import AnyAlgorithm
from taichi_plume.scenario.vocabulary import COMPILED, Delay, Duration, FileName, Point2

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Arena, Context
    from taichi_plume.scenario.robots import Group


class External(AnyAlgorithm):
    """Robots that are driven from outside, while `taichi_plume.serve` runs the scenario. See agents/external.py."""

    outside: ClassVar[bool] = True
    kind: Literal["external"]
    takes: Annotated[Literal["velocity", "pose"], COMPILED] = "velocity"
    """What comes from outside. velocity: speed and turn rate, which the simulated body carries out; pose: where real
    robots are, which smell the simulated plume there."""
    timeout: Duration = 1.0
    """Time of the clock without a word after which a robot counts as lost and stands still; it may come back."""

    @property
    def placed(self) -> bool:
        return self.takes == "pose"

    @property
    def may_declare(self) -> bool:
        """Whether its robots may say where a source is: what the outside does is not known before."""
        return True

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        if self.placed and group.odometry is not None:
            yield f"{where}.odometry: its robots are told where they are from outside (takes: pose); remove it"


MOST_LISTED = 10


class Replay(AnyAlgorithm):
    """Robots that go the ways of recorded ones, and smell the simulated plume there. See agents/replay.py."""

    kind: Literal["replay"]
    file: FileName
    """Path of a bag of ROS or of a run's robots.parquet, relative to the scenario's folder. A bag is a folder or a
    file .mcap, .db3 or .bag; of a run the first trial is taken."""
    robots: Annotated[tuple[str, ...], Field(max_length=1000)] = ()
    """Names of the recorded robots, one for each of the team; unless given, the first that there are. In a bag a robot
    is named by what stands before its topic of gas, or of poses where it has no gas; in a table by group and number,
    such as `pair 0`."""
    topics: Annotated[tuple[str, ...], Field(max_length=1000)] = ()
    """Topics of gas in a bag, each of a robot; unless given, all of the first type that there is."""
    poses: Annotated[tuple[str, ...], Field(max_length=1000)] = ()
    """Topics of poses in a bag, for each of gas; unless given, frames tell where it was. Where these do not, the topic
    of poses does that is named most alike."""
    frame: str = "map"
    """Frame of a bag in which the robots' places are taken."""
    origin: Point2 = (0.0, 0.0)
    """Where that frame's origin lies in the domain, x and y."""
    start: Delay = 0.0
    """Time of the recording, since the first pose of these robots, at which the run begins."""

    @property
    def placed(self) -> bool:
        return True

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        if group.odometry is not None:
            yield f"{where}.odometry: its robots are where they were recorded to be (kind: replay); remove it"
        if self.robots and len(self.robots) != group.count:
            yield (
                f"{where}.algorithm.robots: {len(self.robots)} names for {group.count} robots of the team; give one "
                "for each, or none"
            )

    def problems(self, where: str, context: "Context") -> Iterator[str]:
        there = [one.name for one in context.resources.ways[where]]
        count = _group(where, context).count
        listed = ", ".join(there[:MOST_LISTED]) + (" ..." if len(there) > MOST_LISTED else "")
        missing = [name for name in self.robots if name not in there]
        if missing:
            yield f"{where}.robots: there is no '{missing[0]}' in {self.file}; it has {listed}"
        elif len(there) < count:
            yield f"{where}.file: {self.file} has {len(there)} robots, {listed}; the team has {count}"
        else:
            yield from self._off_the_floor(where, context)

    def _off_the_floor(self, where: str, context: "Context") -> Iterator[str]:
        size = np.array(context.domain.extent[:2])
        for one in self.chosen(context.resources.ways[where], _group(where, context).count):
            place = one.place[:, :2] + self.origin
            if not ((place > 0.0) & (place < size)).all(axis=1).any():
                low, high = place.min(axis=0), place.max(axis=0)
                yield (
                    f"{where}.origin: {one.name} is never in the domain, {context.domain.box}; it is within "
                    f"x {low[0]:.4g} to {high[0]:.4g} m, y {low[1]:.4g} to {high[1]:.4g} m"
                )

    def remarks(self, where: str, context: "Context") -> Iterator[str]:
        size = np.array(context.domain.extent[:2])
        chosen = self.chosen(context.resources.ways[where], _group(where, context).count)
        for one in chosen:
            place = one.place[:, :2] + self.origin
            out = ~((place > 0.0) & (place < size)).all(axis=1)
            if out.any():
                yield f"{where}.file: {one.name} is not in the domain for {100 * out.mean():.0f} % of its poses"
        last = max(one.t[-1] for one in chosen) - self.begin_of(chosen)
        if last < context.scenario.duration:
            yield f"{where}.file: its last pose is at {last:.4g} s of the run; from then on the robots stand there"

    def chosen(self, ways: Sequence[Any], count: int) -> list[Any]:
        """The ways of the team's robots, of those that there are."""
        if not self.robots:
            return list(ways[:count])
        by_name = {one.name: one for one in ways}
        return [by_name[name] for name in self.robots]

    def begin_of(self, chosen: Sequence[Any]) -> float:
        """Time of the recording at which the run begins [s]."""
        return min(one.t[0] for one in chosen) + self.start


def _group(where: str, context: "Context") -> "Group":
    """Whose algorithm is that of this path."""
    return next(group for n, group in enumerate(context.scenario.robots) if where == f"robots[{n}].algorithm")
