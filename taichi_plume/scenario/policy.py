"""Policies of reinforcement learning as search algorithms: observations, actions and the file of the network."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.search_algorithm import AnyAlgorithm
from taichi_plume.scenario.vocabulary import INPUT_FILE, consistency_check

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Arena, Context
    from taichi_plume.scenario.robots import Group

Entry = Literal[
    "gas",
    "noses",
    "memory",
    "rise",
    "resistance",
    "wind",
    "bumper",
    "heading",
    "position",
    "height",
    "action",
    "clock",
    "mates",
]
MOST_STACKED = 64


class Policy(AnyAlgorithm):
    """A policy, learnt or still to be learnt. See agents/policy.py, agents/observation.py and agents/commands.py."""

    searches: ClassVar[bool] = True
    kind: Literal["policy"]
    file: Annotated[str, INPUT_FILE] | None = None
    """ONNX file of the network, relative to the scenario's folder: from an observation to an action. Unless given, the
    policy is still to be learnt: environments of `taichi_plume.envs` can be made of the scenario, and it cannot be
    run."""
    observe: Annotated[tuple[Entry, ...], Field(min_length=1, max_length=13)] = (
        "gas",
        "memory",
        "wind",
        "bumper",
        "action",
    )
    """Entries of an observation, in this order. gas: the reading, on a scale of powers of ten; `noses`:
    readings of the other gas sensors; memory: averages of the gas entry over the times of `memory`; rise: change of the
    gas entry since the last decision; resistance: of a metal oxide; wind: the measured direction and
    speed; bumper; heading and position: as the robot estimates them; height: of a
    drone over the floor, over that of the ceiling; action: the last one; clock: the time since the
    start, as t/(t + 60 s); mates: age of the last message, position and reading of the nearest team mates, by radio."""
    memory: Annotated[tuple[si.Wait, ...], Field(max_length=8)] = (1.0, 5.0, 20.0)
    """Time constants of averages of the gas entry, for the entry `memory`."""
    neighbours: Annotated[int, Field(ge=1, le=MOST_STACKED)] | None = None
    """Largest number of team mates in the entry `mates`; unless given, all."""
    history: Annotated[int, Field(ge=1, le=MOST_STACKED)] = 1
    """Number of stacked observations, the newest first."""
    act: Literal["drive", "waypoint"] = "drive"
    """Kind of action. drive: speed, from zero to the largest, and turn rate, to the left; waypoint: a
    position to go to, ahead and to the left. Drones have a third number: climb rate, or position above."""
    step: si.Length = 0.5
    """Distance of the farthest way point."""
    period: si.Wait = 0.5
    """Time between decisions, rounded to whole ticks; the last action holds in between."""
    declares: bool = False  # type: ignore[misc]
    """Whether an action has a further number: above 0.5 the robot declares a source at its position."""

    @property
    def may_declare(self) -> bool:
        return self.declares

    @consistency_check
    def _once(self) -> Iterator[str]:
        for n, name in enumerate(self.observe):
            if name in self.observe[:n]:
                yield f"observe: '{name}' is listed twice; list each entry once"
        if "memory" in self.observe and not self.memory:
            yield "memory: is empty; give a time for the entry 'memory', or do not observe it"

    def ticks(self, tick: float) -> int:
        """Return the number of control periods of `tick` seconds between two decisions of the policy."""
        return max(1, round(self.period / tick))

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        if "mates" in self.observe and group.count == 1:
            yield f"{where}.algorithm.observe: mates, but count is 1; remove the entry"
        if "height" in self.observe and not group.body.flies:
            yield f"{where}.algorithm.observe: height, but the robots stay on the floor; remove it, or use drones"
        if "noses" in self.observe and len(group.sensors.noses) == 1:
            yield f"{where}.algorithm.observe: has 'noses', but there is one gas sensor; remove the entry, or list more"

    def warnings(self, where: str, context: "Context") -> Iterator[str]:
        if not self.file:
            yield f"{where}.file: not given; a policy without a file can be learnt in taichi_plume.envs, but not run"
        tick = context.scenario.tick
        ticks = self.ticks(tick)
        if abs(ticks * tick - self.period) > 1e-6 * tick:
            yield f"{where}.period: {self.period:g} s is no multiple of the tick; {ticks * tick:g} s are used"
