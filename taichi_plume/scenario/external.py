"""Robots that something outside drives: real ones, or programs in any language."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from taichi_plume.scenario.listening import AnyAlgorithm
from taichi_plume.scenario.vocabulary import COMPILED, Duration

if TYPE_CHECKING:
    from taichi_plume.scenario.arena import Arena
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
