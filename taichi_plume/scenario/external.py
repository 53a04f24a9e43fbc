"""Robots that are driven from outside, by other programs, and robots that replay recorded paths."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Arena
from taichi_plume.scenario.search_algorithm import AnyAlgorithm
from taichi_plume.scenario.vocabulary import FileName

if TYPE_CHECKING:
    from taichi_plume.scenario.robots import Group


class External(AnyAlgorithm):
    """Robots that another program drives, while `taichi_plume.serve` runs the scenario. See agents/external.py."""

    outside: ClassVar[bool] = True
    may_declare: ClassVar[bool] = True  # unknown: the program decides
    kind: Literal["external"]
    takes: Literal["velocity", "pose"] = "velocity"
    """Content of the commands. velocity: speed and turn rate, which the simulated body carries out; pose: where real
    robots are, which measure the simulated plume there."""
    timeout: si.Duration = 1.0
    """Time without a message after which a robot counts as lost and stands still; it may come back."""

    @property
    def placed(self) -> bool:
        return self.takes == "pose"

    def in_group(self, where: str, group: "Group", floor: Arena) -> Iterator[str]:
        if self.placed and group.localization is not None:
            yield f"{where}.localization: the poses of these robots come from outside (takes: pose); remove it"


class Replay(AnyAlgorithm):
    """Robots that follow recorded paths and measure the simulated plume there. See agents/replay.py."""

    kind: Literal["replay"]
    file: FileName
    """Path of a bag of ROS or of a run's robots.parquet, relative to the scenario's folder. A bag is a folder or a
    file .mcap, .db3 or .bag; of a run the first trial is taken."""
    robots: Annotated[tuple[str, ...], Field(max_length=1000)] = ()
    """Names of the recorded robots, one for each of the team; unless given, the first ones. In a bag a robot is
    named by what stands before its topic of gas, or of poses where it has no gas; in a table by group and number,
    such as `pair 0`."""
    topics: Annotated[tuple[str, ...], Field(max_length=1000)] = ()
    """Topics of gas in a bag, each of a robot; unless given, all of the first type that there is."""
    poses: Annotated[tuple[str, ...], Field(max_length=1000)] = ()
    """Topics of poses in a bag, or frames of its robots, one for each topic of gas. Unless given, the source with poses
    around most readings counts."""
    readings: Annotated[tuple[str, ...], Field(max_length=1000)] = ()
    """Numbers in messages of any type that are gas readings, by topic and field, such as `/enose.data[0]`."""
    units: Literal["ppm", "ppb"] | None = None
    """Unit of the gas in a bag; unless given, that of the messages or, if they have none, ppm."""
    frame: str | None = None
    """Frame of a bag to which the robots' positions refer. Unless given, it is `map` or, in a bag without it, the frame
    of the poses, with a note."""
    origin: si.Point2 | None = None
    """Position of that frame's origin in the domain, x and y. Unless given, positions in `map` are those of the
    scenario's first map of ROS; without one, and in other frames, the origin is the domain's lower corner."""
    start: si.Delay = 0.0
    """Time of the recording, since the first pose of these robots, at which the run starts."""

    placed: ClassVar[bool] = True

    def in_group(self, where: str, group: "Group", floor: Arena) -> Iterator[str]:
        if group.localization is not None:
            yield f"{where}.localization: the poses of these robots are recorded (kind: replay); remove it"
        if self.robots and len(self.robots) != group.count:
            yield (
                f"{where}.algorithm.robots: {len(self.robots)} names for {group.count} robots; give one for each "
                "or none"
            )
