"""A policy: what it observes of its robots and what it does, whether it is still to be learnt or runs from a file."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.listening import AnyAlgorithm
from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.vocabulary import COMPILED, INPUT_FILE, Length, Wait

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
    "action",
    "clock",
    "mates",
]
MOST_STACKED = 64


class Policy(AnyAlgorithm):
    """A policy that was learnt, or is to be. See agents/policy.py, agents/observation.py and agents/commands.py."""

    searches: ClassVar[bool] = True
    kind: Literal["policy"]
    file: Annotated[str, INPUT_FILE] | None = None
    """ONNX file of the network, relative to the scenario's folder: from an observation to an action. Unless given, the
    policy is still to be learnt: environments of `taichi_plume.envs` can be made of the scenario, and it cannot be
    run."""
    observe: Annotated[tuple[Entry, ...], Field(min_length=1, max_length=12)] = (
        "gas",
        "memory",
        "wind",
        "bumper",
        "action",
    )
    """What an observation is made of, in this order. gas: the reading, on a scale of powers of ten; noses:
    those of the gas sensors behind the first; memory: averages of the gas entry over the times of `memory`; rise: its
    change since the last decision; resistance: of a metal oxide; wind: where it is felt to come from and how fast;
    bumper; heading and position: as the robot believes; action: the last one; clock: the time since the begin, as
    t/(t + 60 s); mates: where team mates are and what they read, of those in radio range."""
    memory: Annotated[tuple[Wait, ...], Field(max_length=8), COMPILED] = (1.0, 5.0, 20.0)
    """Time constants of averages of the gas entry, for the entry `memory`."""
    history: Annotated[int, Field(ge=1, le=MOST_STACKED)] = 1
    """How many observations are stacked, the newest first."""
    act: Literal["drive", "waypoint"] = "drive"
    """What an action is. drive: speed, from none to the largest, and turn rate, to the left; waypoint: a place ahead
    and to the left to go to."""
    step: Length = 0.5
    """How far away the farthest way point is."""
    period: Wait = 0.5
    """Time between decisions, rounded to whole ticks; the last action holds in between."""
    declares: bool = False  # type: ignore[misc]
    """Whether an action has one number more: above 0.5 the robot declares that a source is where it stands."""

    @property
    def may_declare(self) -> bool:
        return self.declares

    @model_validator(mode="after")
    def _once(self) -> "Policy":
        for n, name in enumerate(self.observe):
            if name in self.observe[:n]:
                raise fault("observe: '{name}' is there twice; name each entry once", {"name": name})
        if "memory" in self.observe and not self.memory:
            raise fault("memory: no time is given for the entry 'memory'; give one, or do not observe it", {})
        return self

    def ticks(self, tick: float) -> int:
        """Ticks [s] between two decisions."""
        return max(1, round(self.period / tick))

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        if "mates" in self.observe and group.count == 1:
            yield f"{where}.algorithm.observe: mates, but count is 1: there are none; leave the entry out"
        if "noses" in self.observe and len(group.sensors.noses) == 1:
            yield f"{where}.algorithm.observe: noses, but there is one gas sensor; leave the entry out, or list more"

    def remarks(self, where: str, context: "Context") -> Iterator[str]:
        if not self.file:
            yield f"{where}.file: not given; a policy can be learnt in taichi_plume.envs, but not run without a file"
        tick = context.scenario.tick
        ticks = self.ticks(tick)
        if abs(ticks * tick - self.period) > 1e-6 * tick:
            yield f"{where}.period: {self.period:g} s is no multiple of the tick: it decides every {ticks * tick:g} s"
