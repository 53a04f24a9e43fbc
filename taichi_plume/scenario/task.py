"""What a scenario is as a task to learn: episodes, the airs they are in, and rewards. See taichi_plume.envs."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from taichi_plume.scenario.played import Played
from taichi_plume.scenario.quantities import number
from taichi_plume.scenario.vocabulary import Duration, FileName, Model, Wait

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Context

Worth = number(-1e6, 1e6)


class Reward(Model):
    """What a robot's step is worth: the sum of these."""

    found: Worth = 1.0
    """For finding a source: by reaching it or declaring it, as the group's `found` says."""
    time: Worth = -0.01
    """For each second that goes by."""
    path: Worth = 0.0
    """For each metre that it drives."""
    bump: Worth = -0.02
    """Each time it meets something."""
    gas: Worth = 0.0
    """Per second, times the gas entry of its observation: what it smells."""
    progress: Worth = 0.0
    """Per metre by which it came nearer to the nearest source. It takes the true place, which no observation tells."""
    false_declaration: Worth = -0.5
    """For declaring a source where none is."""


class Task(Model):
    """A task to learn. Only environments look at it."""

    episode: Duration = 60.0
    """Longest time of an episode."""
    airs: Annotated[int, Field(ge=1, le=1000)] = 1
    """How many airs are recorded before learning, the first with the seed of the air, the others with the next ones."""
    film: Duration | None = None
    """Length of each recording; unless given, twice an episode. Episodes begin at any time of it that leaves room for
    them."""
    frame: Wait = 0.5
    """Time between the frames of recordings, rounded to whole ticks; in between, the air is linear in time."""
    films: tuple[FileName, ...] = ()
    """Films to play instead, each in place of the file of what the scenario has of kind playback."""
    sources: Literal["all", "one"] = "all"
    """Whether the gases of the scenario are there together, or each episode has one of them alone, drawn."""
    mirror: bool = True
    """Whether half of the episodes, drawn, are seen in a mirror: left is right, for observations and actions."""
    units: bool = True
    """Whether each episode draws which unit of its model a gas sensor is; otherwise each environment keeps one."""
    reward: Reward = Reward()
    """What a step is worth."""

    @property
    def length(self) -> float:
        """Of each recording [s]."""
        return 2.0 * self.episode if self.film is None else self.film

    def problems(self, where: str, context: "Context") -> Iterator[str]:
        if self.film is not None and self.film < self.episode:
            yield (
                f"{where}.film: {self.film:g} s is shorter than an episode of {self.episode:g} s; make it longer, or "
                "the episode shorter"
            )
        scenario = context.scenario
        played = [scenario.wind, *(gas for _, gas in scenario.gases)]
        if self.films and not any(isinstance(one, Played) and one.kind == "playback" for one in played):
            yield f"{where}.films: neither wind nor gas is of kind playback, nothing plays them; make one so"
